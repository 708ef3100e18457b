"""Sections that several kinds have: steps, and optional ones of motors, friction and supply.

Stiffness and Stribeck speed of friction are in no catalogue: their tolerance of a factor of two is
judgement, as is the tolerance of torque ripple and of the resistance of supply and cable.
Catalogues of motors give the thermal resistance from winding to housing and the thermal time
constant of the winding; motors differ from them by how they are mounted, here by 30 %, which is
judgement.
"""

import math
from typing import TYPE_CHECKING, Any, ClassVar, Self

from pydantic import model_validator

from ematwin.errors import ParameterError
from ematwin.models.parameter_set import ParameterSet, Section, quantity


class Steps(Section):
    """Longest steps of the two models; what lies between two samples is divided evenly."""

    reference: float = quantity("s", "step of the reference model", exact=True, gt=0)
    monitor: float = quantity("s", "step of the monitor model", exact=True, gt=0)


# These set the grid of steps, which a batch shares: they cannot differ between candidates.
GRID = ("controller.sample_time", "steps.twin")


class TwinSteps(Section):
    """Fixed step of the twin."""

    twin: float = quantity("s", "step of the twin, at most", exact=True, gt=0)

    def within(self, interval: float) -> int:
        """How many make up an interval, s."""
        return max(1, math.ceil(interval / self.twin - 1e-9))

    def check(self, least: float, longest: float, why: str) -> None:
        """Raise ValueError unless the step lies between two limits, s."""
        if not least <= self.twin <= longest:
            raise ValueError(
                f"steps.twin must lie between {least:g} and {longest:.3g} s, {why}, received "
                f"{self.twin:.3g} s; change it"
            )


class Gear(Section):
    """A gear whose output has end stops, rad, to both sides of zero."""

    @model_validator(mode="after")
    def _travel_is_an_interval(self) -> Self:
        gear: Any = self
        if not gear.travel_low < 0.0 < gear.travel_high:
            raise ValueError(
                "travel_low must lie below zero and travel_high above, received "
                f"{gear.travel_low} and {gear.travel_high} rad; correct the end stops"
            )
        return self


class ServoParameters(ParameterSet):
    """A parameter set whose models can follow their steps."""

    if TYPE_CHECKING:  # a kind declares where in its file the section stands
        steps: Steps

    def largest_stable_step(self, model: str) -> float:
        """Longest step of a model for which its fastest mode neither grows nor rings, s."""
        raise NotImplementedError(f"{type(self).__name__} does not say what its models can follow")

    def check_step(self, model: str, step: float) -> None:
        """Raise `ParameterError` if ``step`` (s) is too long for this actuator, or absurd."""
        shortest = 1e-9  # s: nothing in an actuator is so fast; less is a slip of the unit
        longest = self.largest_stable_step(model)
        if shortest <= step <= longest * (1.0 + 1e-9):
            return
        shorten = "shorten it or correct the inertias, gains and stiffness"
        advice = shorten if step > longest else "correct it"
        raise ParameterError(
            f"the step of the {model} model must lie between {shortest:g} and "
            f"{longest:.3g} s for this actuator, received {step:.3g} s; {advice}"
        )

    @model_validator(mode="after")
    def _steps_are_stable(self) -> Self:
        for model, step in self.steps:
            self.check_step(model, step)
        return self


class TorqueRipple(Section):
    """Torque and EMF that vary alike with the angle of the rotor; left out, they do not.

    Slots and magnets that differ do so; commutation makes ripple without this section.
    """

    example: ClassVar[dict[str, float]] = {"share": 0.02, "cycles": 2, "phase": 0.0}

    share: float = quantity("", "amplitude, of the torque", tolerance=1.0, ge=0, lt=1)
    cycles: int = quantity("", "cycles in a turn of the motor", exact=True, ge=1)
    phase: float = quantity("rad", "angle of the sine where the motor stands at zero")


class Presliding(Section):
    """Friction that gives before it slides (LuGre); left out, it sticks without giving.

    Each side of the gear has its bristles, which bend up to the dry friction of that side.
    """

    example: ClassVar[dict[str, float]] = {
        "motor_stiffness": 100.0, "output_stiffness": 100.0, "damping": 0.01,
    }  # fmt: skip

    motor_stiffness: float = quantity(
        "N*m/rad", "stiffness of friction before it slides, motor side", tolerance=2.0, gt=0
    )
    output_stiffness: float = quantity(
        "N*m/rad", "stiffness of friction before it slides, output side, on the motor shaft",
        tolerance=2.0, gt=0,
    )  # fmt: skip
    damping: float = quantity(
        "N*m*s/rad", "damping of friction before it slides, on the motor shaft", ge=0
    )

    def longest_step(self, motor_inertia: float, output_inertia: float) -> float:
        """Longest step that follows the swing of either mass on its bristles, s."""
        swing = min(motor_inertia / self.motor_stiffness, output_inertia / self.output_stiffness)
        lightest = min(motor_inertia, output_inertia)
        return min(math.sqrt(swing), lightest / self.damping if self.damping > 0.0 else math.inf)


class StribeckPresliding(Presliding):
    """As `Presliding`; static friction, `Transmission.static_ratio` as high, falls with speed."""

    example: ClassVar[dict[str, float]] = {**Presliding.example, "stribeck_speed": 2.0}

    stribeck_speed: float = quantity(
        "rad/s", "motor speed at which 1/e of the excess of static friction is left",
        tolerance=1.0, gt=0,
    )  # fmt: skip


class WindingHeat(Section):
    """A winding that the recording warms; left out, its resistance stays as at the start."""

    example: ClassVar[dict[str, float]] = {"thermal_resistance": 1.5, "time_constant": 20.0}

    thermal_resistance: float = quantity(
        "K/W", "thermal resistance from winding to housing", tolerance=0.3, gt=0
    )
    time_constant: float = quantity(
        "s", "thermal time constant of the winding", tolerance=0.3, gt=0
    )  # fmt: skip

    @property
    def gain_per_watt(self) -> Any:
        """Share of its resistance that the winding gains by a steady loss of 1 W.

        Copper gains 0.00393 for each kelvin at 20 degrees Celsius (IEC 60028).
        """
        return 0.00393 * self.thermal_resistance


class Supply(Section):
    """A supply that sags under current; left out, its voltage is constant.

    It takes current back, as a battery does. `Drive.supply_voltage` is that without current.
    """

    example: ClassVar[dict[str, float]] = {"resistance": 0.2, "capacitance": 0.001}

    resistance: float = quantity("ohm", "of supply and cable", tolerance=1.0, ge=0)
    capacitance: float = quantity("F", "of the link at the bridge", ge=0)
