"""Simulated recordings of the twin of a kind, or of any of its models."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.errors import DivergedError, InputError
from ematwin.models.base import Model, Progress, Values
from ematwin.models.scenario import Scenario
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording


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
    one = {name: np.array([value]) for name, value in values.items()}
    answer = model.respond(actuator, Recording(time, inputs), one, 1)
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
