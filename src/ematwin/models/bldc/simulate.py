"""Simulate a brushless actuator: over a scenario, or over a recorded command and load."""

import math
import zlib
from collections.abc import Mapping, Sequence

import numpy as np

from ematwin.errors import InputError
from ematwin.models.base import Progress
from ematwin.models.bldc.channels import UNITS
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.unknowns import FAULTS, HELD, UNKNOWNS
from ematwin.models.scenario import Scenario
from ematwin.recordings.recording import Recording

_MOST_SAMPLES = 10_000_000  # of a record: some 1 GB
_MOST_POINTS = 50_000_000  # of the inputs: some 2 GB
INPUT_INTERVAL = 1e-5  # s, at most, where steps are shorter
_WHOLE = 1e-6  # of a step: rounding
SLICE_STEPS = 1_000_000  # steps between two reports of progress: about 0.1 s


def simulate(
    fidelity: str, actuator: BldcActuator, scenario: Scenario, values: Mapping[str, float],
    rate: float, step: float, start: float, progress: Progress | None,
) -> tuple[np.ndarray, dict[str, np.ndarray], float]:  # fmt: skip
    """The response to a scenario; arguments as in `ematwin.models.servo.ServoModel.simulated`."""
    grid = TimeGrid(step, scenario.duration, rate)
    ratio = actuator.transmission.ratio
    command, load = scenario.histories(grid.time)
    k = np.array([values[name] for name in FAULTS])
    columns = simulated(
        fidelity, k, command * ratio, load / ratio, (0.0, 0.0, start * ratio, 0.0, start * ratio),
        actuator, grid, progress,
    )  # fmt: skip
    kept = slice(None, None, grid.decimation)
    channels = {"command": command[kept], "load": load[kept], **columns}
    return grid.time[kept], channels, grid.step


def simulated(
    model: str, faults: np.ndarray, command: np.ndarray, load: np.ndarray,
    start: Sequence[float] | np.ndarray, actuator: BldcActuator, grid: "TimeGrid",
    progress: Progress | None = None, count_offset: float = 0.5, first_sample: float = 0.0,
    integral: float = 0.0,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns (S,) of a trace of the "reference" or "monitor" model.

    Command and load are on the points of the grid, rad and N m on the motor shaft; ``start`` is a
    current (A), speed and angle of motor and output there. Counts begin at ``count_offset`` of a
    step, loops sample at ``first_sample`` (s); the speed loop's integral asks for ``integral``, A.
    """
    from ematwin.models.bldc import batch  # compiles, or loads what an earlier process compiled
    from ematwin.models.bldc.constants import kernel_constants, truer_constants
    from ematwin.models.bldc.monitor_step import MonitorState
    from ematwin.models.bldc.reference_step import ReferenceState, read_angle, started

    names: tuple[str, ...]
    further: tuple[object, ...]
    current, w_m, theta_m, w_o, theta_o = start
    if model == "reference":
        run, names = batch.reference_trace, batch.REFERENCE_COLUMNS
        truer = truer_constants(actuator, count_offset)
        loops = started(truer, actuator.motor, current, theta_m, w_m, first_sample, integral)
        further = truer, np.array(loops)
        phases = phases_of(current, actuator.motor.pole_pairs * theta_m)
        state = np.array(ReferenceState(*phases, w_m, theta_m, w_o, theta_o, 1.0, 0.0, 0.0, 0.0))
    else:
        run, names = batch.monitor_trace, batch.MONITOR_COLUMNS
        further = (None if actuator.shorted_turns is None else np.zeros(4),)
        state = np.array(MonitorState(current, w_m, theta_m, w_o, theta_o, 0.0, current))
    constants = kernel_constants(actuator)
    first = {
        "bus_voltage": actuator.drive.supply_voltage, "motor_position": theta_m,
        "motor_speed": w_m, "output_position": theta_o, "output_speed": w_o,
    }  # fmt: skip
    pieces = [np.array([[first.get(name, 0.0) for name in names]])]
    # In slices, so that a long simulation shows progress and can be interrupted.
    stride = grid.decimation * max(1, round(SLICE_STEPS / (grid.substeps * grid.decimation)))
    end = command.size - 1
    for left in range(0, end, stride):
        right = min(left + stride, end)
        part = slice(left, right + 1)
        pieces.append(run(
            faults, command[part], load[part], state, constants, grid.step, grid.substeps,
            grid.decimation, *further,
        ))  # fmt: skip
        if progress is not None:
            progress(right / end)
    trace = np.concatenate(pieces)
    found = {name: trace[:, n].copy() for n, name in enumerate(names) if name in UNITS}
    for name in ("output_position", "output_speed"):
        found[name] /= actuator.transmission.ratio
    if model == "reference" and (encoder := actuator.encoder) is not None:
        for side, size in (("motor", encoder.motor_step), ("output", encoder.output_step)):
            found[f"{side}_position"] = read_angle(found[f"{side}_position"], size, count_offset)
    return found


def phases_of(current: float, theta_e: float) -> tuple[float, float, float]:
    """Phase currents (A) of a current through the pair that conducts at an angle (rad)."""
    from ematwin.models.bldc.inverter import gate_signals
    from ematwin.models.bldc.motor import hall_sector
    from ematwin.numerics.compile import plain

    a, b, c = plain(gate_signals)(plain(hall_sector)(theta_e), current)
    return float(a), float(b), float(c)


def answer_step(actuator: BldcActuator, rate: float) -> float:
    """Step of answers that are compared, s, to a recording of so many samples a second.

    The file's step resolves the instants at which a comparator switches. A modulated voltage has
    none: behind a current loop a step 2.5 times as long changes currents by 0.03 %.
    """
    step = actuator.steps.reference
    if actuator.current_loop is None:
        return step
    longest = max(step, min(2.5 * step, actuator.largest_stable_step("reference")))
    spacing = 1.0 / (rate * math.ceil(1.0 / (rate * INPUT_INTERVAL) - _WHOLE))
    fewest, most = math.ceil(spacing / longest - _WHOLE), math.floor(spacing / step + _WHOLE)
    # else samples of the loop would come sooner or later than in the drive by a share of a step
    sampled = (actuator.current_loop.sample_time * n / spacing for n in range(fewest, most + 1))
    whole = (abs(steps - round(steps)) < _WHOLE for steps in sampled)
    return spacing / next((n for n, fits in enumerate(whole, fewest) if fits), fewest)


def reference_answer(
    recording: Recording, actuator: BldcActuator, values: Mapping[str, float], start: np.ndarray
) -> Recording:
    """Currents, voltages and positions at the samples of a recording; NaN where it diverged.

    Where within a step the counts of encoders begin is unknown: each candidate has another place,
    and the differences count as scatter of the reference.
    """
    key = [len(recording), *sorted((name, float(value)) for name, value in values.items())]
    drawn = zlib.crc32(repr(key).encode()) / 2.0**32
    actuator = actuator.with_arrays({name: x for name, x in values.items() if "." in name})
    rate, count = recording.sample_rate, len(recording)
    ratio, step = actuator.transmission.ratio, answer_step(actuator, rate)
    grid = TimeGrid(step, (count - 0.5) / rate, rate)
    time = np.arange(count) / rate
    load = np.zeros(count) if recording.load is None else recording.load
    # a command that was recorded late makes all of the twin late, and its load must be as late
    load = np.interp(grid.time - values.get("skew", 0.0), time, load)
    load = values.get("load_gain", 1.0) * load + values.get("load_offset", 0.0)
    faults = np.array([values.get(one.name, one.healthy) for one in UNKNOWNS])
    command = np.interp(grid.time, time, recording.command)
    columns = simulated(
        "reference", faults, command * ratio, load / ratio, start, actuator, grid,
        count_offset=drawn, first_sample=recording.first_sample,
        integral=values.get(HELD, 0.0),
    )  # fmt: skip
    return Recording(time, {"command": recording.command, **columns}, units=UNITS)


class TimeGrid:
    """Times of a simulation: the grid of the inputs, the step, and which points are samples."""

    def __init__(self, step: float, duration: float, rate: float) -> None:
        if duration * rate > _MOST_SAMPLES:
            raise InputError(
                f"A scenario of {duration:g} s at {rate:g} Hz makes {duration * rate:.3g} samples; "
                f"at most {_MOST_SAMPLES:g} can be kept. Sample slower or shorten the scenario."
            )
        interval = 1.0 / rate
        self.decimation = max(1, math.ceil(interval / max(INPUT_INTERVAL, step) - 1e-9))
        spacing = interval / self.decimation
        self.substeps = max(1, math.ceil(spacing / step - 1e-9))
        self.step = spacing / self.substeps
        samples = math.floor(duration * rate + 1e-9) + 1
        if samples < 2:
            raise InputError(
                f"A scenario of {duration:g} s has fewer than two samples at {rate:g} Hz; "
                "sample faster or extend it."
            )
        if (samples - 1) * self.decimation > _MOST_POINTS:
            raise InputError(
                f"A scenario of {duration:g} s has {(samples - 1) * self.decimation:.3g} steps of "
                f"{spacing:.3g} s; at most {_MOST_POINTS:g} can be kept. Shorten the scenario."
            )
        self.samples, self.rate = samples, rate
        self.time = np.arange((samples - 1) * self.decimation + 1) / (rate * self.decimation)
