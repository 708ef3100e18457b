"""Parameters of a linear axis: carriage, friction, drive, sampled position controller.

The equations are in docs/linear-axis.md.

Friction is given by the geometric mean of both directions and the ratio of backward to forward: a
healthy screw has a ratio near one, and that is known far better than the friction itself.

Tolerances (`quantity`) are judgement: the accuracy of a data sheet or a similar axis for one that
was never measured. The gain of the drive has none, since all forces scale with it: a file that
doubts it states one. Drift is the change of friction with temperature and grease.
"""

import math
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from ematwin.errors import RecordError
from ematwin.models.parameter_set import ParameterSet, Section, quantity
from ematwin.models.sections import TwinSteps
from ematwin.numerics.linear_algebra import largest_share, spectral_radius
from ematwin.recordings.recording import Recording


class Carriage(Section):
    """What moves, with the inertia of motor and screw, as seen at the carriage."""

    mass: float = quantity("kg", "moving mass, rotors included", tolerance=0.5, gt=0)


class AxisFriction(Section):
    """Friction of screw, guide and motor, at the carriage."""

    coulomb: float = quantity(
        "N", "Coulomb friction, geometric mean of both directions", tolerance=1.0, drift=0.05, gt=0
    )
    coulomb_ratio: float = quantity(
        "", "Coulomb friction backward over forward", tolerance=0.5, gt=0
    )
    viscous: float = quantity(
        "N*s/m", "viscous friction, geometric mean of both directions",
        tolerance=1.0, drift=0.05, gt=0,
    )  # fmt: skip
    viscous_ratio: float = quantity(
        "", "viscous friction backward over forward", tolerance=0.5, gt=0
    )
    standstill_ratio: float = quantity(
        "", "dry friction at standstill over Coulomb friction", tolerance=2.0, gt=0
    )
    fading_speed: float = quantity(
        "m/s", "speed at which half of the difference to standstill is gone", tolerance=2.0, gt=0
    )


class AxisDrive(Section):
    """Amplifier and motor: force follows voltage."""

    gain: float = quantity("N/V", "force on the carriage for one volt", gt=0)
    response_time: float = quantity("s", "lag of the force behind the voltage", tolerance=2.0, gt=0)
    voltage_limit: float = quantity("V", "largest voltage that the controller gives", gt=0)
    offset: float = quantity("N", "constant force against positive motion, such as gravity")


class AxisController(Section):
    """Sampled cascade: position to speed to voltage."""

    position_gain: float = quantity("1/s", "speed demanded for a position error", gt=0)
    velocity_gain: float = quantity("V*s/m", "voltage for an error of the speed", gt=0)
    sample_time: float = quantity(
        "s", "time from one update of the voltage to the next", exact=True, gt=0
    )


class LinearAxis(ParameterSet):
    """One linear axis, all values in SI, at the carriage."""

    kind = "linear-axis"
    default = "emps"

    carriage: Carriage
    friction: AxisFriction
    drive: AxisDrive
    controller: AxisController
    steps: TwinSteps

    @model_validator(mode="after")
    def _step_resolves_the_controller(self) -> Self:
        self.steps.check(1e-6, self.controller.sample_time, "the sample time")
        return self

    @model_validator(mode="after")
    def _controller_is_stable(self) -> Self:
        if loop_radius(self) < 1.0:
            return self
        control, limit = self.controller, velocity_gain_limit(self)
        advice = (
            f"at that sample time and position gain the limit is {limit:.4g} V s/m"
            if limit > 1e-6 * control.velocity_gain
            else "at that sample time and position gain no velocity gain is stable: lower the "
            "position gain"
        )
        raise ValueError(
            f"the position loop is unstable with controller.velocity_gain "
            f"{control.velocity_gain:.4g} V s/m at a sample time of {control.sample_time:.4g} s; "
            f"{advice}"
        )

    def check_interval(self, recording: Recording) -> None:
        """Raise `RecordError` unless a recording is sampled with the controller."""
        sample_time = self.controller.sample_time
        if abs(recording.interval - sample_time) > 0.01 * sample_time:
            raise RecordError(
                f"{recording.name} is sampled every {recording.interval:.6g} s and the controller "
                f"of {self.name} every {sample_time:.6g} s; the twin needs one sample for each "
                "update of the controller. Record at that rate, or correct controller.sample_time."
            )


def loop_radius(actuator: Any, share: float = 1.0) -> float:
    """Largest magnitude of an eigenvalue of the loop, with a share of its velocity gain.

    The carriage is linear while it moves one way, with the states z = (q, v, u, q_-1, q_-2) at the
    samples; the less viscous direction decides. Zero-order hold: Franklin, Powell and Workman
    (1998), Digital Control of Dynamic Systems, section 4.3.
    """
    from scipy.linalg import expm  # here, for it takes long to import

    friction, drive, control = actuator.friction, actuator.drive, actuator.controller
    k_v, k_p, interval = share * control.velocity_gain, control.position_gain, control.sample_time
    ratio = max(friction.viscous_ratio, 1.0 / friction.viscous_ratio)
    # rates of q, v, u and the held output, and their transition over a sample time
    rates = np.zeros((4, 4))
    rates[0, 1] = 1.0
    rates[1, 1:3] = np.array([-friction.viscous / math.sqrt(ratio), drive.gain])
    rates[1] /= actuator.carriage.mass
    rates[2, 2:] = np.array([-1.0, 1.0]) / drive.response_time
    held = expm(rates * interval)
    loop = np.zeros((5, 5))
    loop[:3, :3] = held[:3, :3]
    output = np.array([-k_v * (k_p + 0.5 / interval), 0.0, 0.0, 0.0, k_v * 0.5 / interval])
    loop[:3] += np.outer(held[:3, 3], output)
    loop[3, 0] = loop[4, 3] = 1.0
    return spectral_radius(loop)


def velocity_gain_limit(actuator: Any) -> float:
    """The velocity gain, V s/m, below which the loop is stable at its sample time; 0 if none is."""
    share = largest_share(lambda share: loop_radius(actuator, share) < 1.0)
    return share * float(actuator.controller.velocity_gain)
