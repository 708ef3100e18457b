"""Equations that a drive satisfies along a recorded motion.

docs/models.md, "Forms that no file states". The controller answers the recorded command and motion
with a current (`Controller`); the mechanics need a torque for the recorded motion
(`ematwin.models.bldc.balance`). Neither is simulated in a closed loop: the residual of the recorded
current belongs to one of them (direct identification; Ljung 1999, System Identification, section
13.4).
"""

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.bldc.along_currents import LEAST, RECENT
from ematwin.models.bldc.constants import (
    Truer,
    TruerState,
    fault_state,
    kernel_constants,
    truer_constants,
)
from ematwin.models.bldc.faults import HELD, ZERO, fault_vector
from ematwin.models.bldc.masses_filter import constants_of, truer_of
from ematwin.models.bldc.motion import Motion, between
from ematwin.models.bldc.motor import SIXTH_TURN
from ematwin.models.bldc.reference_step import (
    ReferenceState,
    all_emf_constants,
    drive,
    started,
)
from ematwin.models.bldc.simulate import phases_of
from ematwin.models.optional import FIRST_SAMPLE, Candidate, Values, with_values
from ematwin.numerics.compile import loop, step
from ematwin.numerics.lanes import columns
from ematwin.numerics.side_by_side import side_by_side
from ematwin.numerics.signals import LowPass, white_noise

_INSTANT = 1e-10  # s: what is so near is now
_STEP = 1.25e-5  # s, at most, behind a current loop: sample times show
_COARSER = 2.0  # times that where currents drive the motor: still leaves less than `LEAST`
_, read_more, _ = columns(TruerState)


@loop
def emf_along(k, angles, c, truer):  # type: ignore[no-untyped-def]
    """Constants of the EMF (3, G), V s/rad, at angles (G,) of the motor."""
    fault = fault_state(k, c.half_gap)
    found = np.empty((3, angles.size))
    for g in range(angles.size):
        found[0, g], found[1, g], found[2, g] = all_emf_constants(angles[g], fault, c, truer)
    return found


@step
def until_event(wait, late, span, delay, dt):  # type: ignore[no-untyped-def]
    """A step ``dt`` (s) that ends where a loop samples or answers, if that is sooner."""
    # with fixed steps samples would come late
    due = wait <= _INSTANT
    sample, answer = wait + span if due else wait, delay if due else late
    dt = min(dt, sample) if span > 0.0 else dt
    return min(dt, answer) if (span > 0.0) & (answer > _INSTANT) else dt


@step
def until_commutation(theta_e, w_e, dt):  # type: ignore[no-untyped-def]
    """A step ``dt`` (s) that ends at the next commutation, if that is sooner; angles electrical."""
    sectors = theta_e / SIXTH_TURN - 0.5
    ahead = math.floor(sectors + 1.0) - sectors if w_e > 0.0 else math.ceil(sectors - 1.0) - sectors
    wait = ahead * SIXTH_TURN / w_e if w_e != 0.0 else dt
    return min(dt, wait + _INSTANT)


@loop
def currents_along(ks, commands, motions, spacing, interval, cs, longest, samples, truers, i, more):  # type: ignore[no-untyped-def]
    """Mean phase currents (B, S, 3), A, of each interval from 0 s on, of B candidates.

    Parameters
    ----------
    ks : (B, 8) array, fault vectors
    commands : (B, G) array, rad on the motor shaft; straight lines between points
    motions : (B, 6, G) array, angle and speed of the motor, and angle of the output, on its shaft;
        constants of the EMF of each phase, shares of ``k_e``
    spacing, interval : s, of these points from 0 s on, and of the means
    cs, truers : (fields, B) arrays of `Constants` and `Truer`
    longest : (B,) array, s, of a step
    samples : S
    i, more : (B, 3) and (B, 17) arrays, A, phase currents at first, and fields of `TruerState`
    """
    found = np.zeros((len(ks), samples, 3))
    last = commands.shape[1] - 2
    for n in range(len(ks)):
        c, truer = constants_of(cs, n), truer_of(truers, n)
        motion, command = motions[n], commands[n]
        fault, now_more = fault_state(ks[n], c.half_gap), read_more(more[n].reshape(-1, 1), 0)
        i_a, i_b, i_c, pair_sign = i[n, 0], i[n, 1], i[n, 2], 1.0
        begin, sample = 0.0, 0
        while sample < samples:
            bound = (sample + 1) * interval
            dt = until_event(
                now_more.wait, now_more.late, truer.speed_loop_sample_time, truer.speed_loop_delay,
                min(longest[n], bound - begin),
            )  # fmt: skip
            dt = until_event(
                now_more.voltage_wait, now_more.voltage_late, truer.current_loop_sample_time,
                truer.current_loop_delay, dt,
            )  # fmt: skip
            at = begin / spacing
            g = min(int(at), last)
            s = at - g
            theta_m, w_m = between(motion[0], g, s), between(motion[1], g, s)
            dt = until_commutation(c.pole_pairs * theta_m, c.pole_pairs * w_m, dt)
            now = ReferenceState(
                i_a, i_b, i_c, w_m, theta_m, 0.0, between(motion[2], g, s), pair_sign,
                0.0, 0.0, 0.0, 0.0, 0.0,
            )  # fmt: skip
            kappas = (
                c.k_e * between(motion[3], g, s), c.k_e * between(motion[4], g, s),
                c.k_e * between(motion[5], g, s),
            )  # fmt: skip
            done = drive(now, now_more, between(command, g, s), kappas, fault, c, truer, dt)
            i_a, i_b, i_c = done.i
            pair_sign, now_more = done.pair_sign, done.more
            for m in range(3):
                found[n, sample, m] += dt / interval * done.means[m]
            begin += dt
            if bound - begin < _INSTANT:
                begin, sample = bound, sample + 1
    return found


class _Asked(NamedTuple):
    """On what a simulated current depends: of the recorded one sensors change no more."""

    actuator: Any
    faults: tuple[float, ...]
    others: tuple[tuple[str, float], ...]  # values, by name, on which the motion depends
    skew: float  # s, of the command
    first: float  # s, when loops sampled first
    held: float  # A, by an integral term at first
    faster: float
    counts: bool


class Controller:
    """The current that controller and windings make along a motion, beside the recorded one."""

    def __init__(self, motion: Motion, low_pass: LowPass) -> None:
        self.motion, self._low_pass = motion, low_pass
        self._recent: dict[_Asked, np.ndarray] = {}
        self._states = lru_cache(maxsize=RECENT)(self._moved)
        self._known: tuple[Any, np.ndarray] | None = None  # EMF along the motion
        rate = motion.rate
        count = min(len(motion.time), int(0.4 * rate) + 1)  # 0.4 s are simulated
        self._grid = motion.grid(count)
        signed = 0.5 * np.einsum("sk,sk->s", motion.currents, motion.trapezoids)[:count]
        self._fixed = motion.states(self._grid, motion.sheet, motion.values)
        self._begins, self._signed = float(signed[0]), signed[1:]
        self._seen = self._equivalent(motion.currents[1:count])
        self.size = float(np.linalg.norm(self._seen))

    def at(self, values: Values, noise: Any, ahead: bool) -> "Controller":
        """The same along the motion at other values (`Motion.at`)."""
        motion = self.motion.at(values, noise, ahead)
        return self if motion is self.motion else Controller(motion, self._low_pass)

    def _equivalent(self, currents: np.ndarray) -> np.ndarray:
        """The filtered equivalent current (S - 1,), A."""
        shapes = self.motion.trapezoids[1 : len(currents) + 1]
        signed = 0.5 * np.einsum("sk,sk->s", currents, shapes)
        return self._low_pass.apply(signed, self.motion.rate)

    def left(
        self, actuator: Any, values: Values | None = None, windings: Values | None = None,
        **how: Any,
    ) -> np.ndarray:  # fmt: skip
        """Simulated less recorded current (S - 1,), A, as of `each`."""
        return self.each([(actuator, values or {})], windings, **how)[0]

    def each(
        self, candidates: Sequence[Candidate], windings: Values | None = None, *,
        faster: float = 1.0, counts: bool = False,
    ) -> list[np.ndarray]:  # fmt: skip
        """Simulated less recorded current (S - 1,), A, of candidates; ``faster`` divides the step.

        Where ``windings`` are given, the current has these faults and the motion those of the
        candidates.

        At which instants an encoder is read is not known, nor the motion within a count: the loops
        know the mean speed of a sample time and its filter. With ``counts`` they see it in counts
        of any beginning.
        """
        motion = self.motion
        if motion.masses is not None:
            motion.masses.moved_each(candidates)
        every = [
            _Asked(
                actuator, tuple(fault_vector({**given, **(windings or {})}).tolist()),
                tuple((name, given[name]) for name in motion.moves if name in given),
                given.get("skew", 0.0), given.get(FIRST_SAMPLE, motion.first_sample),
                given.get(HELD, 0.0), faster, counts,
            )
            for actuator, given in candidates
        ]  # fmt: skip
        found = {one: x for one in every if (x := self._recent.get(one)) is not None}
        if new := [one for one in dict.fromkeys(every) if one not in found]:
            found |= (fresh := dict(zip(new, self._simulated(new), strict=True)))
            self._recent |= fresh
            for one in list(self._recent)[:-RECENT]:
                self._recent.pop(one, None)
        return [
            own.get("current_gain", 1.0) * found[one] + own.get("current_offset", 0.0) - self._seen
            for one, (_, own) in zip(every, candidates, strict=True)
        ]

    def _simulated(self, some: Sequence[_Asked]) -> list[np.ndarray]:
        """Simulated equivalent currents (S - 1,), A."""
        grid, motion, shape = self._grid, self.motion, (len(some), self._grid.time.size)
        commands, motions = np.empty(shape), np.empty((shape[0], 6, shape[1]))
        rows: tuple[list[Any], ...] = [], [], [], [], [], []
        longest = _STEP if motion.masses is None else _COARSER * _STEP
        for n, one in enumerate(some):
            actuator = one.actuator
            commands[n] = np.interp(grid.time + one.skew, motion.time, motion.command)
            if actuator.current_loop is None:  # a comparator overshoots by the change in a step
                dt = grid.step / max(1, round(one.faster * grid.step / actuator.steps.reference))
            else:
                dt = 1.0 / motion.rate / math.ceil(one.faster / motion.rate / longest)
            c, truer = kernel_constants(actuator), truer_constants(actuator)
            if truer.motor_step > 0.0 and not one.counts:
                # rad: counts of such an encoder do not show
                truer = truer._replace(motor_step=1e-9, output_step=0.0)
            states, emf = self._states_of(one, c, truer)
            motions[n, :3], motions[n, 3:] = states, emf
            angle, speed = states[:2, 0]
            loops = started(truer, actuator.motor, self._begins, angle, speed, one.first, one.held)
            phases = phases_of(self._begins, actuator.motor.pole_pairs * angle)
            for every, row in zip(rows, (one.faults, c, dt, truer, phases, loops), strict=True):
                every.append(row)
        ks, cs, steps, truers, i, more = (np.array(row, dtype=float) for row in rows)
        currents = currents_along(
            ks, commands, motions, grid.time[1], 1.0 / motion.rate, cs.T.copy(), steps,
            self._seen.size, truers.T.copy(), i, more,
        )  # fmt: skip
        return [self._equivalent(one) for one in currents]

    def _states_of(self, one: _Asked, c: Any, truer: Truer) -> tuple[np.ndarray, np.ndarray]:
        """States (3, G) as of `Motion.states`, and constants of the EMF there (3, G)."""
        motion, states = self.motion, self._fixed
        if motion.masses is not None:
            states = motion.states(self._grid, one.actuator, dict(one.others))
        elif motion.moves:
            sections = tuple(getattr(one.actuator, name) for name in motion.sections)
            states = self._states(sections, one.others)
        own = one.actuator
        windings = own.emf, own.torque_ripple, own.eccentricity, own.shorted_turns
        key, known = (one.faults[2:7], windings), self._known
        if motion.masses is not None or known is None or known[0] != key:
            # most candidates have the windings of the last one, and the motion
            emf = emf_along(np.array(one.faults), states[0], c._replace(k_e=1.0), truer)
            self._known = known = key, emf
        return states, known[1]

    def _moved(
        self, sections: tuple[Any, ...], values: tuple[tuple[str, float], ...]
    ) -> np.ndarray:
        """States (3, G) of an actuator with such sections."""
        changed = dict(zip(self.motion.sections, sections, strict=True))
        actuator = self.motion.sheet.model_copy(update=changed)
        return self.motion.states(self._grid, actuator, dict(values))

    def changes(self, actuator: Any) -> dict[str, np.ndarray]:
        """How the residual (S - 1,), A, changes with what may pass for a form."""
        # A skew (s) may pass for a lag, and a current that an integral held at first (A) hides
        # it. As if the current followed its demand: ripple of a comparator drowns such a change.
        motion, own, count = self.motion, actuator.controller, self._seen.size + 1
        demand = own.position_gain * own.speed_gain / (2.0 * actuator.motor.emf_constant)
        pace = np.gradient(motion.command[:count], motion.time[:count])[1:]
        late = demand * self._low_pass.apply(pace, motion.rate)
        found = {"skew": late, HELD: np.ones(late.size)}
        if motion.moves:  # integrated by a term of usual time
            found[ZERO] = demand * motion.time[1:count] / 0.03
        return found

    def least(self, actuator: Any) -> float:
        """Share of the recorded current that noise and the error of the equation leave."""
        noise = noise_of(self._signed, self._low_pass, self.motion.rate, self._seen.size)
        # of recorded positions, or of how the currents drive them, and of counts in the loops
        values = self.motion.values
        if self.motion.masses is not None:  # that moved with these values, parameters among them
            actuator = with_values(actuator, values)
        here, squares = self.left(actuator, values), 0.0
        if self._anew:
            lefts = side_by_side(lambda one: one.left(actuator, values), self._anew)
            squares += sum(float(np.sum((left - here) ** 2)) for left in lefts) / len(lefts)
        if actuator.encoder is not None:
            squares += float(np.sum((self.left(actuator, values, counts=True) - here) ** 2))
        return math.hypot(math.hypot(noise, math.sqrt(squares)) / self.size, self.alike(actuator))

    @cached_property
    def _anew(self) -> "list[Controller]":
        # of commutations there are few: one draw tells little
        draws = 1 if self.motion.masses is None else 4
        others = side_by_side(self.motion.recorded_anew, range(draws))
        return [Controller(one, self._low_pass) for one in others if one is not None]

    def alike(self, actuator: Any) -> float:
        """Share that simulators of other make and the ripple of a comparator leave."""
        # ripples of two simulations differ as much as those of a simulation and a recording
        if actuator.current_loop is not None:
            return LEAST
        values = self.motion.values
        faster = self.left(actuator, values, faster=1.3)
        ripple = float(np.linalg.norm(self.left(actuator, values) - faster))
        return math.hypot(LEAST, ripple / self.size)


def noise_of(current: np.ndarray, low_pass: LowPass, rate: float, samples: int) -> float:
    """Norm of the white noise of a current in so many of its filtered samples, A."""
    return white_noise(current) * math.sqrt(low_pass.noise_gain(rate) * samples)
