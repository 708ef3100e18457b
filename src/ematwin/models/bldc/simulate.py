"""Simulate a brushless actuator: model, scenario and faults in, a `Recording` out."""

import math
from collections.abc import Callable, Collection

import numpy as np

from ematwin import __version__
from ematwin.errors import DivergedError, InputError, ParameterError
from ematwin.models.bldc.channels import ON_REQUEST, UNITS
from ematwin.models.bldc.faults import Faults
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Scenario
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

DEFAULT_SAMPLE_RATE = 20_000.0  # Hz
_MOST_SAMPLES = 10_000_000  # of a record: some 1 GB
_MOST_POINTS = 50_000_000  # of the inputs: some 2 GB
INPUT_INTERVAL = 1e-5  # s, at most, where steps are shorter
SLICE_STEPS = 1_000_000  # steps between two reports of progress: about 0.1 s
_STATE_OF = {
    "motor_position": "theta_m", "motor_speed": "w_m", "output_position": "theta_o",
    "output_speed": "w_o",
}  # fmt: skip


def simulate(
    model: str,
    scenario: Scenario,
    faults: Faults,
    actuator: BldcActuator,
    *,
    sample_rate: float = DEFAULT_SAMPLE_RATE,
    step: float | None = None,
    noise: Noise | None = None,
    seed: int = 0,
    initial_position: float = 0.0,
    also: Collection[str] = (),
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """The response of an actuator with some faults to a scenario.

    Arguments and errors as in `ematwin.simulate`. The reference model gives phase currents, the
    monitor model the signed equivalent current; both give positions and speeds of motor and output.
    Terminal voltages and the current of the supply, which the reference model has, are given on
    request.
    """
    if also and model != "reference":
        raise InputError(
            f"The {model} model has no {', '.join(also)}; take the reference model, or leave that "
            "out."
        )
    _check_start(initial_position, actuator)
    check_travel(scenario, actuator)
    grid = time_grid(actuator, model, scenario.duration, sample_rate, step)
    ratio = actuator.transmission.ratio
    command, load = scenario.histories(grid.time)
    start = initial_position * ratio
    columns = simulated(
        model, faults.vector, command * ratio, load / ratio, (0.0, start, 0.0, start), actuator,
        grid, progress,
    )  # fmt: skip
    if model == "reference":
        columns["bus_voltage"] = np.full_like(columns["bus_current"], actuator.drive.supply_voltage)
    for name in ON_REQUEST:
        if name not in also:
            columns.pop(name, None)
    columns["output_position"] /= ratio
    columns["output_speed"] /= ratio
    if not all(np.isfinite(column).all() for column in columns.values()):
        raise DivergedError(
            f"The {model} model diverged at a step of {grid.step:.3g} s; shorten the step."
        )
    kept = slice(None, None, grid.decimation)
    record = Recording(
        grid.time[kept],
        {
            "command": command[kept],
            "load": load[kept],
            **columns,
        },
        units=UNITS,
        provenance={
            "source": "simulated",
            "model": model,
            "ematwin": __version__,
            "actuator": actuator.name,
            "actuator_fingerprint": actuator.fingerprint,
            "scenario": scenario.name,
            "faults": faults.as_dict(),
            "initial_position_rad": float(initial_position),
            "step_s": grid.step,
            "noise": None if noise is None else vars(noise).copy(),
            "seed": int(seed),
        },
    )
    return record if noise is None else noise.apply(record, np.random.default_rng(seed))


def simulated(
    model: str,
    faults: np.ndarray,
    command: np.ndarray,
    load: np.ndarray,
    start: tuple[float, float, float, float],
    actuator: BldcActuator,
    grid: "TimeGrid",
    progress: Callable[[float], None] | None = None,
) -> dict[str, np.ndarray]:
    """Columns (S,) of a trace, on the motor shaft; the phases carry no current at first.

    Parameters
    ----------
    model : "reference" or "monitor"
    faults : (8,) array
    command, load : arrays on the points of the grid, rad and N m on the motor shaft
    start : speed and angle of the motor, those of the output, on the motor shaft
    actuator, grid
    progress : called with the share done
    """
    from ematwin.models.bldc import batch  # compiles, or loads what an earlier process compiled
    from ematwin.models.bldc.constants import kernel_constants, truer_constants
    from ematwin.models.bldc.monitor_step import MonitorState
    from ematwin.models.bldc.reference_step import ReferenceState
    from ematwin.models.bldc.truer.state import REST

    rest: ReferenceState | MonitorState
    names: tuple[str, ...]
    further: tuple[object, ...]
    w_m, theta_m, w_o, theta_o = start
    if model == "reference":
        run, names = batch.reference_trace, batch.REFERENCE_COLUMNS
        truer = truer_constants(actuator)
        further = truer, None if truer is None else np.array(REST)
        rest = ReferenceState(0.0, 0.0, 0.0, w_m, theta_m, w_o, theta_o, 1.0, 0.0, 0.0, 0.0)
    else:
        run, names = batch.monitor_trace, batch.MONITOR_COLUMNS
        further = (None if actuator.shorted_turns is None else np.zeros(4),)
        rest = MonitorState(0.0, w_m, theta_m, w_o, theta_o, 0.0, 0.0)
    state = np.array(rest)
    constants = kernel_constants(actuator)
    first = [getattr(rest, _STATE_OF.get(name, ""), 0.0) for name in names]
    pieces = [np.array([first])]
    # In slices, so that a long simulation shows progress and can be interrupted.
    stride = grid.decimation * max(1, round(SLICE_STEPS / (grid.substeps * grid.decimation)))
    end = command.size - 1
    for left in range(0, end, stride):
        right = min(left + stride, end)
        part = slice(left, right + 1)
        pieces.append(
            run(
                faults,
                command[part],
                load[part],
                state,
                constants,
                grid.step,
                grid.substeps,
                grid.decimation,
                *further,
            )
        )
        if progress is not None:
            progress(right / end)
    trace = np.concatenate(pieces)
    return {name: trace[:, n].copy() for n, name in enumerate(names) if name in UNITS}


class TimeGrid:
    """Times of a simulation: the grid of the inputs, the step, and which points are samples.

    Inputs are known each 10 us or so and run in straight lines between; the reference model takes
    several steps from one grid point to the next.
    """

    def __init__(self, step: float, longest_interval: float, duration: float, rate: float) -> None:
        if duration * rate > _MOST_SAMPLES:
            raise InputError(
                f"A scenario of {duration:g} s at {rate:g} Hz makes {duration * rate:.3g} samples; "
                f"at most {_MOST_SAMPLES:g} can be kept. Sample slower or shorten the scenario."
            )
        interval = 1.0 / rate
        self.decimation = max(1, math.ceil(interval / longest_interval - 1e-9))
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


def time_grid(
    actuator: BldcActuator, model: str, duration: float, sample_rate: float, step: float | None
) -> TimeGrid:
    """The grid on which a model of this actuator is simulated.

    Raises
    ------
    InputError
        If the sample rate or the step cannot be used.
    """
    if not (math.isfinite(sample_rate) and sample_rate > 0.0):
        raise InputError(f"sample_rate must be a positive number of Hz, received {sample_rate}.")
    chosen = getattr(actuator.steps, model) if step is None else step
    try:
        actuator.check_step(model, chosen)
    except InputError as error:
        text = str(error)
        raise InputError(text[0].upper() + text[1:] + ".") from None
    return TimeGrid(chosen, max(INPUT_INTERVAL, chosen), duration, sample_rate)


def _check_start(position: float, actuator: BldcActuator) -> None:
    gear = actuator.transmission
    if not gear.travel_low <= position <= gear.travel_high:  # NaN fails this as well
        raise InputError(
            f"initial_position must lie within the travel of {actuator.name}, "
            f"{gear.travel_low:.4g} to {gear.travel_high:.4g} rad, received {position:g}."
        )


def check_travel(scenario: Scenario, actuator: BldcActuator) -> None:
    """Raise `ParameterError` if the command leaves the travel of the actuator."""
    time = np.linspace(0.0, scenario.duration, 2001)
    command, _ = scenario.histories(time)
    gear = actuator.transmission
    low, high = float(command.min()), float(command.max())
    if low < gear.travel_low or high > gear.travel_high:
        as_degrees = np.radians([low, high])
        fits = gear.travel_low <= as_degrees[0] and as_degrees[1] <= gear.travel_high
        hint = (
            "It looks like degrees; give radians or write the unit."
            if fits and max(-low, high) > 1.0
            else "Shorten the command."
        )
        raise ParameterError(
            f"The command of scenario {scenario.name} reaches {low:.4g} to {high:.4g} rad, beyond "
            f"the end stops of {actuator.name} at {gear.travel_low:.4g} and "
            f"{gear.travel_high:.4g} rad. {hint}"
        )
