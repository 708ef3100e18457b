"""The linear axis as a `Model`: its only door to search, reports and commands."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.base import Demand, Law, Model, Signal, Values
from ematwin.models.comparison import Candidates
from ematwin.models.linear_axis.parameters import LinearAxis
from ematwin.models.plausibility import check_enough, check_travel_of
from ematwin.models.sections import GRID
from ematwin.models.unknown import Alias, Contrast, Unknown, multiple
from ematwin.recordings.channel import Channel, Derivation
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

COMPARED = ("voltage", "position_error")
# each a factor on a healthy parameter, so that calibration and drift apply to all alike
FAULTS = (
    ("friction", "friction.coulomb", "Coulomb friction of both directions", 0.25, 4.0),
    ("viscous", "friction.viscous", "viscous friction of both directions", 0.25, 4.0),
    ("dry_asymmetry", "friction.coulomb_ratio", "Coulomb friction backward over forward",
     0.33, 3.0, "healthy ratio"),
    ("viscous_asymmetry", "friction.viscous_ratio", "viscous friction backward over forward",
     0.33, 3.0, "healthy ratio"),
    ("drive_gain", "drive.gain", "force for a voltage (magnets, amplifier)", 0.5, 1.5),
    ("position_gain", "controller.position_gain", "gain of the position loop", 0.5, 1.5),
)  # fmt: skip


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
    outputs = COMPARED  # the position follows from these
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
    fixed = GRID

    demands = (
        Demand("travel", "m", ("reference", "position")),
        Demand("speed", "m/s", ("position",), is_rate=True),
        Demand("voltage", "V", ("voltage",)),
    )

    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """Friction, its asymmetry, and gains."""
        return tuple(multiple(actuator, *one) for one in FAULTS)

    def sensors(self, actuator: Any) -> tuple[Unknown, ...]:
        """None: the recorded channels are those of its controller."""
        return ()

    def aliases(self, actuator: Any, values: Values) -> list[Alias]:
        """Faults against the parameters that they multiply, and the scale of all forces.

        With gain, mass and friction multiplied by one factor, the carriage moves as before.
        """
        forces = dict.fromkeys(("carriage.mass", "friction.coulomb", "friction.viscous"), 1.0)
        multiplied = [Alias(place, {name: 1.0}) for name, place, *_ in FAULTS]
        return [*multiplied[:4], Alias("drive.gain", forces), *multiplied[4:]]

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
        from ematwin.models.linear_axis.twin import follow

        found = follow(actuator, inputs, candidates, count)
        return {**found, "position_error": inputs.channels["reference"] - found["position"]}

    def stepped(self, actuator: Any, fidelity: str) -> Any:
        """The axis in closed loop, sample by sample, from rest at the first reference."""
        from ematwin.models.linear_axis import twin
        from ematwin.models.stepped import stepped_of

        interval = actuator.controller.sample_time
        return stepped_of(
            twin.axis_traces, twin.axis_at_rest, lambda k: twin.axis_constants(actuator, k),
            inputs=("reference", "pulses"), interval=interval,
            substeps=actuator.steps.within(interval),
        )  # fmt: skip

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
        actuator.check_interval(recording)
        return check_signals(recording, actuator) or check_controller(recording, actuator)

    def laws(self, recording: Recording, actuator: Any) -> list[Law]:
        """The controller gives the voltage that its inputs ask for."""
        return [controller_law(recording, actuator)]

    def excitation(self, recording: Recording, actuator: Any) -> list[str]:
        """Directions whose friction does not show."""
        steps = np.diff(recording.channels["reference"])
        moved = {"forward": steps[steps > 0.0].sum(), "backward": -steps[steps < 0.0].sum()}
        least = 1e-3 * float(np.ptp(recording.channels["reference"]))
        return [
            f"The reference never moves {way}, so that friction of that direction cannot be told. "
            "Use a command that goes there and back."
            for way, distance in moved.items()
            if distance <= least
        ]

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


def check_signals(recording: Recording, actuator: LinearAxis) -> list[str]:
    """Sentences on a motion that tells little; `RecordError` where units or signs are wrong."""
    name, channels = recording.name, recording.channels
    check_enough(recording)
    reference, position, voltage = (channels[n] for n in ("reference", "position", "voltage"))
    check_travel_of(recording, "reference")
    check_travel_of(recording, "position")
    if np.ptp(voltage) == 0.0:
        raise RecordError(
            f"{name}: its voltage never changes from {voltage[0]:.3g} V; the channel is dead."
        )
    limit = actuator.drive.voltage_limit
    largest = float(np.abs(voltage).max())
    pulse = float(np.abs(channels.get("pulses", np.zeros(1))).max())
    if largest > 1.05 * (limit + pulse):
        raise RecordError(
            f"{name}: its voltage reaches {largest:.4g} V where {actuator.name} is limited to "
            f"{limit:g} V; its unit is wrong, or drive.voltage_limit."
        )
    travel = float(np.ptp(reference))
    if travel == 0.0:
        return [f"The reference of {name} never moves; little can be told from it."]
    largest = float(np.abs(reference - position).max())
    if largest > travel:
        raise RecordError(
            f"{name}: its position is up to {largest:.4g} m away from the reference, more than the "
            "travel; one of the two has another unit, sign or origin."
        )
    return []


def check_controller(recording: Recording, actuator: LinearAxis) -> list[str]:
    """Whether the recorded voltage is the output of the controller for the recorded positions."""
    voltage = recording.channels["voltage"][2:]
    expected = controller_voltage(recording, actuator)[2:]
    size = float(np.linalg.norm(voltage))
    share = float(np.linalg.norm(voltage - expected)) / size
    if float(voltage @ expected) < -0.5 * size * float(np.linalg.norm(expected)):
        raise RecordError(
            f"{recording.name}: its voltage is opposite to what the controller gives for the "
            "recorded positions; change its sign, or that of reference and position."
        )
    if share <= 0.05:
        return []
    return [
        f"The recorded voltage differs by {100.0 * share:.0f} % from what the controller of "
        f"{actuator.name} gives for the recorded positions: its gains, its filter, the unit of a "
        "channel or voltages added to it are not as assumed, and the twin in closed loop will not "
        "follow this recording."
    ]


def controller_speed(recording: Recording, actuator: LinearAxis) -> np.ndarray:
    """Speed of the filtered position (S,), m/s; the first two samples repeat the third."""
    position = recording.channels["position"]
    slopes = (position[2:] - position[:-2]) / (2.0 * actuator.controller.sample_time)
    return np.r_[slopes[:1], slopes[:1], slopes]


def controller_voltage(recording: Recording, actuator: LinearAxis) -> np.ndarray:
    """Output of the controller for the recorded positions, (S,) array, V.

    k_v (k_p (q_ref - q) - dq_f/dt) + pulse, q_f the mean of the last two samples, within its limit.
    """
    channels, control = recording.channels, actuator.controller
    demand = control.position_gain * (channels["reference"] - channels["position"])
    output = control.velocity_gain * (demand - controller_speed(recording, actuator))
    limit = actuator.drive.voltage_limit
    return np.clip(output + channels.get("pulses", 0.0), -limit, limit)


def controller_law(recording: Recording, actuator: LinearAxis) -> Law:
    """The voltage is the output of the controller for the recorded positions, within its limit."""
    channels, control = recording.channels, actuator.controller
    limit = 0.99 * actuator.drive.voltage_limit

    def left(taken: Mapping[str, np.ndarray]) -> np.ndarray:
        (at, moves), put = taken["position"], taken["voltage"]
        demand = control.velocity_gain * control.position_gain * (taken["reference"] - at)
        slowed = control.velocity_gain * moves
        added = put - taken.get("pulses", 0.0) + slowed
        return np.where(np.abs(put) < limit, np.stack([added, demand, slowed]), 0.0)

    names = ("reference", "voltage", "position", "pulses")
    sources = {name: channels[name] for name in names if name in channels}
    sources["position"] = np.stack([channels["position"], controller_speed(recording, actuator)])
    text = "the controller does not give the recorded voltage for the recorded positions"
    # twice what a real axis leaves (docs/real-recordings.md)
    return Law(text, sources, left, 0.005 * float(np.sqrt(np.mean(channels["voltage"] ** 2))))


MODEL = LinearAxisModel()
