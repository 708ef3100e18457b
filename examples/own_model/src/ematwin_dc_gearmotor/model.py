"""A brushed DC motor with a gearbox in a position servo, as ematwin sees it."""

import math
from typing import Any, ClassVar

import numpy as np

from ematwin.models.base import Candidates, Model
from ematwin.models.unknown import Unknown
from ematwin.recordings.channel import Channel
from ematwin.recordings.recording import Recording
from ematwin_dc_gearmotor.parameters import DcGearmotor


class DcGearmotorModel(Model):
    """Voltage, current and position of a DC gear motor that follows a commanded position."""

    kind = "dc-gearmotor"
    title = "brushed DC motor with a gearbox in a position servo"
    parameters = DcGearmotor
    command = "command"
    channels = (
        Channel("command", "rad", "commanded position of the output", ("cmd", "setpoint")),
        Channel("voltage", "V", "terminal voltage", ("u", "motor_voltage"), is_mean=True),
        Channel("current", "A", "motor current", ("i", "motor_current"), is_mean=True),
        Channel("position", "rad", "position of the output", ("output_position",), "output"),
    )
    needs = ("voltage", "current", "position")
    sample_rate = 1000.0
    # What healthy recordings can correct, and by what factor a template may be off. Of inertia and
    # friction only the sum of motor and gear is seen: one of the two is enough.
    nominal: ClassVar[dict[str, float]] = {
        "motor.resistance": 1.2,
        "motor.torque_constant": 1.1,
        "motor.friction_torque": 2.0,
        "motor.inertia": 1.2,
        "gear.backlash": 2.0,
        "drive.position_gain": 1.3,
        "drive.speed_gain": 1.3,
    }
    fixed = ("steps.twin",)

    def unknowns(self, actuator: DcGearmotor) -> tuple[Unknown, ...]:
        """Four faults, as multiples of healthy, and a load that nobody recorded."""
        return (
            Unknown("brushes", "", "resistance of armature and brushes", 1.0, 0.5, 5.0,
                    logarithmic=True, physical_unit="ohm",
                    physical=lambda a, k: a.motor.resistance * k),
            Unknown("magnets", "", "torque constant, less where magnets are weak", 1.0, 0.5, 1.5,
                    logarithmic=True, physical_unit="N m/A",
                    physical=lambda a, k: a.motor.torque_constant * k),
            Unknown("friction", "", "dry friction of motor and gear, on the output",
                    1.0, 0.2, 5.0, logarithmic=True, physical_unit="N m",
                    physical=lambda a, k: k * (a.gear.friction_torque
                                               + a.gear.ratio * a.motor.friction_torque)),
            Unknown("backlash", "", "play of the output", 1.0, 0.2, 10.0,
                    logarithmic=True, physical_unit="deg",
                    physical=lambda a, k: math.degrees(a.gear.backlash * k)),
            Unknown("load", "N m", "constant load against positive motion", 0.0, -1.0, 1.0,
                    "nuisance", spread=0.3),
        )  # fmt: skip

    def noise(self, actuator: DcGearmotor, recording: Recording) -> dict[str, float]:
        """What the twin misses and the sensors add, V, A and rad."""
        return {"voltage": 0.2, "current": 0.02, "position": 2e-3}

    def respond(
        self, actuator: DcGearmotor, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Voltage (V), current (A) and position (rad) of each candidate, (B, S) arrays."""
        from ematwin_dc_gearmotor.step import at_rest, traces  # compiles: only when needed

        values = {**self.healthy(actuator), **candidates}
        substeps = math.ceil(inputs.interval / actuator.steps.twin - 1e-9)
        constants = self.constants(actuator, values, substeps)
        start = inputs.command[0] if inputs.position is None else inputs.position[0]
        rest = at_rest.py_func(start, constants)
        return traces(inputs.command, None, constants, rest, inputs.interval, substeps, count=count)

    def constants(self, actuator: DcGearmotor, values: Candidates, substeps: int) -> Any:
        """Constants of the equations, numbers or (B,) arrays."""
        from ematwin_dc_gearmotor.step import Constants

        varied = actuator.varied(values, self.fixed)
        motor, gear, drive = varied.motor, varied.gear, varied.drive
        dry = motor.friction_torque + gear.friction_torque / gear.ratio
        friction = dry * values["friction"]
        return Constants(
            resistance=motor.resistance * values["brushes"],
            inductance=motor.inductance,
            torque_constant=motor.torque_constant * values["magnets"],
            inertia=motor.inertia + gear.inertia / gear.ratio**2,
            viscous_damping=motor.viscous_damping,
            friction=friction,
            static_friction=gear.static_ratio * friction,
            load=values["load"] / gear.ratio,
            half_gap=0.5 * gear.backlash * values["backlash"] * gear.ratio,
            ratio=gear.ratio,
            supply_voltage=drive.supply_voltage,
            current_limit=drive.current_limit,
            speed_limit=drive.speed_limit,
            position_gain=drive.position_gain,
            speed_gain=drive.speed_gain,
            share=1.0 / substeps,
        )

    def stepped(self, actuator: DcGearmotor, fidelity: str) -> Any:
        """The servo sample by sample, from rest at the first command: what `export-fmu` exports."""
        from ematwin.models.stepped import stepped_of
        from ematwin_dc_gearmotor.step import at_rest, traces

        interval = 1.0 / self.sample_rate
        substeps = math.ceil(interval / actuator.steps.twin - 1e-9)
        return stepped_of(
            traces, at_rest, lambda values: self.constants(actuator, values, substeps),
            inputs=("command",), interval=interval, substeps=substeps,
        )  # fmt: skip


MODEL = DcGearmotorModel()
