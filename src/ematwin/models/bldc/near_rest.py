"""Friction near rest, by how likely it makes the motion that recorded currents drive.

Bristles bend before a mass slides (docs/models.md, "Truer forms"): at a reversal a motor is
elsewhere than with dry friction, by less than a count of most encoders. Equations along the
recorded motion leave such times out. The filter along the currents does not: each commutation, and
the angle of the output, shows all motion before.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

from ematwin.models.bldc.channels import phase_currents
from ematwin.models.bldc.forms import FADING
from ematwin.models.bldc.motion import Motion, has_motion
from ematwin.models.optional import Likelihood, Values
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
    return Likelihood(FADING._replace(starts=_starts), masses.log_densities, masses.samples)


def _starts(actuator: Any) -> Sequence[Values]:
    motor, gear = actuator.motor, actuator.transmission
    return [
        {
            "presliding.motor_stiffness": gear.static_ratio * motor.friction_torque / bent,
            "presliding.output_stiffness": gear.static_ratio * gear.friction_torque / bent,
            "presliding.damping": 0.01,
            "presliding.stribeck_speed": speed,
        }
        for speed, bent in product(_SPEEDS, _BENT)
    ]
