"""`simulate`: an actuator of any kind, a scenario and faults in, a recording out."""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import DivergedError, InputError, whole_number
from ematwin.models.base import Model, Progress, Values
from ematwin.models.comparison import one_candidate
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told


def of_twin(
    model: Model, actuator: Any, scenario: Scenario, values: Values, *, fidelity: str | None = None,
    sample_rate: float | None = None, step: float | None = None, noise: Noise | None = None,
    seed: int = 0, initial_position: float = 0.0, progress: Progress | None = None,
) -> Recording:  # fmt: skip
    """The response of the twin of a kind (`Model.respond`); arguments as in `ematwin.simulate`."""
    if step is not None or initial_position:
        raise InputError(
            f"The kind {model.kind} takes its step from its parameters and starts at its first "
            "command; leave step and initial_position out."
        )
    rate = model.rate_of(actuator) if sample_rate is None else sample_rate
    if not (0.0 < rate < math.inf and scenario.duration * rate >= 1.0 - 1e-9):
        raise InputError(
            f"A scenario of {scenario.duration:g} s cannot be sampled at {rate:g} Hz; give a "
            "positive rate that leaves at least two samples."
        )
    if scenario.load and not model.disturbed:
        constant = " and give a constant one with the faults" if "load" in values else ""
        raise InputError(
            f"Scenario {scenario.name} has a load over time, which the kind {model.kind} does "
            f"not take; leave the load out of the scenario{constant}."
        )
    time = np.arange(math.floor(scenario.duration * rate + 1e-9) + 1) / rate
    command, load = scenario.histories(time)
    inputs = {model.command: command}
    if model.load or (model.disturbed and scenario.load):
        inputs[model.disturbed] = load
    answer = model.respond(actuator, Recording(time, inputs), one_candidate(values), 1)
    channels = {**inputs, **{name: trace[0] for name, trace in answer.items()}}
    if progress is not None:
        progress(1.0)
    return recording_of(model, actuator, scenario, values, time, channels, noise=noise, seed=seed)


def recording_of(
    model: Model, actuator: Any, scenario: Scenario, values: Values, time: np.ndarray,
    channels: Mapping[str, np.ndarray], *, noise: Noise | None, seed: int,
    fidelity: str | None = None, **more: Any,
) -> Recording:  # fmt: skip
    """Simulated channels (S,) as a recording, as sensors show it; ``more`` for its provenance."""
    from ematwin import __version__

    form = fidelity or model.fidelities[0]
    if not all(np.isfinite(trace).all() for trace in channels.values()):
        at = f" at a step of {more['step_s']:.3g} s" if "step_s" in more else ""
        raise DivergedError(
            f"The {form} model of {actuator.name} diverged{at}; shorten its step, or check "
            "its parameters and the scenario."
        )
    provenance = {
        "source": "simulated", "model": form, "ematwin": __version__, "actuator": actuator.name,
        "actuator_fingerprint": actuator.fingerprint, "scenario": scenario.name,
        "faults": dict(values), "noise": None if noise is None else vars(noise).copy(),
        "seed": int(seed), **more,
    }  # fmt: skip
    units = {channel.name: channel.unit for channel in model.channels}
    found = Recording(time, channels, units=units, provenance=provenance)
    return model.sensed(found, actuator, values, noise, seed)


def simulate(
    model: str | None = None,
    scenario: Scenario | str | Path | None = None,
    faults: Mapping[str, float] | np.ndarray | Any | None = None,
    actuator: ParameterSet | str | Path | None = None,
    *,
    sample_rate: float | None = None,
    step: float | None = None,
    noise: Noise | float | str | None = None,
    seed: int = 0,
    initial_position: float = 0.0,
    also: Iterable[str] = (),
    progress: Callable[[float], None] | bool | None = None,
) -> Recording:
    """The response of an actuator with some faults to a scenario.

    Parameters
    ----------
    model : of the brushless actuator "reference" (three phases, about 1 us) or "monitor" (one
        phase, 50 us); other kinds have their twin. None takes the first of the kind
    scenario : a `Scenario`, the name of a shipped one, or a file; None takes the kind's default
    faults : a mapping of names to values (for the brushless actuator also `Faults` or a vector
        (8,)), or None for healthy
    actuator : of any kind, the name of a shipped one, or a TOML file; None takes the default
        brushless actuator
    sample_rate : float, Hz, of the recording; None takes the kind's
    step : float, s, of the model; None takes the actuator's
    noise : imperfections of the measurement: a `Noise`, or the share of white noise, such as 0.02
    seed : int, of the noise
    initial_position : float, rad on the output, at rest
    also : channels that are only given on request, such as voltage_a; `Model.on_request` lists
        them
    progress : True shows a bar, in a terminal or a notebook; else called with the share done, in
        [0, 1], now and then

    Returns
    -------
    Recording, with command, answer and what ``also`` asks for

    Raises
    ------
    InputError
        If an argument cannot be used.
    DivergedError
        If the simulation left the finite numbers.
    """
    chosen = load_actuator(actuator)
    kind = model_of(chosen)
    if model is not None and model not in kind.fidelities:
        raise InputError(
            f"There is no model {model!r} of the kind {kind.kind}; choose "
            f"{' or '.join(kind.fidelities)}."
        )
    if isinstance(faults, str) or (
        isinstance(faults, list | tuple) and any(isinstance(one, str) for one in faults)
    ):
        raise InputError(
            f'Faults are values by name, such as {{"friction": 0.25}}; received {faults!r}.'
        )
    whole_number(seed, "seed", 0)
    more = tuple(dict.fromkeys([also] if isinstance(also, str) else also))
    unknown = [name for name in more if name not in kind.on_request]
    if unknown:
        raise InputError(
            f"A simulation of the kind {kind.kind} cannot also give {unknown[0]}; "
            f"it can give {', '.join(kind.on_request) or 'nothing more'}."
        )
    with told(progress, "simulating") as tell:
        return kind.simulate(
            chosen, kind.load_scenario(scenario), kind.values_of(chosen, faults), fidelity=model,
            sample_rate=sample_rate, step=step, noise=Noise.of(noise), seed=seed,
            initial_position=initial_position, progress=tell, **({"also": more} if more else {}),
        )  # fmt: skip
