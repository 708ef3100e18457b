"""Balance of torques along a recorded motion, and the twist of the gear.

docs/models.md, "Forms that no file states", has the equations. The mechanics need a torque for the
recorded motion, which the recorded currents make (`TorqueBalance`; inverse dynamics, Gautier and
Khalil 1990, IEEE Trans. Robotics and Automation 6(3), 368-373). The difference of both positions
shows on which face of the gap the output lies (`Contact`), and when it crosses the gap: then either
mass moves by itself (`Crossing`).
"""

import math
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ematwin.models.bldc.along_currents import LEAST, RECENT
from ematwin.models.bldc.along_motion import emf_along, noise_of
from ematwin.models.bldc.constants import FaultState, fault_state, kernel_constants, truer_constants
from ematwin.models.bldc.counts import speed_noise
from ematwin.models.bldc.faults import fault_vector
from ematwin.models.bldc.motion import Motion
from ematwin.models.optional import Values
from ematwin.numerics.compile import plain
from ematwin.numerics.signals import LowPass, filtered, white_noise

_STANDS = 0.02  # of the largest speed: nearer to rest friction is not known
_CERTAIN = 3.0  # standard deviations of a twist, and of its change
_OF_WINDINGS = ("emf", "torque_ripple", "eccentricity", "shorted_turns")  # sections of the EMF


class TorqueBalance:
    """The torque that a motion needs beside the torque of recorded currents; while both slide.

    Samples count where both ``slides`` (S,); where ``moves_together`` no mass crosses the gap. An
    output that follows the motor does so at faults, load and sensors ``values``.
    """

    def __init__(
        self,
        motion: Motion,
        values: Values | None = None,
        slides: np.ndarray | None = None,
    ) -> None:
        self._values = values
        motion = motion.smoother(500.0)  # Hz, of counts: an acceleration's noise grows with f^2
        # below 200 Hz the acceleration of an encoder's position is known
        self.motion, self._low_pass = motion, LowPass(200.0)
        middle = motion.time - 0.5 / motion.rate
        self._angle = motion.motor(middle)
        self._recorded_load = motion.alike(motion.load)
        self.w_m, self._dw_m = motion.motor(middle, 1), motion.motor(middle, 2)
        if motion.follows:
            _, self.w_o = motion.followed(middle, motion.sheet, values)
            self._dw_o = np.gradient(self.w_o, middle)
        else:
            self.w_o, self._dw_o = motion.output(middle, 1), motion.output(middle, 2)
        # impacts and reversals are left out until the low-pass has forgotten them
        stands = np.abs(self.w_m) < _STANDS * np.abs(self.w_m).max()
        stands |= np.abs(self.w_o) < _STANDS * np.abs(self.w_o).max()
        stands |= self.w_m * self.w_o < 0.0
        stands[:2] = True
        together = np.abs(self.w_m - self.w_o) < _STANDS * np.abs(self.w_m).max()
        self.moves_together = together
        if any(motion.steps):
            # noise of either acceleration makes its inertia too small and the other's too large:
            # both are taken for one: the sum of inertias counts. Where speeds differ by more
            # than noise, a mean weighted by inertia has the same momentum
            of_motor, of_output = np.square(motion.steps)
            noise = speed_noise(math.hypot(*motion.steps), motion.cutoff, motion.rate)
            share = np.where(
                np.abs(self.w_m - self.w_o) < _CERTAIN * noise,
                of_output / (of_motor + of_output), motion.share,
            )  # fmt: skip
            self._dw_m = self._dw_o = share * self._dw_m + (1.0 - share) * self._dw_o
        if any(motion.steps) or motion.follows:
            stands |= ~together
        settles = np.ones(int(0.01 * motion.rate))  # s, for the low-pass
        self.slides = np.convolve(stands, settles)[: len(stands)] == 0
        if slides is not None:
            self.slides = slides
        # friction, inertia and load leave what currents make as it is
        self._recent = lru_cache(maxsize=RECENT)(self._made)
        self._fades = lru_cache(maxsize=RECENT)(self._fading)
        self._signed = 0.5 * np.einsum("sk,sk->s", motion.currents, motion.trapezoids)
        self.size = float(np.linalg.norm(self._filtered(self._signed)))

    def output_torque(self, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Torque (S,) that the output needs, N m."""
        resists = self.resistance(actuator, values)[1]
        return np.asarray(actuator.transmission.output_inertia * self._dw_o + resists)

    def resistance(
        self, actuator: Any, values: Values | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Torques (S,) against the motion of motor and output without the contact's, N m."""
        of_motor, of_output = self._sliding(actuator, values)
        against = actuator.motor.viscous_damping * self.w_m + of_motor * np.sign(self.w_m)
        if actuator.cogging is not None:
            own = actuator.cogging
            against += own.torque * np.sin(own.cycles * self._angle + own.phase)
        return against, of_output * np.sign(self.w_o) + self._load(actuator, values)

    def torque(self, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Torque (S,) of the recorded currents, N m."""
        given, (made, _, scale) = values or {}, self.made(actuator, values)
        current = (made - given.get("current_offset", 0.0)) / given.get("current_gain", 1.0)
        return np.asarray(actuator.motor.emf_constant * scale * current)

    def made(self, actuator: Any, values: Values | None) -> tuple[np.ndarray, np.ndarray, float]:
        """Equivalent current, as it is and smoothed (S,), A, and the size of the EMF shapes."""
        forms = tuple(getattr(actuator, key) for key in _OF_WINDINGS)
        return self._recent(forms, tuple(fault_vector(values or {})[2:7].tolist()))

    def _made(
        self, forms: tuple[Any, ...], faults: tuple[float, ...]
    ) -> tuple[np.ndarray, np.ndarray, float]:
        sections = dict(zip(_OF_WINDINGS, forms, strict=True))
        actuator = self.motion.sheet.model_copy(update=sections)
        k, c = np.array([0.0, 0.0, *faults, 0.5]), kernel_constants(actuator)._replace(k_e=1.0)
        shapes = emf_along(k, self._angle, c, truer_constants(actuator)).T
        scale = math.sqrt(np.mean(shapes**2) / np.mean(self.motion.trapezoids**2))
        scale = max(scale, 1e-9)  # with all turns lost
        made = 0.5 * np.einsum("sk,sk->s", self.motion.currents, shapes) / scale
        return made, self.motion.alike(made), scale

    def _sliding(self, actuator: Any, values: Values | None) -> tuple[np.ndarray, np.ndarray]:
        """Magnitudes (S,) of the friction in steady sliding, of motor and output, N m."""
        gear, load = actuator.transmission, self._load(actuator, values)
        share = np.where(
            self.w_o * load > 0.0, 1.0 / gear.efficiency_opposing - 1.0,
            1.0 - gear.efficiency_aiding,
        )  # fmt: skip
        worn = state_of(values, actuator).friction
        of_motor = np.full(load.size, worn * actuator.motor.friction_torque)
        of_output = worn * (gear.friction_torque + share * np.abs(load))
        if actuator.presliding is not None:
            fades = self._fades(actuator.presliding.stribeck_speed)
            more_of_motor, more_of_output = 1.0 + (gear.static_ratio - 1.0) * fades
            of_motor, of_output = of_motor * more_of_motor, of_output * more_of_output
        return of_motor, of_output

    def _fading(self, stribeck_speed: float) -> np.ndarray:
        """(2, S), of friction that fades with speed the share left, of motor and output."""
        return np.asarray(np.exp(-((np.array([self.w_m, self.w_o]) / stribeck_speed) ** 2)))

    def _load(self, actuator: Any, values: Values | None) -> np.ndarray:
        """The load (S,) as it is, N m."""
        given = values or {}
        offset = given.get("load_offset", 0.0) / actuator.transmission.ratio
        return np.asarray(given.get("load_gain", 1.0) * self._recorded_load + offset)

    def _filtered(self, trace: np.ndarray) -> np.ndarray:
        """A trace (S,) through the low pass of accelerations from an encoder, where both slide."""
        return self._low_pass.apply(trace, self.motion.rate)[self.slides]

    def least(self, actuator: Any) -> float:
        """Share of the recorded current that noise leaves."""
        seen = int(self.slides.sum())
        noise = noise_of(self._signed, self._low_pass, self.motion.rate, seen)
        anew = self._anew
        if anew is not None:
            noise = math.hypot(noise, np.linalg.norm(anew.left(actuator) - self.left(actuator)))
        return math.hypot(LEAST, noise / self.size)

    @cached_property
    def _anew(self) -> "TorqueBalance | None":
        other = self.motion.recorded_anew()
        return None if other is None else TorqueBalance(other, self._values, self.slides)

    def at(self, values: Values) -> "TorqueBalance":
        """The same motion, with an output that follows the motor at other values."""
        return TorqueBalance(self.motion, values)

    def left(self, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Needed less made torque, as recorded current (K,), A, where both slide.

        As such it holds the noise of the recorded currents unscaled. Otherwise the least squares
        would make that noise smaller by smaller torque constants.
        """
        given, (_, made, scale) = values or {}, self.made(actuator, values)
        needed = actuator.motor.inertia * self._dw_m
        needed += actuator.transmission.output_inertia * self._dw_o
        needed += np.add(*self.resistance(actuator, values))
        gain, offset = given.get("current_gain", 1.0), given.get("current_offset", 0.0)
        current = gain * needed / (actuator.motor.emf_constant * scale)
        return self._filtered(current + offset - made)


class Contact:
    """The twist between motor and output beside the pushing face's twist; while both slide.

    Zero angles are known to less than the gap: only how far the two faces are apart counts.
    """

    def __init__(self, balance: TorqueBalance, actuator: Any, values: Values | None = None) -> None:
        self._balance = balance
        torque, twist = self._elastic(actuator, values), balance.motion.twist()
        # torques whose sign the template knows
        sure = np.abs(torque) > 0.5 * actuator.transmission.friction_torque
        self._pushes = balance.slides & balance.moves_together & sure
        self._gap = actuator.transmission.backlash
        self._pushes[self._pushes] = _rests(
            twist[self._pushes], torque[self._pushes] > 0.0, self._gap
        )
        self._torque, self._twist = torque[self._pushes], twist[self._pushes]
        face = np.sign(self._torque)
        self._face = face - face.mean() if face.size else face
        self.size = float(np.linalg.norm(self._about_mean(self._twist)))

    def _elastic(self, actuator: Any, values: Values | None) -> np.ndarray:
        """Torque (S,) of the stiffness alone, N m: that on the output, later by d/k."""
        balance, contact = self._balance, actuator.contact
        lag = contact.damping / contact.stiffness
        share = math.exp(-1.0 / (lag * balance.motion.rate)) if lag > 0.0 else 0.0
        late = np.array([1.0 - share, 0.0, 0.0, -share, 0.0, 0.0, 0.0])
        return filtered(late, balance.output_torque(actuator, values))[0]

    def apart(self) -> np.ndarray:
        """(S,) of bool: samples at which the twist lies surely between both faces."""
        motion, pushed = self._balance.motion, self._torque > 0.0
        twist = np.subtract(*motion.recorded)
        if not pushed.any() or pushed.all():
            return np.zeros(twist.size, bool)
        known = np.array([np.sign(self._torque), self._torque, np.ones(pushed.size)]).T
        half, gives, middle = np.linalg.lstsq(known, self._twist, rcond=None)[0]
        left = float(np.std(self._twist - known @ [half, gives, middle]))
        margin = _CERTAIN * math.hypot(left, math.hypot(*motion.steps) / math.sqrt(12.0))
        return np.asarray(np.abs(twist - middle) < half - margin)

    def _about_mean(self, twist: np.ndarray) -> np.ndarray:
        return twist - twist.mean() if twist.size else twist

    def least(self, actuator: Any) -> float:
        """Share of the twist that noise leaves."""
        motion = self._balance.motion
        twist, anew = motion.twist(), motion.recorded_anew()
        noise = white_noise(twist) if anew is None else float(np.std(anew.twist() - twist))
        noise = math.hypot(noise, LEAST * self._gap)
        return math.hypot(LEAST, noise * math.sqrt(self._twist.size) / self.size)

    def left(self, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Twist by the twin less the recorded one (K,), rad on the motor shaft."""
        torque = self._elastic(actuator, values)[self._pushes]
        apart = state_of(values, actuator).half_gap * self._face
        return apart + self._about_mean(torque / actuator.contact.stiffness - self._twist)


class Crossing:
    """The angle of motor or output while the output crosses the gap, where neither feels the other.

    The equations are integrated twice, so that recorded angles are not differentiated.
    """

    def __init__(
        self, balance: TorqueBalance, apart: np.ndarray, actuator: Any, of_motor: bool
    ) -> None:
        self._balance, self._of_motor = balance, of_motor
        motion, side = balance.motion, 0 if of_motor else 1
        speed = balance.w_m if of_motor else balance.w_o
        stands = np.abs(speed) < _STANDS * np.abs(speed).max()
        if any(motion.steps):  # a smoothed speed stands later than what friction has stopped
            smeared = np.ones(2 * round(motion.rate / motion.cutoff) + 1)
            stands = np.convolve(stands, smeared, "same") > 0.5
        ends = np.flatnonzero(np.diff(np.r_[False, apart & ~stands, False])).reshape(-1, 2)
        shortest, longest = 8, 200  # samples; angle and speed at the begin take two
        self._spans = [
            slice(begin, min(begin + longest, last))
            for first, last in ends
            for begin in range(first, last - shortest, longest)
        ]
        acceleration, noise = self._acceleration(actuator, {}), 0.0
        if of_motor:
            made, _, scale = balance.made(actuator, {})
            unit = actuator.motor.emf_constant * scale / actuator.motor.inertia
            noise = unit * white_noise(made)
        noise = math.hypot(noise, LEAST * float(np.abs(acceleration[apart]).max(initial=0.0)))
        # currents of a comparator make ripple of the angle between samples: white as well
        of_angle = max(motion.steps[side] / math.sqrt(12.0), white_noise(motion.recorded[side]))
        self._whitening = [
            _whitening(one.stop - one.start, of_angle, noise, motion.rate) for one in self._spans
        ]
        self._recorded = self._whitened(motion.recorded[side])
        self._noise = math.sqrt(max(0, self._recorded.size - 2 * len(self._spans)))
        # a crossing that is straight to the last digit shows no less than noise would
        self.size = max(float(np.linalg.norm(self._recorded)), self._noise)

    def _whitened(self, trace: np.ndarray) -> np.ndarray:
        """What of a trace (S,) is not straight in each crossing (K,), in standard deviations."""
        parts = [
            whitening @ trace[one]
            for one, whitening in zip(self._spans, self._whitening, strict=True)
        ]
        return np.concatenate([np.empty(0), *parts])

    def _acceleration(self, actuator: Any, values: Values | None) -> np.ndarray:
        """Means (S,) between samples, rad/s^2."""
        of_motor, of_output = self._balance.resistance(actuator, values)
        if self._of_motor:
            made = self._balance.torque(actuator, values) - of_motor
            return np.asarray(made / actuator.motor.inertia)
        return np.asarray(-of_output / actuator.transmission.output_inertia)

    def least(self, actuator: Any) -> float:
        """Share of the curved part that noise leaves."""
        return math.hypot(LEAST, self._noise / self.size)

    def left(self, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Angle by the twin less the recorded one (K,), in standard deviations."""
        acceleration = self._acceleration(actuator, values)
        angle = np.zeros(acceleration.size)
        for one in self._spans:
            speed = np.cumsum(acceleration[one])
            angle[one] = np.cumsum(speed - 0.5 * acceleration[one])
        return self._whitened(angle / self._balance.motion.rate**2) - self._recorded


def _whitening(count: int, of_angle: float, of_acceleration: float, rate: float) -> np.ndarray:
    """(n, n): makes noise of angles white, after any angle and speed at the begin are taken off."""
    speeds = np.tril(np.ones((count, count)))
    moved = of_acceleration / rate**2 * (np.cumsum(speeds, axis=0) - 0.5 * speeds)
    covariance = of_angle**2 * np.eye(count) + moved @ moved.T
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    straight = np.linalg.qr(root @ np.vander(np.arange(float(count)), 2))[0]
    return np.asarray(root - straight @ (straight.T @ root))


def _rests(twist: np.ndarray, pushed: np.ndarray, gap: float) -> np.ndarray:
    """(K,) of bool: whether twists (K,), rad, are of the face that is pushed."""
    # faces less than half of the gap apart are one: that pushed more often
    if not pushed.any() or pushed.all():
        return np.ones(len(twist), bool)
    low, high = float(np.median(twist[~pushed])), float(np.median(twist[pushed]))
    if high - low < 0.5 * gap:
        return np.asarray(pushed == (pushed.mean() > 0.5))
    return np.asarray((twist > 0.5 * (low + high)) == pushed)


def state_of(values: Values | None, actuator: Any) -> FaultState:
    """Physical magnitudes of faults by name, healthy where not named or none are given."""
    half_gap = 0.5 * actuator.transmission.backlash
    return FaultState(*plain(fault_state)(fault_vector(values or {}), half_gap))
