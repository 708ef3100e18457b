"""Simulate a brushless actuator: over a scenario, over a recorded motion, or sample by sample."""

import math
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.models.base import Progress
from ematwin.models.bldc import batch
from ematwin.models.bldc.channels import UNITS
from ematwin.models.bldc.constants import (
    Constants,
    FaultState,
    Truer,
    TruerState,
    fault_state,
    kernel_constants,
    truer_constants,
)
from ematwin.models.bldc.faults import FAULTS, FIXED, HELD, ZERO, fault_vector
from ematwin.models.bldc.inverter import gate_signals
from ematwin.models.bldc.monitor_step import (
    MonitorState,
    Pairs,
    looped_monitor_step,
    monitor_step,
    pairs_of,
)
from ematwin.models.bldc.motor import hall_sector
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.reference_step import (
    ReferenceState,
    last_reading,
    read_angle,
    reference_step,
    started,
)
from ematwin.models.scenario import Scenario
from ematwin.models.stepped import Stepped, initial_position
from ematwin.numerics.compile import part, plain
from ematwin.numerics.lanes import columns
from ematwin.recordings.recording import Recording

_MOST_SAMPLES = 10_000_000  # of a record: some 1 GB
_MOST_POINTS = 50_000_000  # of the inputs: some 2 GB
INPUT_INTERVAL = 1e-5  # s, at most, where steps are shorter
_WHOLE = 1e-6  # of a step: rounding
SLICE_STEPS = 1_000_000  # steps between two reports of progress: about 0.1 s
# where in the constants of `stepped` each part begins
_FAULT = len(Constants._fields)  # where it begins in the constants
_START = _FAULT + len(FaultState._fields)
_TRUER = _START + 1
_PAIRS = _TRUER + len(Truer._fields)
_READ = TruerState._fields.index("read")
_, read_truer, _ = columns(Truer)


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
    names: tuple[str, ...]
    further: tuple[object, ...]
    current, w_m, theta_m, w_o, theta_o = start
    if model == "reference":
        run, names = batch.reference_trace, batch.REFERENCE_COLUMNS
        truer = truer_constants(actuator, count_offset)
        loops = started(truer, actuator.motor, current, theta_m, w_m, first_sample, integral)
        further = truer, np.array(loops)
        phases = phases_of(current, actuator.motor.pole_pairs * theta_m)
        state = np.array([*phases, w_m, theta_m, w_o, theta_o, 1.0, *np.zeros(5)])
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
    a, b, c = plain(gate_signals)(plain(hall_sector)(theta_e), current)
    return float(a), float(b), float(c)


def answer_step(actuator: BldcActuator, rate: float) -> float:
    """Step of answers that are compared, s, at a sample rate, Hz."""
    # The file's step resolves the instants at which a comparator switches. A modulated voltage has
    # none: behind a current loop a step 2.5 times as long changes currents by 0.03 %.
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
    """Currents, voltages and positions at the samples of a recording; NaN if it diverged."""
    # Where within a step the counts of encoders begin is unknown: each candidate has another place,
    # and the differences count as scatter of the reference.
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
    faults = fault_vector(values)
    zero = values.get(ZERO, 0.0)
    command = np.interp(grid.time, time, recording.command) * ratio - zero
    if recording.motor_position is None:  # it stands where the output is
        start = start - zero * np.array([0.0, 0.0, 1.0, 0.0, 1.0])
    columns = simulated(
        "reference", faults, command, load / ratio, start, actuator, grid,
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


def stepped(actuator: BldcActuator, fidelity: str, rate: float) -> Stepped:
    """The actuator at rest, then sample by sample at a rate (Hz), currents as means since."""
    longest = getattr(actuator.steps, fidelity)
    grid = TimeGrid(longest, 2.0 / rate, rate)
    substeps = grid.substeps * grid.decimation

    def constants(candidates: Mapping[str, Any]) -> list[Any]:
        own = actuator.varied(candidates, FIXED)
        c = kernel_constants(own)
        fault = plain(fault_state)([candidates[name] for name in FAULTS], c.half_gap)
        pairs = plain(pairs_of)(fault, c) if fidelity == "monitor" else ()
        return [*c, *fault, candidates["initial_position"], *truer_constants(own), *pairs]

    make = _reference if fidelity == "reference" else _monitor
    return Stepped(
        inputs=("command", "load"), constants=constants, interval=1.0 / rate, substeps=substeps,
        starts=(initial_position(actuator),), **make(actuator, grid.step, substeps),
    )  # fmt: skip


def _monitor(actuator: BldcActuator, dt: float, substeps: int) -> dict[str, Any]:
    ratio, share = actuator.transmission.ratio, 1.0 / substeps
    looped = actuator.shorted_turns is not None
    loops = len(MonitorState._fields)
    total = loops + 4

    @part
    def begin(c, u, x):
        x[:, 0] = 0.0
        x[2, 0] = x[4, 0] = c[_START, 0] * ratio

    @part
    def sample(c, x, u, n, y):
        now = batch.read_state(x, 0)
        y[0, 0] = x[total, 0]
        y[1, 0], y[2, 0] = now.theta_m, now.w_m
        y[3, 0], y[4, 0] = now.theta_o / ratio, now.w_o / ratio
        x[total, 0] = 0.0

    @part
    def advance(c, x, u):
        own, fault = batch.read_constants(c, 0), batch.read_fault(c[_FAULT:], 0)
        now, command = batch.read_state(x, 0), u[0, 0] * ratio
        load = own.load_gain * (u[1, 0] / ratio) + own.load_offset
        if looped:
            now, after, _ = looped_monitor_step(
                now, batch.read_loops(x[loops:], 0), command, load, fault, own, dt
            )
            batch.write_loops(x[loops:], 0, after)
        else:
            pairs = batch.read_pairs(c[_PAIRS:], 0)
            now, _ = monitor_step(now, command, load, fault, pairs, own, dt)
        batch.write_state(x, 0, now)
        x[total, 0] += share * now.i

    return {
        "begin": begin, "sample": sample, "advance": advance, "at": (0.5, 0.5),
        "outputs": batch.MONITOR_COLUMNS[:5], "state_count": total + 1,
        "constant_count": _PAIRS + len(Pairs._fields),
    }  # fmt: skip


def _reference(actuator: BldcActuator, dt: float, substeps: int) -> dict[str, Any]:
    ratio, share = actuator.transmission.ratio, 1.0 / substeps
    more = len(ReferenceState._fields)
    total = more + len(TruerState._fields)

    @part
    def begin(c, u, x):
        x[:, 0] = 0.0
        start = c[_START, 0] * ratio
        x[4, 0] = x[6, 0] = start
        x[7, 0] = 1.0
        x[more + _READ, 0] = last_reading(read_truer(c[_TRUER:], 0), start, 0.0)

    @part
    def sample(c, x, u, n, y):
        now = batch.read_reference(x, 0)
        for m in range(3):
            y[m, 0] = x[total + m, 0]
            x[total + m, 0] = 0.0
        forms = read_truer(c[_TRUER:], 0)
        y[3, 0] = read_angle(now.theta_m, forms.motor_step, forms.count_offset)
        y[5, 0] = read_angle(now.theta_o, forms.output_step, forms.count_offset) / ratio
        y[4, 0], y[6, 0] = now.w_m, now.w_o / ratio

    @part
    def advance(c, x, u):
        own, fault = batch.read_constants(c, 0), batch.read_fault(c[_FAULT:], 0)
        now, command, load = batch.read_reference(x, 0), u[0, 0] * ratio, u[1, 0] / ratio
        now, after, means, _ = reference_step(
            now, batch.read_more(x[more:], 0), command, load, fault, own,
            read_truer(c[_TRUER:], 0), dt,
        )  # fmt: skip
        batch.write_reference(x, 0, now)
        batch.write_more(x[more:], 0, after)
        for m in range(3):
            x[total + m, 0] += share * means[m]

    return {
        "begin": begin, "sample": sample, "advance": advance, "at": (0.0, 0.0),
        "outputs": batch.REFERENCE_COLUMNS[:7], "state_count": total + 3,
        "constant_count": _PAIRS,
    }  # fmt: skip
