"""Simulate a PMSM servo: model, scenario and faults in, a `Recording` out; or sample by sample.

The drive has held its first position under the first load for a while before the first sample.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.models.base import Progress
from ematwin.models.pmsm import batch
from ematwin.models.pmsm.channels import ON_REQUEST, TERMINALS, to_phases
from ematwin.models.pmsm.comparison import SETTLED
from ematwin.models.pmsm.monitor_step import ControlState, MonitorState, monitor_step
from ematwin.models.pmsm.parameters import PmsmActuator
from ematwin.models.pmsm.reference_step import ReferenceState, applied_step, phase_currents
from ematwin.models.pmsm.unknowns import Constants, constants_of
from ematwin.models.scenario import Scenario
from ematwin.models.stepped import Stepped, initial_position
from ematwin.numerics.compile import part
from ematwin.numerics.side_by_side import by_candidate

_OUTPUTS = (
    "current_a", "current_b", "current_c", "voltage_a", "voltage_b", "voltage_c",
    "motor_position", "output_position",
)  # fmt: skip
_START = len(Constants._fields)
_PHASES = part(to_phases)


def simulate(
    fidelity: str, actuator: PmsmActuator, scenario: Scenario, values: Mapping[str, float],
    rate: float, step: float, start: float, progress: Progress | None,
) -> tuple[np.ndarray, dict[str, np.ndarray], float]:  # fmt: skip
    """The response to a scenario; arguments as in `ematwin.models.servo.ServoModel.simulated`."""
    tick, most = actuator.controller.current_time, 20_000_000
    each = 1.0 / (rate * tick)
    every = round(each)  # ticks from one sample to the next
    if every < 1 or abs(each - every) > 1e-6 * each:
        raise InputError(
            f"The drive samples at {1.0 / tick:g} Hz and keeps each n-th sample; a sample_rate of "
            f"{rate:g} Hz does not divide that. Give for example {0.5 / tick:g} Hz."
        )
    substeps = actuator.substeps(step)
    count = math.floor(scenario.duration / tick + 1e-9) // every * every + 1
    if count < every + 1:
        raise InputError(
            f"A scenario of {scenario.duration:g} s has fewer than two samples at "
            f"{1.0 / (every * tick):g} Hz; sample faster or extend it."
        )
    if count > most:
        raise InputError(
            f"A scenario of {scenario.duration:g} s has {count} samples of the current loops; at "
            f"most {most} can be simulated. Shorten it."
        )
    time = np.arange(count) * tick
    asked, carried = scenario.histories(time)
    held = actuator.whole_ticks(SETTLED, every)
    command = np.concatenate([np.full(held, start), asked])
    load = np.concatenate([np.full(held, carried[0]), carried])
    run = reference_columns if fidelity == "reference" else monitor_columns
    columns = run(actuator, values, command, load, start, substeps, every, progress)
    columns = {name: column[held // every :] for name, column in columns.items()}
    channels = {
        "command": asked[::every], "load": carried[::every], **channels_of(columns, actuator)
    }  # fmt: skip
    return time[::every], channels, tick / substeps


def quanta_of(actuator: PmsmActuator) -> np.ndarray:
    """(3,) steps of the current converters (A), of motor and output encoder (rad on the motor)."""
    drive = actuator.drive
    return np.array([
        2.0 * drive.current_range / 2**drive.current_bits,
        2.0 * math.pi / drive.motor_steps,
        2.0 * math.pi / drive.output_steps * actuator.transmission.ratio,
    ])  # fmt: skip


def reference_states(
    actuator: PmsmActuator, values: Mapping[str, float], theta: float, step: float
) -> tuple[Any, ReferenceState, ControlState, tuple[float, float, float]]:
    """Constants, the states of plant and drive at rest at an angle, and voltages at terminals."""
    c = Constants(*map(float, constants_of(actuator, values, step)))
    now = ReferenceState(*np.zeros(15))._replace(theta_m=theta, theta_o=theta)
    loops = ControlState(*np.zeros(9))._replace(before=theta + c.resolver / c.pole_pairs)
    return c, now, loops, (0.0, 0.0, 0.0)


def reference_columns(
    actuator: PmsmActuator, values: Mapping[str, float], command: np.ndarray, load: np.ndarray,
    start: float, substeps: int, every: int, progress: Progress | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns (ceil(K/every),) of the reference model, as its drive reads and commands them.

    Command and load (K,) are at the ticks of the current loops, rad and N m on the output, where
    ``start`` is the angle at rest; ``substeps`` make a tick, ``every`` ticks a sample.
    """
    ratio, ticks = actuator.transmission.ratio, np.array(actuator.ticks)
    step = actuator.controller.current_time / substeps
    c, *states = reference_states(actuator, values, start * ratio, step)
    # whole samples of all loops, so that a slice begins as the simulation does; some 20,000 ticks
    # between two reports of progress
    whole = math.lcm(*actuator.ticks, every)
    stride = whole * max(1, 20_000 // whole)
    pieces = []
    for first in range(0, command.size, stride):
        last = min(first + stride, command.size)
        more = slice(first, min(last + 1, command.size))  # the slice runs up to its successor
        rows, *states = batch.reference_trace(
            command[more] * ratio, load[more] / ratio, *states, c, step, substeps, ticks,
            quanta_of(actuator), every, last - first,
        )  # fmt: skip
        pieces.append(rows)
        if progress is not None:
            progress(last / command.size)
    trace = np.concatenate(pieces)
    wanted = (*batch.REFERENCE_COLUMNS[:7], *TERMINALS)
    return {name: trace[:, batch.REFERENCE_COLUMNS.index(name)].copy() for name in wanted}


def monitor_columns(
    actuator: PmsmActuator, values: Mapping[str, float], command: np.ndarray, load: np.ndarray,
    start: float, substeps: int, every: int, progress: Progress | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """As `reference_columns`, by the monitor model without its low-pass, with ideal sensors."""
    ratio, step = actuator.transmission.ratio, actuator.controller.current_time / substeps
    c, theta = constants_of(actuator, values, step), start * ratio
    read = theta + c.resolver / c.pole_pairs
    target = np.zeros((batch.COMPARED, command.size))

    def answers(measured: bool) -> dict[str, np.ndarray]:
        answer = np.empty((1, len(batch.ANSWERS), command.size))
        batch.monitor_scores(
            by_candidate(c, 1), command * ratio, load / ratio, 0,
            np.array([read, 0.0, theta, 0.0, 0.0, 0.0]), step, substeps, np.array(actuator.ticks),
            np.array([1.0, 0.0, 0.0, 0.0, 0.0]), target, np.zeros(batch.COMPARED), 1, measured,
            np.empty(1), answer,
        )  # fmt: skip
        return dict(zip(batch.ANSWERS, answer[0, :, ::every], strict=True))

    found, at_terminals = answers(False), answers(True)
    if progress is not None:
        progress(1.0)
    for side in ("motor", "output"):
        found[f"{side}_position"] = command[::every] * ratio - found.pop(f"{side}_error")
    angle = actuator.motor.pole_pairs * found["motor_position"]
    phases = to_phases(at_terminals["voltage_d"], at_terminals["voltage_q"], angle)
    return found | dict(zip(TERMINALS, phases, strict=True))


def channels_of(columns: Mapping[str, np.ndarray], actuator: PmsmActuator) -> dict[str, np.ndarray]:
    """All channels, from d and q, the motor's speed, and positions on the motor shaft."""
    angle = actuator.motor.pole_pairs * columns["motor_position"]
    found: dict[str, np.ndarray] = {}
    for quantity in ("current", "voltage"):
        phases = to_phases(columns[f"{quantity}_d"], columns[f"{quantity}_q"], angle)
        found |= {f"{quantity}_{x}": row for x, row in zip("abc", phases, strict=True)}
    found |= {n: columns[n] for n in (*ON_REQUEST, "motor_position")}
    found["output_position"] = columns["output_position"] / actuator.transmission.ratio
    return found


def stepped(actuator: PmsmActuator, fidelity: str) -> Stepped:
    """The servo, its drive holding a position, then tick by tick.

    Behind the state of the plant stand those of the loops, and the voltage vector that is applied.
    """
    tick, ratio = actuator.controller.current_time, actuator.transmission.ratio
    substeps = actuator.substeps(getattr(actuator.steps, fidelity))
    dt, (speed_ticks, position_ticks) = tick / substeps, actuator.ticks
    if fidelity == "reference":
        quanta, loops = tuple(quanta_of(actuator).tolist()), len(ReferenceState._fields)
        currents, plant_step = phase_currents, applied_step
        plant_of, write_plant = batch.read_reference, batch.write_reference
    else:
        quanta, loops = batch.PERFECT, len(MonitorState._fields)
        currents, plant_step = batch.monitor_currents, monitor_step
        plant_of, write_plant = batch.plant_of, batch.write_plant
    applied = loops + len(ControlState._fields)

    def constants(candidates: Mapping[str, Any]) -> list[Any]:
        return [*constants_of(actuator, candidates, dt), candidates["initial_position"]]

    @part
    def begin(c, u, x):
        own = batch.lane(c, 0)
        theta = c[_START, 0] * ratio
        x[:, 0] = 0.0
        x[6, 0] = x[8, 0] = theta
        x[loops + 3, 0] = theta + own.resolver / own.pole_pairs
        u[0, 0] = c[_START, 0]

    @part
    def sample(c, x, u, n, y):
        own, now, drive = batch.lane(c, 0), plant_of(x, 0), batch.loops_of(x[loops:], 0)
        x[applied, 0], x[applied + 1, 0] = drive.v_alpha, drive.v_beta
        after, seen, theta_m, theta_o = batch.read_by_drive(
            now, currents(now, own), drive, u[0, 0] * ratio, quanta,
            n % position_ticks == 0, n % speed_ticks == 0, speed_ticks, tick, own,
        )  # fmt: skip
        batch.write_loops(x[loops:], 0, after)
        angle = own.pole_pairs * theta_m
        y[0, 0], y[1, 0], y[2, 0] = _PHASES(seen.i_d, seen.i_q, angle)
        y[3, 0], y[4, 0], y[5, 0] = _PHASES(seen.v_d, seen.v_q, angle)
        y[6, 0] = theta_m
        y[7, 0] = theta_o / ratio

    @part
    def advance(c, x, u):
        own = batch.lane(c, 0)
        load = own.load_gain * (u[1, 0] / ratio) + own.load_offset
        after = plant_step(plant_of(x, 0), x[applied, 0], x[applied + 1, 0], load, own, dt)
        write_plant(x, 0, after)

    return Stepped(
        inputs=("command", "load"), outputs=_OUTPUTS, constants=constants, begin=begin,
        sample=sample, advance=advance, interval=tick, substeps=substeps, at=(0.0, 0.5),
        constant_count=_START + 1, state_count=applied + 2, starts=(initial_position(actuator),),
        held=actuator.whole_ticks(SETTLED),
    )  # fmt: skip
