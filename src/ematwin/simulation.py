"""Simulate an actuator: model, scenario and faults in, a `Record` out."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ematwin import __version__
from ematwin.errors import DivergedError, InputError
from ematwin.faults import Faults
from ematwin.plant.parameters import DEFAULT_ACTUATOR, Actuator
from ematwin.plant.scenario import DEFAULT_SCENARIO, Scenario
from ematwin.signals.noise import Noise
from ematwin.signals.record import Record

MODELS = ("reference", "monitor")
DEFAULT_SAMPLE_RATE = 20_000.0  # Hz
_MOST_SAMPLES = 10_000_000  # of a record: some 1 GB
_MOST_POINTS = 50_000_000  # of the inputs: some 2 GB
_SLICE_STEPS = 1_000_000  # steps between two reports of progress: about 0.1 s
_STATE_OF = {"motor_position": "theta_m", "output_position": "theta_o"}  # not zero at rest


def simulate(
    model: str = "reference",
    scenario: Scenario | str | Path = DEFAULT_SCENARIO,
    faults: Faults | Mapping[str, float] | np.ndarray | None = None,
    actuator: Actuator | str | Path = DEFAULT_ACTUATOR,
    *,
    sample_rate: float = DEFAULT_SAMPLE_RATE,
    step: float | None = None,
    noise: Noise | None = None,
    seed: int = 0,
    initial_position: float = 0.0,
    progress: Callable[[float], None] | None = None,
) -> Record:
    """The response of an actuator with some faults to a scenario.

    Parameters
    ----------
    model : "reference" (three phases, inverter, about 1 us) or "monitor" (one phase, 10 us)
    scenario : a `Scenario`, the name of a shipped one, or a file
    faults : `Faults`, a mapping of names to values, a vector (8,), or None for healthy
    actuator : an `Actuator`, the name of a shipped one, or a TOML file
    sample_rate : float, Hz, of the record
    step : float, s, of the model; None takes the actuator's
    noise : imperfections of the current measurement, or None
    seed : int, of the noise
    initial_position : float, rad on the output, at rest
    progress : called with the share done, in [0, 1], now and then

    Returns
    -------
    Record
        The reference model gives phase currents, the monitor model the signed equivalent current;
        both give positions and speeds of motor and output.

    Raises
    ------
    InputError
        If an argument cannot be used.
    DivergedError
        If the simulation left the finite numbers.
    """
    actuator = Actuator.load(actuator)
    scenario = Scenario.load_file(scenario)
    faults = Faults.of(faults)
    if model not in MODELS:
        raise InputError(f"There is no model {model!r}; choose {' or '.join(MODELS)}.")
    check_seed(seed)
    _check_start(initial_position, actuator)
    scenario.check(actuator)
    grid = time_grid(actuator, model, scenario.duration, sample_rate, step)
    ratio = actuator.transmission.ratio
    command, load = scenario.histories(grid.time)
    columns = _run(
        model, faults, command * ratio, load / ratio, initial_position * ratio, actuator, grid,
        progress,
    )  # fmt: skip
    columns["output_position"] /= ratio
    columns["output_speed"] /= ratio
    if not all(np.isfinite(column).all() for column in columns.values()):
        raise DivergedError(
            f"The {model} model diverged at a step of {grid.step:.3g} s; shorten the step."
        )
    kept = slice(None, None, grid.decimation)
    record = Record(
        time=grid.time[kept],
        command=command[kept],
        load=load[kept] if scenario.load else None,
        **columns,
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


def _run(
    model: str,
    faults: Faults,
    command: np.ndarray,
    load: np.ndarray,
    start: float,
    actuator: Actuator,
    grid: "TimeGrid",
    progress: Callable[[float], None] | None,
) -> dict[str, np.ndarray]:
    """Columns of the trace; command, load and start are on the motor shaft."""
    from ematwin.kernels import batch  # compiles, or loads what an earlier process compiled
    from ematwin.kernels.monitor_step import MonitorState
    from ematwin.kernels.reference_step import ReferenceState
    from ematwin.plant.constants import kernel_constants

    rest: ReferenceState | MonitorState
    names: tuple[str, ...]
    if model == "reference":
        run, names = batch.reference_trace, batch.REFERENCE_COLUMNS
        rest = ReferenceState(0.0, 0.0, 0.0, 0.0, start, 0.0, start, 1.0, 0.0, 0.0, 0.0)
    else:
        run, names = batch.monitor_trace, batch.MONITOR_COLUMNS
        rest = MonitorState(0.0, 0.0, start, 0.0, start)
    state = np.array(rest)
    constants = kernel_constants(actuator)
    first = [getattr(rest, _STATE_OF.get(name, ""), 0.0) for name in names]
    pieces = [np.array([first])]
    # In slices, so that a long simulation shows progress and can be interrupted.
    stride = grid.decimation * max(1, round(_SLICE_STEPS / (grid.substeps * grid.decimation)))
    end = command.size - 1
    for left in range(0, end, stride):
        right = min(left + stride, end)
        part = slice(left, right + 1)
        pieces.append(
            run(
                faults.vector,
                command[part],
                load[part],
                state,
                constants,
                grid.step,
                grid.substeps,
                grid.decimation,
            )
        )
        if progress is not None:
            progress(right / end)
    trace = np.concatenate(pieces)
    return {name: trace[:, n].copy() for n, name in enumerate(names) if not name.startswith("e_")}


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
                f"A scenario of {duration:g} s has no two samples at {rate:g} Hz; "
                "sample faster or prolong it."
            )
        if (samples - 1) * self.decimation > _MOST_POINTS:
            raise InputError(
                f"A scenario of {duration:g} s has {(samples - 1) * self.decimation:.3g} steps of "
                f"{spacing:.3g} s; at most {_MOST_POINTS:g} can be kept. Shorten the scenario."
            )
        self.time = np.arange((samples - 1) * self.decimation + 1) / (rate * self.decimation)


def time_grid(
    actuator: Actuator, model: str, duration: float, sample_rate: float, step: float | None
) -> TimeGrid:
    """The grid on which a model of this actuator is simulated.

    Raises
    ------
    InputError
        If the sample rate or the step cannot be used.
    """
    if not (math.isfinite(sample_rate) and sample_rate > 0.0):
        raise InputError(f"sample_rate must be a positive number of Hz, received {sample_rate}.")
    own = getattr(actuator.steps, model)
    chosen = own if step is None else step
    try:
        actuator.check_step(model, chosen)
    except InputError as error:
        text = str(error)
        raise InputError(text[0].upper() + text[1:] + ".") from None
    return TimeGrid(chosen, max(actuator.steps.monitor, chosen), duration, sample_rate)


def check_seed(seed: int) -> None:
    """Raise `InputError` unless ``seed`` is a whole number of at least 0."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"A seed must be a whole number of at least 0, received {seed!r}.")


def _check_start(position: float, actuator: Actuator) -> None:
    gear = actuator.transmission
    if not gear.travel_low <= position <= gear.travel_high:  # NaN fails this as well
        raise InputError(
            f"initial_position must lie within the travel of {actuator.name}, "
            f"{gear.travel_low:.4g} to {gear.travel_high:.4g} rad, received {position:g}."
        )
