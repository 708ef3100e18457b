"""Torque balance of a recorded motion near rest, where friction gives before it slides.

The balance of `ematwin.models.bldc.balance.TorqueBalance`, at the samples that are none of its
own: around reversals. Dry friction of a mass that rests answers whatever acts, so that samples at
which either mass rests say nothing. What moves there, slides; or it leans on bristles (LuGre;
docs/models.md, "Truer forms"), whose deflection follows from the recorded angle alone,

    dz/dtheta = 1 - k sgn(dtheta) z/g,

solved exactly from sample to sample.
"""

import math
from itertools import accumulate
from typing import Any

import numpy as np

from ematwin.models.bldc.along_motion import Motion
from ematwin.models.bldc.balance import TorqueBalance
from ematwin.models.optional import Values
from ematwin.numerics.compile import loop
from ematwin.numerics.signals import white_noise

_RESTS = 0.005  # s without motion
_MOVES = 1e-5  # rad on the motor shaft, at least; bristles give a tenth of a milliradian and more
_SURELY = 5.0  # standard deviations of the noise of an angle
NEAR_REST_ERROR = 0.005  # share of the current by which the equation may imitate a parameter
_LEAST = 0.001  # of the recorded current: what simulators of other make differ by


@loop
def bristle_torque(angle, sliding, stiffness, delay):  # type: ignore[no-untyped-def]
    """Torque of bristles (S,), N m, along angles (S,).

    They slide at a torque (S,); ``delay`` (S,) is their damping over their stiffness, in samples.
    """
    found = np.zeros(angle.size)
    bent = 0.0  # torque of the deflection
    for n in range(1, angle.size):
        moved, before = angle[n] - angle[n - 1], bent
        slides = math.copysign(sliding[n], moved)
        if sliding[n] > 0.0:
            bent = slides + (bent - slides) * math.exp(-stiffness * abs(moved) / sliding[n])
        else:
            bent = 0.0
        found[n] = bent + delay[n] * (bent - before)
    return found


class NearRest:
    """The torque that a motion near rest needs beside the torque of recorded currents.

    Attributes
    ----------
    size : float, norm of the recorded current of these samples, A
    """

    def __init__(self, motion: Motion, balance: TorqueBalance) -> None:
        self._balance, self._rate = balance, motion.rate
        self._rests = np.zeros(motion.time.size, bool)
        for angle, spline in zip(balance.angles, (motion.motor, motion.output), strict=True):
            noise = white_noise(spline(motion.time))
            self._rests |= _rests(angle, max(_MOVES, _SURELY * noise), motion.rate)
        self._counts = ~(balance.slides | self._rests)
        self._counts[:2] = False
        current = 0.5 * np.einsum("sk,sk->s", motion.currents, motion.trapezoids)
        self.size = float(np.linalg.norm(balance.filtered(current)[self._counts]))

    def least(self, actuator: Any) -> float:
        """Share of the recorded current that noise leaves."""
        return math.hypot(_LEAST, self._balance.noise(int(self._counts.sum())) / self.size)

    def left(self, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Needed less made torque, as recorded current (K,), A."""
        own = actuator.presliding
        stiffness = (0.0, 0.0) if own is None else (own.motor_stiffness, own.output_stiffness)
        friction = np.zeros(self._rests.size)
        for angle, sliding, stiff in zip(
            self._balance.angles, self._balance.sliding(actuator, values), stiffness, strict=True
        ):
            moved = np.gradient(angle)
            if own is None:
                friction += sliding * np.sign(moved)
            else:
                fades = np.exp(-((moved * self._rate / own.stribeck_speed) ** 2))
                delay = own.damping * fades * self._rate / stiff
                friction += bristle_torque(angle, sliding, stiff, delay)
        missing = self._balance.missing(actuator, friction, values)
        missing[self._rests] = 0.0
        return self._balance.filtered(missing)[self._counts]


def _rests(angle: np.ndarray, play: float, rate: float) -> np.ndarray:
    """Samples (S,) of a stretch of `_RESTS` or longer within ``play`` (rad) to both sides."""
    pushed = np.array(list(accumulate(
        angle.tolist(), lambda at, now: min(max(at, now - play), now + play)
    )))  # fmt: skip
    window = np.ones(max(2, round(_RESTS * rate)))
    still = np.concatenate([[0.0], (np.diff(pushed) == 0.0).astype(float)])
    whole = np.convolve(still, window)[window.size - 1 : 1 - window.size] == window.size
    return np.convolve(whole, window) > 0.0
