"""Parameters of a linear actuator: stepper motor, ball screw, nut, position loop.

The equations are in docs/ball-screw.md.

Tolerances (`quantity`) are two standard deviations of the factors in ``BallScrewModel.nominal``:
factor**2 - 1, at most 2. They are judgement: data sheets of screws and stepper drives hardly state
friction, lags and gains. No drift is stated: what changes
between runs shows in the scatter of healthy ones, which calibration needs anyway. Lead and supply
have no tolerance since all forces scale with them.
"""

from typing import Self

from pydantic import model_validator

from ematwin.models.parameter_set import ParameterSet, Section, quantity
from ematwin.models.sections import TwinSteps


class Screw(Section):
    """Ball screw, nut and guide."""

    lead: float = quantity("m", "travel of the nut in one turn", gt=0)
    backlash: float = quantity("m", "healthy play of the nut on the screw, full width", ge=0)
    friction_force: float = quantity(
        "N", "dry friction, extrapolated to standstill, no load", tolerance=2.0, gt=0
    )
    fading_speed: float = quantity(
        "m/s", "speed of the nut at which the falling friction would vanish", tolerance=1.25, gt=0
    )
    efficiency_opposing: float = quantity(
        "", "efficiency against an opposing load", tolerance=0.69, gt=0, le=1
    )
    efficiency_aiding: float = quantity(
        "", "efficiency with an aiding load", tolerance=0.21, gt=0, le=1
    )


class ScrewDrive(Section):
    """Motor and power stage, seen from the supply."""

    supply_voltage: float = quantity("V", "supply, times the efficiency of the drive", gt=0)
    idle_current: float = quantity("A", "current of the drive at rest", tolerance=2.0, ge=0)
    response_time: float = quantity(
        "s", "lag of the speed behind its reference", tolerance=2.0, gt=0
    )


class ScrewController(Section):
    """Sampled position loop."""

    position_gain: float = quantity(
        "1/s", "proportional gain, position to speed", tolerance=1.25, gt=0
    )
    integral_gain: float = quantity(
        "1/s^2", "integral gain, position to speed", tolerance=1.25, ge=0
    )
    sample_time: float = quantity(
        "s", "time from one update of the speed to the next", exact=True, gt=0
    )


class BallScrew(ParameterSet):
    """One ball-screw actuator, all values in SI, on the nut unless said otherwise."""

    kind = "ball-screw"
    default = "rm1605"

    screw: Screw
    drive: ScrewDrive
    controller: ScrewController
    steps: TwinSteps

    @model_validator(mode="after")
    def _step_resolves_the_lag(self) -> Self:
        longest = 0.5 * min(self.drive.response_time, self.controller.sample_time)
        self.steps.check(1e-6, longest, "half of the response time or of the sample time")
        return self
