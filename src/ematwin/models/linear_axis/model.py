"""The linear axis as a `Model`: its only door to search, reports and commands."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import DivergedError, InputError
from ematwin.models.base import Demand, Law, Model, Progress, Signal, Values, simulated_provenance
from ematwin.models.comparison import Candidates
from ematwin.models.linear_axis.channels import CHANNELS
from ematwin.models.linear_axis.constants import FIXED
from ematwin.models.linear_axis.parameters import LinearAxis
from ematwin.models.linear_axis.unknowns import CONTRASTS, aliases, unknowns
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Alias, Contrast, Unknown
from ematwin.recordings.channel import Channel
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

COMPARED = ("voltage", "position_error")
_MISSED = 0.02  # share of a channel's spread that the twin leaves, and that weighs its residuals


class LinearAxisModel(Model):
    """Voltage-driven carriage on a screw under a sampled position loop; docs/linear-axis.md."""

    kind: ClassVar[str] = "linear-axis"
    title: ClassVar[str] = "voltage-driven carriage on a screw and sampled position loop"
    parameters: ClassVar[type[LinearAxis]] = LinearAxis
    channels: ClassVar[tuple[Channel, ...]] = CHANNELS
    command: ClassVar[str] = "reference"
    needs: ClassVar[tuple[str | tuple[tuple[str, ...], ...], ...]] = ("voltage", "position")
    # what the twin misses is counted once for each time that it is alike (comparison.py)
    model_error: ClassVar[float] = 1.5
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
    fixed: ClassVar[tuple[str, ...]] = FIXED
    short: ClassVar[Mapping[str, str]] = {"position_error": "error"}

    demands: ClassVar[tuple[Demand, ...]] = (
        Demand("travel", "m", ("reference", "position")),
        Demand("speed", "m/s", ("position",), is_rate=True),
        Demand("voltage", "V", ("voltage",)),
    )

    @property
    def outputs(self) -> tuple[str, ...]:
        """Voltage and position error; the position follows from these."""
        return COMPARED

    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """Friction, its asymmetry, and gains."""
        return unknowns(actuator)

    def aliases(self, actuator: Any, values: Values) -> list[Alias]:
        """Faults against the parameters that they multiply."""
        return aliases()

    def contrasts(self, actuator: Any) -> tuple[Contrast, ...]:
        """Asymmetry of all friction, which is known better than that of its parts."""
        return CONTRASTS

    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Voltage (V), position and position error (m) in closed loop, (B, S) arrays."""
        from ematwin.models.linear_axis.twin import closed_loop

        voltage, position = closed_loop(actuator, inputs, candidates, count)
        error = inputs.channels["reference"] - position
        return {"voltage": voltage, "position": position, "position_error": error}

    def noise(self, actuator: Any, recording: Recording) -> dict[str, float]:
        """What the twin leaves of voltage (V) and position error (m): 2 % of their spread."""
        return {
            name: _MISSED * float(recording.channels[name].std()) or 1.0
            for name in COMPARED
            if name in recording.channels
        }

    def compare(
        self, recording: Recording, actuator: Any, *, threads: int | None = None, **settings: Any
    ) -> Any:
        """A recording beside the twin in closed loop."""
        from ematwin.models.linear_axis.comparison import LinearAxisComparison

        self.check_channels(recording)
        return LinearAxisComparison(self, recording, actuator, threads)

    def check(self, recording: Recording, actuator: Any) -> list[str]:
        """Sampling, units, signs, and whether the controller is the one that was recorded."""
        from ematwin.models.linear_axis.plausibility import check_signals

        self.check_channels(recording)
        return check_signals(recording, actuator)

    def laws(self, recording: Recording, actuator: Any) -> list[Law]:
        """The controller gives the voltage that its inputs ask for."""
        from ematwin.models.linear_axis.plausibility import controller_law

        return [controller_law(recording, actuator)]

    def excitation(self, recording: Recording, actuator: Any) -> list[str]:
        """It has to move both ways."""
        from ematwin.models.linear_axis.plausibility import missing_motion

        return missing_motion(recording)

    def load_scenario(self, name_or_path: Any = None) -> Scenario:
        """A scenario whose command is in m and whose load, if any, are pulses in V."""
        return Scenario.load_file(name_or_path, self.scenarios(), ("m", "V"))

    def simulate(
        self,
        actuator: Any,
        scenario: Scenario,
        values: Values,
        *,
        fidelity: str | None = None,
        sample_rate: float | None = None,
        step: float | None = None,
        noise: Noise | None = None,
        seed: int = 0,
        initial_position: float = 0.0,
        progress: Progress | None = None,
    ) -> Recording:
        """The axis in closed loop, from rest at the first reference, sampled with the controller.

        The load of a scenario is a voltage over time that is added to the controller's output.

        Raises
        ------
        InputError
            If a step, a first position or another rate is asked for.
        DivergedError
            If the twin left the finite numbers.
        """
        interval = actuator.controller.sample_time
        if step is not None or initial_position:
            raise InputError(
                "A linear axis takes its step from its parameters and starts at its reference; "
                "leave step and initial_position out."
            )
        if sample_rate is not None and not math.isclose(sample_rate * interval, 1.0, rel_tol=1e-3):
            raise InputError(
                f"A linear axis is sampled with its controller, at {1.0 / interval:g} Hz, received "
                f"{sample_rate:g} Hz; leave the rate out, or change controller.sample_time."
            )
        samples = math.floor(scenario.duration / interval + 1e-9) + 1
        if samples < 2:
            raise InputError(
                f"A scenario of {scenario.duration:g} s is shorter than the sample time of "
                f"{interval:g} s; make it longer."
            )
        time = np.arange(samples) * interval
        reference, pulses = scenario.histories(time)
        inputs = {"reference": reference}
        if scenario.load:
            inputs["pulses"] = pulses
        one = {name: np.array([value]) for name, value in values.items()}
        answer = self.respond(actuator, Recording(time, inputs), one, 1)
        outputs = {name: trace[0] for name, trace in answer.items() if name != "position_error"}
        if not all(np.isfinite(trace).all() for trace in outputs.values()):
            raise DivergedError(
                f"The twin of {actuator.name} diverged; check its parameters and the scenario."
            )
        found = Recording(
            time,
            {**inputs, **outputs},
            units={channel.name: channel.unit for channel in self.channels},
            provenance=simulated_provenance(self, actuator, scenario, values, noise, seed),
        )
        if progress is not None:
            progress(1.0)
        if noise is None:
            return found
        # the position is read by an encoder: its noise is a share of the error, not of the travel
        seen = found.changed(position_error=reference - outputs["position"])
        channels = noise.apply(seen, np.random.default_rng(seed), COMPARED).channels
        return found.changed(
            voltage=channels["voltage"], position=reference - channels["position_error"]
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
