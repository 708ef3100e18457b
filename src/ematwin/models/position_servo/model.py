"""The position servo as a `Model`: its only entry for search, reports and commands."""

import math
from statistics import median
from typing import Any

import numpy as np

from ematwin.models.base import Demand, Model, Signal
from ematwin.models.comparison import Candidates, TraceComparison
from ematwin.models.position_servo import recorded
from ematwin.models.position_servo.parameters import PositionServo, aliases, unknowns
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import by_candidate
from ematwin.recordings.recording import Recording


class PositionServoModel(Model):
    """Position of a geared DC servo with its controller inside; docs/position-servo.md."""

    kind = "position-servo"
    title = "geared DC servo with its position controller inside"
    parameters = PositionServo
    channels = recorded.CHANNELS
    command = "goal_position"
    outputs = ("position",)  # all else drives the twin
    needs = ("position",)
    sample_rate = 100.0
    compared_rate = 200.0
    recordings_differ = True
    fixed = ("steps.twin", "motor.rated_voltage")
    demands = (
        Demand("travel", "rad", ("goal_position", "position")),
        Demand("speed", "rad/s", ("position",), is_rate=True),
    )

    unknowns = staticmethod(unknowns)
    aliases = staticmethod(aliases)

    def sensors(self, actuator: Any) -> tuple[Unknown, ...]:
        """None: the recorded position is that of its controller."""
        return ()

    def noise(self, actuator: Any, recording: Recording) -> dict[str, Any]:
        """Standard deviation of each sample of the position, (S,) rad."""
        false = recorded.stretch(recording, actuator).false
        moved = recorded.smooth(recording, false, 0, len(recording))
        read, late = 0.004, 0.003  # rad; s, by which reads and goals on a bus come sooner or later
        # time that a target at its speed limit loses to a late goal stays lost until the goal turns
        lost = late * actuator.controller.speed_limit * recorded.limited(recording, actuator)
        noise = np.sqrt(read**2 + (late * moved.speed) ** 2 + lost**2)
        # at rest, or hunting within its play, it is off by one error: all samples count as one
        for a, b in recorded.rests(moved.position, actuator.gear.backlash, recording.interval):
            noise[a:b] *= math.sqrt(b - a)
        noise[false] = math.inf
        return {"position": noise}

    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Position (rad) of each candidate, (B, S) array."""
        from ematwin.models.position_servo.twin import servo_constants, traces

        given, rated = inputs.channels, actuator.motor.rated_voltage
        servo = recorded.with_stated_arm(inputs, actuator.varied(candidates, self.fixed))
        each = servo_constants(servo, candidates)
        constants = np.ascontiguousarray(by_candidate(each, count).T)
        supply = given.get("supply_voltage", np.full(len(inputs), rated)) / rated
        if "torque_enabled" in given:
            supply = np.where(given["torque_enabled"] > 0.5, supply, 0.0)
        position, goal = given.get("position"), given["goal_position"]
        # it rests where its first reads are, or at its goal
        first = goal[0] if position is None else median(position[:3])
        substeps = actuator.steps.within(inputs.interval)
        rows = traces(constants, goal, supply, float(first), inputs.interval, substeps)
        return {"position": rows}

    def stepped(self, actuator: Any, fidelity: str) -> Any:
        """The servo sample by sample."""
        from ematwin.models.position_servo.twin import stepped

        return stepped(actuator, self.unknown(actuator, "delay").upper, 1.0 / self.sample_rate)

    def compare(self, recording: Recording, actuator: Any, **settings: Any) -> TraceComparison:
        """The stretch of a recording with torque, beside the twin."""
        self.check_channels(recording)
        part = recorded.stretch(recording, actuator)
        if part.stop - part.first < len(recording):
            time = recording.time
            recording = recording.between(time[part.first], time[part.stop - 1])
        voltage, false = recorded.supply(recording, actuator)
        if false:
            recording = recording.changed(supply_voltage=voltage)
        return TraceComparison(self, recording, actuator)

    def check(self, recording: Recording, actuator: Any) -> list[str]:
        """What of a recording is not compared."""
        self.check_channels(recording)
        recorded.check_units(recording, actuator)
        return recorded.stretch(recording, actuator).said

    def excitation(self, recording: Recording, actuator: Any) -> list[str]:
        """Overload, and stretches that are too short."""
        return recorded.stretch(recording, actuator).obstacles

    def signals(self, recording: Recording, actuator: Any) -> list[Signal]:
        """Position with its goal, and the error between them."""
        goal, position = recording.channels["goal_position"], recording.channels["position"]
        return [
            Signal("Position of the output", "rad", position, goal),
            Signal("Goal less position", "rad", goal - position),
        ]


MODEL = PositionServoModel()
