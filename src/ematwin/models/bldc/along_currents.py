"""Motor and output as the recorded currents drive them, where the motor's angle was not recorded.

Nothing is fed back by the controller: the torque of the recorded currents moves both masses, and
each of the `commutations` corrects angle and speed by a Kalman filter (Kalman 1960, J. Basic Eng.
82, 35-45), so that a torque that is a little wrong does not add up. The angle that was seen less
the one expected, in standard deviations, is white if the actuator is right. These innovations are
the residual of the mechanics (prediction-error method; Ljung 1999, System Identification, section
3.2). How noisy the acceleration is follows from them by maximum likelihood (Mehra 1970, IEEE Trans.
Autom. Control 15(2), 175-184): where the actuator is known badly, the filter trusts it less.
"""

import copy
import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.bldc.commutations import commutations
from ematwin.models.bldc.constants import fault_state, kernel_constants, truer_constants
from ematwin.models.bldc.faults import UNKNOWNS, ZERO, fault_vector
from ematwin.models.bldc.inverter import dot, gate_signals
from ematwin.models.bldc.motor import hall_sector, torque_of_cogging
from ematwin.models.bldc.reference_step import ReferenceState, all_emf_constants, move_masses
from ematwin.models.optional import Values
from ematwin.numerics.compile import loop
from ematwin.numerics.signals import white_noise

LEAST = 0.001  # of the recorded current: what simulators of other make differ by
RECENT = 32  # answers that are kept: many of the next differ by a sensor or a mass alone
_STEP = 2.5e-6  # s, at most: steps of 1 us change angles by 0.15 mrad, of 5 us by 0.4
_SURELY = 3.0  # standard deviations of an innovation: more is a surprise
_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
_TURNS = 5  # steps with one torque of the currents
_LATE = 0.5  # of the deviation of when they came: so far all commutations were off in the mean
_SWITCHED = 1e-4  # rad, by which a sensor of the rotor may switch sooner or later
_TRUST = tuple(10.0**n for n in range(-1, 8))  # times the density of what noise of currents makes
_LOST = 1e3  # times that density: something is far off
_ASTRAY = 0.15  # rad: outputs by currents and as recorded are a fiftieth of it apart
_FRICTIONS = (0.1, 0.2, 0.3, 0.45, 0.6)  # faults
MOVES = {  # what it depends on, by name, and what that usually is
    **{one.name: one.healthy for one in UNKNOWNS if one.name != "gain"},
    "load_gain": 1.0, "load_offset": 0.0, "current_gain": 1.0, "current_offset": 0.0, ZERO: 0.0,
}  # fmt: skip


@loop
def masses_along(k, currents, load, spacing, substeps, c, truer, more, seen, near, known, state):  # type: ignore[no-untyped-def]
    """Angles and speeds along recorded currents: of both masses, (4, S), and what corrected them.

    Parameters
    ----------
    k : (8,) array, fault vector
    currents : (S, 3) array, A, means of the phases since the last sample; (S, 1) of the current
        through the two that conduct
    load : (S,) array, N m on the motor shaft
    spacing, substeps : s, of samples, and steps between them
    c, truer : as of `batch.reference_trace`
    more : (2,) array, factor on the torque of the currents, and N m that add to it
    seen : (2, K) array, of commutations: when, in samples, and at which angle of the motor, rad
    near : (S,) array, rad, near which the motor is; NaN where that is unknown
    known : (5,) array: s, standard deviation of when they came; rad, multiples of which angles
        lack; rad^2/s^3, density of the noise of the acceleration; rad, how far from ``near`` it is;
        1/rad, density of what is no commutation
    state : (2,) array, rad, where both begin at rest, and how well that is known

    Returns
    -------
    found : (4, S) array, angle and speed of motor and output, rad and rad/s
    left : (2, K) array, innovations and their standard deviations, rad
    fixed : (4, K) array, by which what was seen changed ``found``
    """
    fault = fault_state(k, c.half_gap)
    theta_m, w_m, theta_o, w_o = state[0], 0.0, state[0], 0.0
    of_angle, of_both, of_speed = state[1] ** 2, 0.0, 0.0  # the covariance
    bent_m, bent_o, last, j = 0.0, 0.0, 0.0, 0
    found, fixed = np.zeros((4, load.size)), np.zeros((4, seen.shape[1]))
    left, dt, torque = np.zeros((2, seen.shape[1])), spacing / substeps, 0.0
    for g in range(load.size):
        found[0, g], found[1, g], found[2, g], found[3, g] = theta_m, w_m, theta_o, w_o
        for n in range(substeps if g < load.size - 1 else 0):
            now = ReferenceState(
                0.0, 0.0, 0.0, w_m, theta_m, w_o, theta_o, 1.0, 0.0, 0.0, 0.0, bent_m, bent_o
            )
            if n % _TURNS == 0:  # it turns by a few milliradians meanwhile
                middle = theta_m + 0.5 * _TURNS * dt * w_m
                kappas = all_emf_constants(middle, fault, c, truer)
                torque = more[1] + torque_of_cogging(middle, truer)
                if currents.shape[1] == 1:
                    i = gate_signals(hall_sector(c.pole_pairs * middle), currents[g + 1, 0])
                else:
                    i = currents[g + 1, 0], currents[g + 1, 1], currents[g + 1, 2]
                torque += more[0] * dot(kappas, i)
            pushes = load[g] + (n + 0.5) / substeps * (load[g + 1] - load[g])
            w_m, theta_m, w_o, theta_o, bent_m, bent_o = move_masses(
                now, torque, pushes, fault, c, truer, dt
            )
            end = g + (n + 1) / substeps
            while j < seen.shape[1] and seen[0, j] <= end:
                span = (seen[0, j] - last) * spacing
                of_angle += span * (2.0 * of_both + span * (of_speed + known[2] * span / 3.0))
                of_both += span * (of_speed + known[2] * span / 2.0)
                of_speed += known[2] * span
                away = seen[1, j] - theta_m + (end - seen[0, j]) * spacing * w_m
                away -= known[1] * np.floor(away / known[1] + 0.5)
                noise = _SWITCHED**2 + (known[0] * w_m) ** 2
                variance = of_angle + noise
                # what was seen may be something else, which is as likely anywhere
                deviation, likely = math.sqrt(variance), math.exp(-0.5 * away**2 / variance)
                other = known[4] * _ROOT_TWO_PI * deviation
                true = 1.0 if other == 0.0 else likely / (likely + other)
                left[0, j], left[1, j] = away, deviation / (1.0 + other)
                if other > 0.0:
                    far = math.sqrt(2.0 * math.log((1.0 + other) / (likely + other)))
                    left[0, j] = math.copysign(far * left[1, j], away)
                # whether friction holds the motor at an instant is a matter of chance: by how much
                # that is beyond what is likely the filter trusts its state less
                surprise = away**2 / (_SURELY**2 * variance)
                if surprise > 1.0:
                    of_angle, of_both = surprise * of_angle, surprise * of_both
                    of_speed, variance = surprise * of_speed, of_angle + noise
                share, pace = true * of_angle / variance, true * of_both / variance
                of_speed -= pace * of_both
                of_both, of_angle = of_both * (1.0 - share), of_angle * (1.0 - share)
                # a mass that friction holds is where it is, and an output in the gap by itself
                turns = pace * away if (w_m != 0.0) | (surprise > 1.0) else 0.0
                theta_m, w_m = theta_m + share * away, w_m + turns
                fixed[0, j], fixed[1, j] = share * away, turns
                if abs(theta_m - theta_o) >= fault.half_gap:
                    theta_o, w_o = theta_o + share * away, w_o + turns
                    fixed[2, j], fixed[3, j] = share * away, turns
                last, j = seen[0, j], j + 1
        if g < load.size - 1 and near[g + 1] == near[g + 1]:
            away = near[g + 1] - theta_m
            away -= known[1] * np.floor(away / known[1] + 0.5)
            # further off it is lost
            beyond = min(away + known[3], 0.0) + max(away - known[3], 0.0)
            theta_m, theta_o = theta_m + beyond, theta_o + beyond
    return found, left, fixed


class Moved(NamedTuple):
    """How both masses moved, on the motor shaft."""

    motor: np.ndarray  # (S,), rad
    output: np.ndarray
    left: np.ndarray  # (K,), innovations in standard deviations
    log_density: float  # of what was seen


class Masses:
    """Both masses along recorded currents, A, and their ``load`` (S,), N m.

    Currents are those of the phases (S, 3), or one equivalent current (S,), whose commutations are
    told apart by where the motor is ``near`` (S,), rad. Both masses ``begin`` at rest at an angle,
    rad; an ``output`` (S,), rad, may have been recorded. All on the motor shaft.
    """

    def __init__(
        self, currents: np.ndarray, load: np.ndarray, rate: float, begin: float, sheet: Any,
        near: np.ndarray | None = None, output: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self._every = commutations(currents, rate, sheet)
        self._seen = self._every if near is None else self._every.placed(near, near)
        self._currents = currents = currents.reshape(len(currents), -1)
        self._load, self._rate, self._begin, self._sheet = load, rate, begin, sheet
        inertia = sheet.motor.inertia + sheet.transmission.output_inertia
        unit = sheet.motor.emf_constant / inertia
        # each phase makes half of the torque constant, the open one less
        share = 1.0 if near is not None else 0.76
        noise = share * float(np.mean([white_noise(x) for x in currents.T]))
        usual = float(np.sqrt(np.mean(currents**2)))
        self._usual = (unit * math.hypot(noise, LEAST * usual)) ** 2 / rate
        self._whole = (unit * usual) ** 2 / rate  # of noise as large as the currents
        self.density = self._usual
        self.begins: Values = {}  # nearer than those that were given
        self._output, self._astray = output, 0.0
        self._recent = lru_cache(maxsize=RECENT)(self._moved)
        self._likeliest = lru_cache(maxsize=RECENT)(self._found)

    def at(self, actuator: Any, values: Values, density: float | None = None) -> "Masses":
        """The same with this noise of the acceleration, or the likeliest one at these values."""
        if density is None:
            found = self._likeliest(actuator, _given(values))
        else:
            found = self._with(density=density, begins={})
        if self._output is not None and self._seen.when.size:
            some = slice(int(self._seen.when[-1]))  # beyond, nothing shows where they are
            moved = found.moved(actuator, {**values, **found.begins}).output
            found._astray = float(np.std((self._output - moved)[some])) / _ASTRAY
        return found

    def _found(self, actuator: Any, given: tuple[tuple[str, float], ...]) -> "Masses":
        values = dict(given)
        own = values.get("friction", 0.0)

        def best_of(some: Sequence[Values]) -> tuple[Masses, Values]:
            tried = [(self._with(density=x * self._usual), one) for x in _TRUST for one in some]
            return max(tried, key=lambda one: one[0].moved(actuator, one[1]).log_density)

        best, begins = best_of([values])
        if best.density > _LOST * self._usual:
            # between commutations a motor may be lost whose friction is far off
            others = [{**values, "friction": one} for one in _FRICTIONS if one > own]
            best, begins = best_of([values, *others])
        if self._currents.shape[1] == 1:
            moved = best.moved(actuator, begins).motor
            best = best._with(_seen=self._every.placed(moved, self._seen.near))
        best.begins = {name: x for name, x in begins.items() if x != values.get(name)}
        return best

    def _with(self, **changed: Any) -> "Masses":
        other = copy.copy(self)
        other.__dict__.pop("size", None)
        other.__dict__ |= changed
        other._recent = lru_cache(maxsize=RECENT)(other._moved)
        return other

    @cached_property
    def size(self) -> float:
        """Norm of the innovations without any torque."""
        free = self._sheet.model_copy(update={"presliding": None, "cogging": None})
        still = self._with(
            _currents=0.0 * self._currents, _load=0.0 * self._load,
            _seen=self._seen._replace(other=0.0),
        )  # fmt: skip
        return float(np.linalg.norm(still.left(free, {"friction": -0.5})))  # which leaves none

    @property
    def unexplained(self) -> float:
        """Share of the currents that would be noise, beyond that which they have.

        Or share of `_ASTRAY` by which the recorded output is elsewhere, as one that comes late.
        """
        noise = math.sqrt(max(0.0, self.density - self._usual) / self._whole)
        return max(noise, self._astray)

    @property
    def discrepancy(self) -> float:
        """Share of the noise of the acceleration that the currents do not make."""
        return max(0.0, 1.0 - self._usual / self.density)

    def moved(self, actuator: Any, values: Values) -> Moved:
        """How they moved, with faults, load and sensors by name."""
        return self._recent(actuator, _given(values))

    def _moved(self, actuator: Any, values: tuple[tuple[str, float], ...]) -> Moved:
        given = {**MOVES, **dict(values)}
        ratio, seen = actuator.transmission.ratio, self._seen
        offset = given["current_offset"] * actuator.motor.emf_constant
        # they stand somewhere in the gap
        begins = [self._begin - given[ZERO], self._sheet.transmission.backlash]
        found, (away, spreads), fixed = masses_along(
            fault_vector(given), self._currents,
            given["load_gain"] * self._load + given["load_offset"] / ratio,
            1.0 / self._rate, math.ceil(1.0 / (self._rate * _STEP) - 1e-9),
            kernel_constants(actuator), truer_constants(actuator),
            np.array([1.0, -offset]) / given["current_gain"], np.array(seen[:2]), seen.near,
            np.array([seen.jitter, seen.turn, self.density, seen.within, seen.other]),
            np.array(begins),
        )  # fmt: skip
        left = away / spreads
        log_density = -float(0.5 * left @ left + np.log(spreads).sum())
        return Moved(*self._smoothed(found, fixed), left, log_density)

    def _smoothed(self, found: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angles (S,) of motor and output, rad, without the steps of corrections."""
        # each belongs to the time since the last one: a cubic that ends with its angle and speed
        seen, sample = self._seen.when, np.arange(found.shape[1])
        n = np.minimum(np.searchsorted(seen, sample), seen.size - 1)
        begins = np.r_[0.0, seen][n]
        samples = np.maximum(seen[n] - begins, 1e-9)
        s = (sample - begins) / samples
        s, span = np.where(s > 1.0, 0.0, s), samples / self._rate
        for side in (0, 2):
            angle, speed = fixed[side, n], fixed[side + 1, n]
            found[side] += angle * (3.0 - 2.0 * s) * s * s + speed * span * (s - 1.0) * s * s
        return found[0], found[2]

    def left(self, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Innovations (K,), in standard deviations."""
        return self.moved(actuator, values or {}).left

    def least(self, actuator: Any) -> float:
        """Share of the innovations without any torque that noise leaves."""
        return math.hypot(self.alike(actuator), math.sqrt(self._seen.when.size) / self.size)

    def alike(self, actuator: Any) -> float:
        """The same that commutations which all come late leave, and simulators of other make."""
        late = _LATE * math.sqrt(self._seen.when.size)
        return math.hypot(LEAST, late / self.size)

    def seen_anew(self, seed: int) -> "Masses":
        """The same with other noise of commutations, and of the acceleration by its density."""
        rng, seen = np.random.default_rng(seed), self._seen
        late = self._seen.jitter * self._rate * rng.standard_normal(seen.when.size)
        noise = np.array([white_noise(x) for x in self._currents.T])
        noise *= math.sqrt(self.density / self._usual)
        return self._with(
            _seen=seen._replace(when=np.sort(seen.when + late)),
            _currents=self._currents + noise * rng.standard_normal(self._currents.shape),
        )


def _given(values: Values) -> tuple[tuple[str, float], ...]:
    """Those of values on which masses depend."""
    return tuple((name, values[name]) for name in MOVES if name in values)
