"""Parameters of a linear axis: carriage, friction, drive, sampled position controller.

The equations are in docs/linear-axis.md.

Friction is given by the geometric mean of both directions and the ratio of backward to forward: a
healthy screw has a ratio near one, and that is known far better than the friction itself.

Tolerances (`quantity`) are judgement: the accuracy of a data sheet or a similar axis for one that
was never measured. The gain of the drive has none, since all forces scale with it: a file that
doubts it states one. Drift is the change of friction with temperature and grease.
"""

from typing import Self

from pydantic import model_validator

from ematwin.models.linear_axis.stability import check_stability
from ematwin.models.parameter_set import ParameterSet, Section, quantity

# These set the grid of steps, which a batch shares: they cannot differ between candidates.
FIXED = ("controller.sample_time", "steps.twin")


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


class AxisSteps(Section):
    """Fixed step of the model."""

    twin: float = quantity("s", "step of the model, at most", exact=True, gt=0)


class LinearAxis(ParameterSet):
    """One linear axis, all values in SI, at the carriage."""

    kind = "linear-axis"
    default = "emps"

    carriage: Carriage
    friction: AxisFriction
    drive: AxisDrive
    controller: AxisController
    steps: AxisSteps

    @model_validator(mode="after")
    def _step_resolves_the_controller(self) -> Self:
        sample_time = self.controller.sample_time
        if not 1e-6 <= self.steps.twin <= sample_time:
            raise ValueError(
                f"steps.twin must lie between 1e-6 s and the sample time of {sample_time:.3g} s, "
                f"received {self.steps.twin:.3g} s; change it"
            )
        return self

    @model_validator(mode="after")
    def _controller_is_stable(self) -> Self:
        check_stability(self)
        return self
