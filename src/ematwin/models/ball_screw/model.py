"""The ball-screw actuator as a `Model`: its only door to search, reports and commands."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import RecordError
from ematwin.models import base
from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.models.base import Demand, Model, Reported, Signal, Values
from ematwin.models.comparison import Candidates, Comparison, TraceComparison
from ematwin.models.phases import calm
from ematwin.models.plausibility import check_travel_of
from ematwin.models.sections import GRID
from ematwin.models.unknown import Alias, Unknown
from ematwin.recordings.channel import Channel, Derivation
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

SENSORS = (0.03, 2e-4)  # A and m: standard deviations of a usual rig


class BallScrewMonitoring(base.Monitoring):
    """Features depend on the load; the coupling of the sensors is measured beside them."""

    def reported(self, model: Any, actuator: Any) -> tuple[Reported, ...]:
        """Magnitudes as multiples of healthy ones, backlash in mm, and roughness."""
        return (
            Reported("friction", "x", "dry friction, as a multiple of the healthy one",
                     True, named="lubrication"),
            Reported("backlash", "mm", "play of the nut on the screw",
                     scale=1e3, named="backlash"),
            Reported("gain", "x", "gain of the position loop, as a multiple of the healthy one",
                     True),
            Reported("roughness", "x", "roughness while moving, as a multiple of the healthy one: "
                     "fast swings of current and position that the twin does not explain, from one "
                     "turn of the screw upwards", True, named="spalling"),
        )  # fmt: skip

    def settling_time(self, actuator: Any) -> float:
        """Seconds until a transient of the position loop has died out."""
        return float(6.3 / actuator.controller.position_gain)

    def compare(
        self, model: Any, recording: Recording, actuator: Any, settling_time: float
    ) -> Comparison:
        """With the coupling of the sensors in steady motion, as the calibration defines it."""
        return model.compare(recording, actuator, settling_time=settling_time)

    def derived(self, features: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Roughness: the mean level of the fast bands of both residuals in steady motion."""
        bands = (" band 3, ", " band 4, ", " band 5, ")  # a turn of the screw, harmonics, balls
        steady = (name for name in features if name.endswith(", steady") and " rest" not in name)
        rough = [features[name] for name in steady if any(band in name for band in bands)]
        some = next(iter(features.values()))
        return {"roughness": np.column_stack(rough).mean(1) if rough else np.zeros_like(some)}


MONITORING = BallScrewMonitoring(
    covariate="load",
    statistics=(
        base.Statistic(
            "sensor_coupling", "A/m", "The sensors share fast noise differently than in the "
            "healthy runs", "Rewiring or reassembly can cause this, and so can rough running. The "
            "noise is removed from the current before the verdict.",
        ),
    ),
    short={"position_error": "error"},
)  # fmt: skip


class BallScrewModel(Model):
    """Stepper motor, ball screw, nut and a sampled position loop; docs/ball-screw.md."""

    kind = "ball-screw"
    title = "stepper motor, ball screw and sampled position loop"
    parameters = BallScrew
    channels = (
        Channel("set_point", "m", "commanded position of the nut",
                ("setpoint", "command", "demand", "reference")),
        Channel("position_error", "m", "set point less position", ("error", "following_error"),
                derived=Derivation("set_point - position", ("set_point", "position"), np.subtract)),
        Channel("position", "m", "position of the nut", ("nut_position", "output_position"),
                stands_in_for="position_error"),
        Channel("current", "A", "current of the drive, a magnitude",
                ("motor_current", "drive_current")),
    )  # fmt: skip
    command = "set_point"
    needs = ((("position_error",), ("position",)), "current")
    default_search = "levenberg-marquardt"
    # What a recording of current and position error can say something of, and how far (as a
    # factor, one standard deviation) the template may be off.
    nominal: ClassVar[Mapping[str, float]] = {
        "screw.friction_force": 2.0,
        "screw.fading_speed": 1.5,
        "screw.efficiency_opposing": 1.3,
        "screw.efficiency_aiding": 1.1,
        "drive.idle_current": 2.0,
        "drive.response_time": 2.0,
        "controller.position_gain": 1.5,
        "controller.integral_gain": 1.5,
    }
    fixed = GRID
    study = base.Study(noisy=True)
    monitoring = MONITORING

    demands = (
        Demand("travel", "m", ("set_point",)),
        Demand("speed", "m/s", ("set_point",), is_rate=True),
        Demand("current", "A", ("current",)),
    )

    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """Friction, backlash and gain; load and first error; roughness.

        Priors are wide enough to let a motion speak where it says anything.
        """
        play, force = float(actuator.screw.backlash), float(actuator.screw.friction_force)
        load = 2.0 * force
        return (
            Unknown("friction", "", "dry friction, as a multiple of the healthy one",
                    1.0, 0.05, 6.0, spread=2.0),
            Unknown("backlash", "m", "play of the nut on the screw",
                    play, 0.0, max(5e-3, 2.0 * play), spread=1e-3,
                    physical_unit="mm", physical=lambda _, value: 1e3 * value),
            Unknown("gain", "", "gain of the position loop, as a multiple of the healthy one",
                    1.0, 0.3, 3.0, spread=0.3),
            Unknown("load", "N", "load that pushes towards larger positions",
                    0.0, -load, load, "nuisance", spread=0.5 * force),
            Unknown("initial_error", "m", "position error at the first sample",
                    0.0, -5e-3, 5e-3, "nuisance", spread=2e-3),
            Unknown("roughness", "", "share of the moving current that swings with the turn of the "
                    "screw, from surface damage", 0.0, 0.0, 2.0, "symptom"),
        )  # fmt: skip

    def sensors(self, actuator: Any) -> tuple[Unknown, ...]:
        """None: their scatter is learnt with the healthy population."""
        return ()

    def aliases(self, actuator: Any, values: Values) -> list[Alias]:
        """Friction and gain against the parameters that they multiply."""
        return [
            Alias("screw.friction_force", {"friction": values.get("friction", 1.0)}),
            Alias(
                "controller.position_gain",
                {"gain": values.get("gain", 1.0), "controller.integral_gain": -1.0},
            ),
        ]

    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Current, A, and position error, m, (B, S) arrays."""
        from ematwin.models.ball_screw import twin  # compiles: only when needed
        from ematwin.numerics.compile import plain

        update, substeps = twin.steps_of(actuator, inputs.interval)
        constants = twin.ball_screw_constants(actuator, candidates, update, substeps)
        rest = plain(twin.ball_screw_at_rest)(inputs.set_point[0], constants)
        return twin.ball_screw_traces(
            inputs.set_point, None, constants, rest, inputs.interval, substeps, count=count
        )

    def stepped(self, actuator: Any, fidelity: str) -> Any:
        """The actuator sample by sample, from rest, the nut in the middle of its play."""
        from ematwin.models.ball_screw import twin
        from ematwin.models.stepped import stepped_of

        interval = actuator.controller.sample_time
        update, substeps = twin.steps_of(actuator, interval)
        return stepped_of(
            twin.ball_screw_traces, twin.ball_screw_at_rest,
            lambda candidates: twin.ball_screw_constants(actuator, candidates, update, substeps),
            inputs=("set_point",), interval=interval, substeps=substeps,
        )  # fmt: skip

    def noise(self, actuator: Any, recording: Recording) -> dict[str, float]:
        """Standard deviations of current (A) and position error (m), as on a usual rig."""
        return {"current": 0.05, "position_error": 2e-4}

    def compare(self, recording: Recording, actuator: Any, **settings: Any) -> Any:
        """A recording without the fast noise that its sensors share in steady motion.

        Noise in both channels of one sample at once is electrical, since an actuator needs time to
        answer. Its share changes when a rig is rewired. So it is measured on each motion
        (``statistics["sensor_coupling"]``, A/m) and taken out of the current; no verdict rests on
        it.
        """
        self.check_channels(recording)
        settling_time = settings.get("settling_time") or MONITORING.settling_time(actuator)
        current, error = recording.current, position_error(recording)
        steady = calm(recording.set_point, recording.interval, settling_time)
        share = coupling(current, error, steady)
        prepared = {"current": decoupled(current, error, share), "position_error": error}
        found = TraceComparison(self, recording, actuator, prepared)
        found.statistics = {"sensor_coupling": share}
        return found

    def starts(self, actuator: Any, recording: Recording) -> list[dict[str, float]]:
        """One for each direction of the load, from the position error at the first sample."""
        pull = 0.1 * actuator.screw.friction_force
        first = float(position_error(recording)[0])
        return [{"load": load, "initial_error": first} for load in (-pull, pull)]

    def check(self, recording: Recording, actuator: Any) -> list[str]:
        """Signs, units and dead channels."""
        self.check_channels(recording)
        check_signals(recording)
        return []

    def rate_of(self, actuator: Any) -> float:
        """Sample rate of the position loop, Hz."""
        return float(1.0 / actuator.controller.sample_time)

    def sensed(
        self, recording: Recording, actuator: Any, values: Values, noise: Noise | None, seed: int
    ) -> Recording:
        """With roughness, and the noise of a usual rig where none is asked for."""
        random, usual = np.random.default_rng(seed), SENSORS if noise is None else (0.0, 0.0)
        found = as_sensed(recording, actuator, values["roughness"], usual, random)
        return found if noise is None else noise.apply(found, random)

    def signals(self, recording: Recording, actuator: Any) -> list[Signal]:
        """Current and position error."""
        return [
            Signal("Current of the drive", "A", recording.channels["current"]),
            Signal("Position error", "mm", 1e3 * position_error(recording)),
        ]


def position_error(recording: Recording) -> np.ndarray:
    """Set point less position (S,), m, as recorded or from the position."""
    channels = recording.channels
    if "position_error" in channels:
        return channels["position_error"]
    return channels["set_point"] - channels["position"]


def check_signals(recording: Recording) -> None:
    """Raise `RecordError` if a channel has a wrong sign or unit, or is dead."""
    check_travel_of(recording, "set_point")
    name, set_point, current = recording.name, recording.set_point, recording.current
    error, mean = position_error(recording), float(current.mean())
    largest = float(np.abs(current).max())
    if largest > 2000.0:
        raise RecordError(
            f"{name}: current reaches {largest:.4g} A, which no such drive takes; its unit is "
            "probably mA. Put [mA] into the name of the channel."
        )
    if mean < 0.0:
        raise RecordError(
            f"{name}: its current is negative on average ({mean:.3g} A), where the magnitude that "
            "the drive takes is needed; change its sign."
        )
    if np.ptp(current) == 0.0:
        raise RecordError(
            f"{name}: its current never changes from {mean:.3g} A; the channel is dead."
        )
    travel = float(np.ptp(set_point))
    if travel == 0.0:
        return
    largest = float(np.abs(error).max())
    if largest > travel:
        raise RecordError(
            f"{name}: its position error reaches {largest:.4g} m, more than the travel; its unit "
            "is probably wrong, or a position was taken for an error."
        )
    start = int(np.argmax(np.abs(np.diff(set_point)) > 0.0))
    first = slice(start, start + max(8, error.size // 16))
    ahead = -float(error[first].mean() * np.sign(set_point[first][-1] - set_point[first][0]))
    if ahead > 0.3 * largest:
        raise RecordError(
            f"{name}: the nut runs ahead of its set point by {ahead:.3g} m when it starts: the "
            "position error has the wrong sign (set point less position is needed). Change it."
        )


def coupling(current: np.ndarray, position_error: np.ndarray, calm: np.ndarray) -> float:
    """Current (S,), A, per position error (S,), m, that their fast noise shares where ``calm``."""
    whole = calm[2:] & calm[1:-1] & calm[:-2]
    fast_current = np.diff(current, 2)[whole]
    fast_error = np.diff(position_error, 2)[whole]
    power = float(fast_error @ fast_error)
    return float(fast_current @ fast_error) / power if power > 0.0 else 0.0


def decoupled(current: np.ndarray, position_error: np.ndarray, share: float) -> np.ndarray:
    """The current (S,), A, without the fast noise that it shares with the position error."""
    if share == 0.0:
        return current
    from scipy.signal import butter, sosfiltfilt  # takes longer to import than a motion to judge

    high_pass = butter(2, 0.24, "high", output="sos")  # of the Nyquist frequency
    return np.asarray(current - share * sosfiltfilt(high_pass, position_error))


def as_sensed(
    clean: Recording, actuator: Any, roughness: float, noise: tuple[float, float],
    random: np.random.Generator,
) -> Recording:  # fmt: skip
    """A simulated motion with roughness and the noise (A, m) of its sensors.

    Roughness swings a share of the moving current once a turn of the screw and, half as much, with
    its second harmonic; the nut swings with it by the same share of a millimetre.
    """
    set_point, current, error = clean.set_point, clean.current, clean.position_error
    turns = (set_point - error) / actuator.screw.lead
    phase = random.uniform(0.0, 2.0 * np.pi, 2)
    swing = np.sin(2.0 * np.pi * turns + phase[0])
    swing += 0.5 * np.sin(4.0 * np.pi * turns + phase[1])
    moving = current - actuator.drive.idle_current
    current = current + roughness * moving * swing + random.normal(0.0, noise[0], current.size)
    error = error + roughness * 1e-3 * swing * (np.abs(np.gradient(set_point)) > 0.0)
    error = error + random.normal(0.0, noise[1], error.size)
    return clean.changed(current=np.abs(current), position_error=error)


MODEL = BallScrewModel()
