"""The linear axis as a `Model`: its only door to search, reports and commands."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ematwin.models.base import Demand, Law, Model, Signal, Values
from ematwin.models.comparison import Candidates
from ematwin.models.linear_axis.parameters import FIXED, LinearAxis
from ematwin.models.linear_axis.plausibility import check_signals, controller_law, missing_motion
from ematwin.models.unknown import Alias, Contrast, Unknown, multiple
from ematwin.recordings.channel import Channel, Derivation
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

COMPARED = ("voltage", "position_error")


class LinearAxisModel(Model):
    """Voltage-driven carriage on a screw under a sampled position loop; docs/linear-axis.md."""

    kind = "linear-axis"
    title = "voltage-driven carriage on a screw and sampled position loop"
    parameters = LinearAxis
    channels = (
        Channel("reference", "m", "commanded position of the carriage",
                ("qg", "command", "set_point", "setpoint", "demand")),
        Channel("voltage", "V", "output of the controller and input of the drive",
                ("vir", "control", "controller_output")),
        Channel("position", "m", "position of the carriage", ("qm", "carriage_position")),
        Channel("position_error", "m", "reference less position", ("following_error", "error"),
                derived=Derivation("reference - position", ("reference", "position"), np.subtract)),
        Channel("pulses", "V", "voltage that is added to the controller's output",
                ("pulses_n", "disturbance", "added_voltage"), may_rest=True),
    )  # fmt: skip
    command = "reference"
    disturbance = "pulses"
    needs = ("voltage", "position")
    nominal: ClassVar[Mapping[str, float]] = {
        "carriage.mass": 1.25,
        "friction.coulomb": 1.5,
        "friction.coulomb_ratio": 1.25,
        "friction.viscous": 1.5,
        "friction.viscous_ratio": 1.25,
        "friction.standstill_ratio": 1.75,
        "friction.fading_speed": 1.75,
        "drive.response_time": 1.75,
    }
    fixed = FIXED

    demands = (
        Demand("travel", "m", ("reference", "position")),
        Demand("speed", "m/s", ("position",), is_rate=True),
        Demand("voltage", "V", ("voltage",)),
    )

    @property
    def outputs(self) -> tuple[str, ...]:
        """Voltage and position error; the position follows from these."""
        return COMPARED

    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """Friction, its asymmetry, and gains, each as a factor on the healthy value.

        So calibration and drift apply to all alike.
        """
        ratio = "healthy ratio"
        return (
            multiple(actuator, "friction", "friction.coulomb",
                     "Coulomb friction of both directions", 0.25, 4.0),
            multiple(actuator, "viscous", "friction.viscous",
                     "viscous friction of both directions", 0.25, 4.0),
            multiple(actuator, "dry_asymmetry", "friction.coulomb_ratio",
                     "Coulomb friction backward over forward", 0.33, 3.0, ratio),
            multiple(actuator, "viscous_asymmetry", "friction.viscous_ratio",
                     "viscous friction backward over forward", 0.33, 3.0, ratio),
            multiple(actuator, "drive_gain", "drive.gain",
                     "force for a voltage (magnets, amplifier)", 0.5, 1.5),
            multiple(actuator, "position_gain", "controller.position_gain",
                     "gain of the position loop", 0.5, 1.5),
        )  # fmt: skip

    def aliases(self, actuator: Any, values: Values) -> list[Alias]:
        """Faults against the parameters that they multiply, and the scale of all forces.

        With gain, mass and friction multiplied by one factor, the carriage moves as before.
        """
        return [
            Alias("friction.coulomb", {"friction": 1.0}),
            Alias("friction.viscous", {"viscous": 1.0}),
            Alias("friction.coulomb_ratio", {"dry_asymmetry": 1.0}),
            Alias("friction.viscous_ratio", {"viscous_asymmetry": 1.0}),
            Alias(
                "drive.gain",
                {"carriage.mass": 1.0, "friction.coulomb": 1.0, "friction.viscous": 1.0},
            ),
            Alias("drive.gain", {"drive_gain": 1.0}),
            Alias("controller.position_gain", {"position_gain": 1.0}),
        ]

    def contrasts(self, actuator: Any) -> tuple[Contrast, ...]:
        """Asymmetry of all friction: its split into dry and viscous friction is vague."""
        return (
            Contrast(
                "asymmetry", {"dry_asymmetry": 0.5, "viscous_asymmetry": 0.5},
                "Friction backward over forward where half of it is viscous, as a multiple of the "
                "healthy ratio",
                "A constant force, as on an axis that is not level, looks like asymmetric Coulomb "
                "friction.",
            ),
        )  # fmt: skip

    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Voltage (V), position and position error (m) in closed loop, (B, S) arrays."""
        from ematwin.models.linear_axis.twin import closed_loop

        voltage, position = closed_loop(actuator, inputs, candidates, count)
        error = inputs.channels["reference"] - position
        return {"voltage": voltage, "position": position, "position_error": error}

    def stepped(self, actuator: Any, fidelity: str) -> Any:
        """The axis in closed loop, sample by sample."""
        from ematwin.models.linear_axis.twin import stepped

        return stepped(actuator)

    def noise(self, actuator: Any, recording: Recording) -> dict[str, float]:
        """Usual residual of voltage (V) and position error (m): 2 % of their spread."""
        known = (name for name in COMPARED if name in recording.channels)
        return {name: 0.02 * float(recording.channels[name].std()) or 1.0 for name in known}

    def compare(self, recording: Recording, actuator: Any, **settings: Any) -> Any:
        """A recording beside the twin in closed loop."""
        from ematwin.models.linear_axis.comparison import LinearAxisComparison

        self.check_channels(recording)
        return LinearAxisComparison(self, recording, actuator)

    def check(self, recording: Recording, actuator: Any) -> list[str]:
        """Sampling, units, signs, and whether the recorded controller is the stated one."""
        self.check_channels(recording)
        return check_signals(recording, actuator)

    def laws(self, recording: Recording, actuator: Any) -> list[Law]:
        """The controller gives the voltage that its inputs ask for."""
        return [controller_law(recording, actuator)]

    excitation = staticmethod(missing_motion)

    def rate_of(self, actuator: Any) -> float:
        """Sample rate of the controller, Hz."""
        return float(1.0 / actuator.controller.sample_time)

    def sensed(
        self, recording: Recording, actuator: Any, values: Values, noise: Noise | None, seed: int
    ) -> Recording:
        """Noise of the encoder is a share of the position error, not of the travel."""
        if noise is None:
            return recording.changed(position_error=None)
        channels = noise.apply(recording, np.random.default_rng(seed), COMPARED).channels
        position = channels["reference"] - channels["position_error"]
        return recording.changed(
            voltage=channels["voltage"], position=position, position_error=None
        )

    def summary(self, recording: Recording, actuator: Any) -> dict[str, float]:
        """RMS voltage (V), largest position error (m), largest force of the drive (N)."""
        channels = recording.channels
        voltage = channels["voltage"]
        error = channels["reference"] - channels["position"]
        return {
            "voltage_rms": float(np.sqrt(np.mean(voltage**2))),
            "position_error_largest": float(np.abs(error).max()),
            "force_largest": float(actuator.drive.gain * np.abs(voltage).max()),
        }

    def signals(self, recording: Recording, actuator: Any) -> list[Signal]:
        """Voltage, position with its reference, position error."""
        channels = recording.channels
        reference, position = channels["reference"], channels["position"]
        return [
            Signal("Voltage of the drive", "V", channels["voltage"]),
            Signal("Position of the carriage", "mm", 1e3 * position, 1e3 * reference),
            Signal("Position error", "um", 1e6 * (reference - position)),
        ]


MODEL = LinearAxisModel()
