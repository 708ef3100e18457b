"""Recordings of which everything is drawn from what `identify` assumes of it.

Faults, parameters, load and sensors of a recording come from the distributions that intervals and
probabilities rest on, so that both can be counted: an interval of 95 % that holds the truth in 80 %
of such recordings is wrong, whatever an actual rig is like.

``exact``    parameters and load are known, sensors are ideal but for their noise
``drifted``  parameters were learnt to 1 % and have drifted since as the kind says they may; load,
             current sensor and the clock of the command are off as the kind says they may be
``sheet``    only the data sheet is known: parameters are off by its tolerances; sensors as before
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from counted import MAGNITUDES, NOISE
from ematwin import simulate
from ematwin.errors import ParameterError
from ematwin.estimation.baseline import Baseline, uncertain, with_nuisances
from ematwin.estimation.prior import Prior
from ematwin.models.bldc.channels import PHASES, signed_current
from ematwin.models.bldc.faults import FAULTS, HEALTHY, POWER, nuisances
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.recording import Recording

SHEET = load_actuator("servo48")
KNOWLEDGE = ("exact", "drifted", "sheet")
LEARNT = 0.01  # standard deviation of the logarithm of a learnt parameter
_LEFT = 0.0035  # relative misfit of healthy recordings with this noise
_MARGINAL, _SLIGHT, _MIDDLING = 0.04, 0.1, 0.6  # shares of the range that faults are drawn from
_TRIES = 100


@dataclass(frozen=True)
class Known:
    """An actuator and what is known of it, as `identify` takes them."""

    actuator: BldcActuator
    baseline: Baseline


@dataclass(frozen=True)
class Drawn:
    """A recording with all that is behind it.

    Attributes
    ----------
    recording : Recording
    known : what `identify` is to be given as its actuator
    exact : and as its ``exact``
    faults, others : true values by name, of faults and of parameters, load and sensors
    """

    recording: Recording
    known: Any
    exact: bool
    faults: dict[str, float]
    others: dict[str, float]


def healthy(rng: np.random.Generator) -> dict[str, float]:
    """No fault."""
    return dict(zip(FAULTS, HEALTHY.tolist(), strict=True))


def box(rng: np.random.Generator) -> dict[str, float]:
    """Any values of the box, all equally likely: the prior of the intervals."""
    return dict(zip(FAULTS, rng.random(len(FAULTS)).tolist(), strict=True))


def middle(rng: np.random.Generator) -> dict[str, float]:
    """All faults at once, none of them near a bound."""
    return dict(zip(FAULTS, rng.uniform(0.1, 0.6, len(FAULTS)).tolist(), strict=True))


def mixture(rng: np.random.Generator) -> dict[str, float]:
    """Each fault with a probability of one half, of any size up to `_MIDDLING`."""
    return _some(rng, _MIDDLING)


def slight(rng: np.random.Generator) -> dict[str, float]:
    """The same up to `_SLIGHT`, five times what counts as a fault."""
    return _some(rng, _SLIGHT)


def marginal(rng: np.random.Generator) -> dict[str, float]:
    """The same up to `_MARGINAL`: most are just large enough to be faults, or not quite."""
    return _some(rng, _MARGINAL)


def flat(rng: np.random.Generator) -> dict[str, float]:
    """All faults at once, of any size up to `_SLIGHT`: near healthy, the prior of the intervals."""
    found = {name: _SLIGHT * rng.random() for name in MAGNITUDES}
    found["gain"] = 0.5 + 0.5 * found["gain"] * rng.choice([-1.0, 1.0])
    found["eccentricity_phase"] = rng.random()
    return {name: float(found[name]) for name in FAULTS}


POPULATIONS: Mapping[str, Callable[[np.random.Generator], dict[str, float]]] = {
    one.__name__: one for one in (healthy, box, middle, mixture, slight, marginal, flat)
}


def drawn(population: str, knowledge: str, fidelity: str, seed: int) -> Drawn:
    """A recording of a population, over the default command.

    Parameters
    ----------
    population : of `POPULATIONS`
    knowledge : of `KNOWLEDGE`
    fidelity : "monitor" or "reference": what is simulated
    seed : the same one gives the same faults, and the same actuator, whatever the fidelity
    """
    rng = np.random.default_rng([21, KNOWLEDGE.index(knowledge), seed])
    faults = POPULATIONS[population](rng)
    if knowledge == "exact":
        recording = simulate(fidelity, faults=faults, noise=NOISE, seed=seed)
        return Drawn(recording, SHEET, True, faults, {})
    known = Known(SHEET, _baseline(knowledge))
    true, others = _values(known, rng)
    recording = simulate(fidelity, faults=faults, actuator=true, noise=NOISE, seed=seed)
    return Drawn(_as_sensed(recording, others), known, False, faults, others)


def _some(rng: np.random.Generator, most: float) -> dict[str, float]:
    found = healthy(rng)
    for name in MAGNITUDES:
        size = most * rng.random()
        if rng.random() < 0.5:
            continue
        found[name] = 0.5 + 0.5 * size * rng.choice([-1.0, 1.0]) if name == "gain" else size
    found["eccentricity_phase"] = float(rng.random())
    return {name: float(value) for name, value in found.items()}


def _baseline(knowledge: str) -> Baseline:
    """What is known of the parameters before they drift."""
    if knowledge == "sheet":
        return Baseline.of_template(model_of(SHEET), SHEET)
    nominals = uncertain(model_of(SHEET), SHEET)
    mean = np.log([one.healthy for one in nominals])
    covariance = np.diag(np.full(len(nominals), LEARNT**2))
    prior = Prior(tuple(one.name for one in nominals), mean, covariance)
    return Baseline(prior, misfit=_LEFT, expected_misfit=_LEFT, recordings=3)


def _values(known: Known, rng: np.random.Generator) -> tuple[BldcActuator, dict[str, float]]:
    """An actuator and its sensors, from their joint prior; efficiencies above 1 drawn again."""
    sensors = [one for one in nuisances(SHEET) if one.name not in POWER]
    prior = with_nuisances(known.baseline.drifted(SHEET), sensors)
    root = np.linalg.cholesky(prior.covariance)
    for _ in range(_TRIES):
        z = prior.mean + root @ rng.standard_normal(len(prior.names))
        values = {
            name: math.exp(x) if "." in name else float(x)
            for name, x in zip(prior.names, z.tolist(), strict=True)
        }
        try:
            places = {name: value for name, value in values.items() if "." in name}
            return SHEET.changed(places), values
        except ParameterError:
            continue
    raise ParameterError(f"None of {_TRIES} actuators of this prior is possible; narrow it.")


def _as_sensed(recording: Recording, true: Mapping[str, float]) -> Recording:
    """The recording as sensors show it that are off, with the equivalent current of a drive."""
    channels, t = dict(recording.channels), recording.time
    current = signed_current(recording, SHEET.motor.pole_pairs)
    assert current is not None
    for name in PHASES:
        channels.pop(name, None)
    channels["current"] = true["current_gain"] * current + true["current_offset"]
    channels["load"] = (channels["load"] - true["load_offset"]) / true["load_gain"]
    channels["command"] = np.interp(t - true["skew"], t, channels["command"])
    units = {name: unit for name, unit in recording.units.items() if name in channels}
    return Recording(
        t, channels, units=units | {"current": "A"}, provenance=dict(recording.provenance)
    )
