"""Optional sections of a brushless actuator: forms that most parameter files leave out.

Tolerances are judged as in `ematwin.models.bldc.parameters`. Sections that other kinds share are in
`ematwin.models.sections`.
"""

import math
from typing import Any, ClassVar, Self

from pydantic import model_validator

from ematwin.models.parameter_set import Section, quantity


class ShortedTurns(Section):
    """Shorted turns form a loop whose current brakes; without this section they are only missing.

    A contact between turns may be anything from a trace of carbon to a weld: its resistance is
    known within a factor of two at best.
    """

    example: ClassVar[dict[str, float]] = {"resistance": 0.1}

    resistance: float = quantity(
        "ohm", "resistance of the contact between the turns", tolerance=1.0, gt=0
    )


class Eccentricity(Section):
    """How the rotor is off centre; left out, the offset turns with the rotor."""

    example: ClassVar[dict[str, float]] = {"turning_share": 0.0}

    turning_share: float = quantity(
        "", "share of the offset that turns with the rotor; 0 is fixed in space", exact=True,
        ge=0, le=1,
    )  # fmt: skip


class Emf(Section):
    """Shape of the back-EMF; left out, a trapezoid with flats of 120 degrees."""

    example: ClassVar[dict[str, float]] = {
        "rounding": 0.3, "harmonic_5": 0.02, "harmonic_7": -0.01,
    }  # fmt: skip

    rounding: float = quantity(
        "", "share of a sine of the same mean torque in the trapezoid", exact=True, ge=0, le=1
    )
    harmonic_5: float = quantity(
        "", "fifth harmonic beyond that, over the flat of the trapezoid", default=0.0, ge=-1, le=1
    )
    harmonic_7: float = quantity(
        "", "seventh harmonic, likewise", default=0.0, ge=-1, le=1
    )  # fmt: skip


class Cogging(Section):
    """Cogging torque between magnets and teeth; left out, there is none."""

    example: ClassVar[dict[str, float]] = {"torque": 0.002, "cycles": 12, "phase": 0.0}

    torque: float = quantity("N*m", "amplitude on the motor shaft", tolerance=1.0, ge=0)
    cycles: int = quantity("", "cycles in a turn of the motor", exact=True, ge=1)
    phase: float = quantity("rad", "angle of the sine where the motor stands at zero")


class Loop(Section):
    """A sampled loop that answers with its next sample at the latest."""

    @model_validator(mode="after")
    def _answers_before_the_next_sample(self) -> Self:
        loop: Any = self
        if loop.delay > loop.sample_time:
            raise ValueError(
                f"delay must be at most sample_time, {loop.sample_time:g} s, received "
                f"{loop.delay:g} s; correct one of them"
            )
        return self


class SpeedLoop(Loop):
    """Integral term and sampling of the speed loop; left out, it is proportional and continuous.

    A simulation begins with a sample. A real recording begins anywhere between two.
    """

    example: ClassVar[dict[str, float]] = {
        "integral_gain": 0.5, "sample_time": 4e-5, "delay": 0.0,
    }  # fmt: skip

    integral_gain: float = quantity(
        "N*m/rad", "torque for each radian of integrated speed error", tolerance=0.4, ge=0
    )
    sample_time: float = quantity("s", "time between samples; 0 is continuous", exact=True, ge=0)
    delay: float = quantity(
        "s", "from a sample to the current that answers it, at most a sample time", exact=True, ge=0
    )


class CurrentLoop(Loop):
    """PI current loop with pulse-width modulation; left out, a comparator follows the demand.

    It controls the conducting pair: half of the difference of its currents, by the voltage across
    it. Its samples begin with those of the speed loop.
    """

    example: ClassVar[dict[str, float]] = {
        "proportional_gain": 7.0, "integral_gain": 12000.0, "sample_time": 5e-5, "delay": 0.0,
        "lost_voltage": 1.0,
    }  # fmt: skip

    proportional_gain: float = quantity(
        "V/A", "voltage across the pair for each ampere of error", tolerance=0.05, gt=0
    )
    integral_gain: float = quantity(
        "V/(A*s)", "voltage for each ampere second of integrated error", tolerance=0.1, ge=0
    )
    sample_time: float = quantity("s", "time between samples", exact=True, gt=0)
    delay: float = quantity(
        "s", "from a sample to the voltage that answers it, at most a sample time", exact=True, ge=0
    )
    lost_voltage: float = quantity(
        "V", "voltage across the pair that switches and their dead time take", tolerance=1.0, ge=0
    )


class Encoder(Section):
    """Encoders of motor and output, of whose steps the loops and recorded positions are made.

    The speed loop takes differences of the motor's angle over its sample time, and filters them.
    Left out, it knows angle and speed as they are.
    """

    example: ClassVar[dict[str, float]] = {
        "motor_steps": 10_000, "output_steps": 5_000_000, "filter_time": 0.0,
    }  # fmt: skip

    motor_steps: int = quantity("", "steps of the motor encoder in a turn", exact=True, ge=16)
    output_steps: int = quantity("", "steps of the output encoder in a turn", exact=True, ge=16)
    filter_time: float = quantity(
        "s", "time constant of the low-pass of the speed; 0 is none", tolerance=0.1, ge=0
    )

    @property
    def motor_step(self) -> float:
        """Step of the motor encoder, rad."""
        return 2.0 * math.pi / self.motor_steps

    @property
    def output_step(self) -> float:
        """Step of the output encoder, rad on the output."""
        return 2.0 * math.pi / self.output_steps


class Compliance(Section):
    """A gear that gives under torque; it takes the place of the contact.

    The monitor model keeps a rigid gear; the reference corrects its error.
    """

    example: ClassVar[dict[str, float]] = {"stiffness": 10.0, "damping": 0.005}

    stiffness: float = quantity(
        "N*m/rad", "stiffness of gear and contact on the motor shaft", tolerance=0.5, gt=0
    )
    damping: float = quantity(
        "N*m*s/rad", "damping of gear and contact on the motor shaft", tolerance=1.0, ge=0
    )
