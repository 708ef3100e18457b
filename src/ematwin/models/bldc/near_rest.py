"""Friction near rest, by how likely it makes the motion that recorded currents drive.

Bristles bend before a mass slides (docs/models.md, "Truer forms"): at a reversal a motor is
elsewhere than with dry friction, by less than a count of most encoders. Equations along the
recorded motion leave such times out. The filter along the currents does not: each commutation, and
the angle of the output, shows all motion before.
"""

from functools import partial
from typing import Any

from ematwin.models.bldc.channels import phase_currents
from ematwin.models.bldc.forms import FADING, fadings
from ematwin.models.bldc.motion import Motion, has_motion
from ematwin.models.optional import Likelihood
from ematwin.recordings.recording import Recording

_LONG = 2.0  # s of a recording
_SPEEDS = tuple(0.7 * 2.0 ** (0.5 * n) for n in range(7))  # rad/s of the motor, of Stribeck's curve
_BENT = tuple(1e-3 * 2.0 ** (-0.5 * n) for n in range(8))  # rad of the motor, by static friction


def likelihood(recording: Recording, actuator: Any) -> Likelihood | None:
    """Of bristles, by the currents of the phases; None without them.

    One current is that of the phases where the motor's angle was recorded.
    """
    begin = float(recording.time[0])
    part = recording.between(begin, begin + _LONG)
    signed = phase_currents(part) is not None or part.motor_position is not None
    if not (signed and has_motion(part, actuator)):
        return None
    masses = Motion(part, actuator).driven()
    starts = partial(fadings, speeds=_SPEEDS, bent=_BENT)
    return Likelihood(FADING._replace(starts=starts), masses.log_densities, masses.samples)
