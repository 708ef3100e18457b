"""Actuators, faults and candidates that the contract of models draws, and what chance allows."""

import math
from collections.abc import Mapping

import numpy as np

from ematwin.errors import ParameterError
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.simulating import simulate
from ematwin.models.unknown import Unknown
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

PERFECT = Noise()  # a sensor without noise, where a kind would otherwise add that of a usual rig


def simulated(model: Model, actuator: ParameterSet, values: Mapping[str, float]) -> Recording:
    """The answer to the default scenario, without noise of sensors."""
    return simulate(None, None, dict(values), actuator, noise=PERFECT)


def searched(model: Model, actuator: ParameterSet) -> list[Unknown]:
    """Unknowns that a search may have free."""
    return [one for one in model.unknowns(actuator) if one.role in ("fault", "nuisance")]


def magnitudes(model: Model, actuator: ParameterSet) -> list[Unknown]:
    """Faults but directions."""
    return [one for one in model.faults(actuator) if one.direction_of is None]


def held(model: Model, actuator: ParameterSet) -> dict[str, float]:
    """Healthy values of these."""
    return {one.name: one.healthy for one in searched(model, actuator)}


def towards(one: Unknown, share: float) -> float:
    """A value that lies a share of the way from healthy to the further bound."""
    up = one.upper - one.healthy >= one.healthy - one.lower
    return one.healthy + share * ((one.upper if up else one.lower) - one.healthy)


def candidates(model: Model, actuator: ParameterSet, count: int) -> dict[str, np.ndarray]:
    """Values (B,) of all searched unknowns, the first healthy, the others near by."""
    unknowns = searched(model, actuator)
    random = np.random.default_rng(1)
    shares = 0.2 * random.random((count, len(unknowns)))
    shares[0] = 0.0
    rows = np.array([[towards(one, s) for one, s in zip(unknowns, row, strict=True)]
                     for row in shares])  # fmt: skip
    return by_name(unknowns, rows)


def unit(model: Model, actuator: ParameterSet, random: np.random.Generator) -> ParameterSet:
    """An actuator whose parameters are drawn within their tolerances."""
    drawn = {}
    for place, value, *_ in actuator.parameters():
        tolerance = actuator.tolerance(place)
        # as `uncertain` has it, but for what a kind leaves out by mistake
        factor = model.nominal.get(place) if tolerance is None else math.sqrt(1.0 + tolerance)
        if factor is not None and value > 0.0:
            drawn[place] = value * factor ** random.standard_normal()
    for _ in range(20):  # tries to find a unit whose parameters allow one another
        limited = {place: float(np.clip(x, *actuator.limits(place))) for place, x in drawn.items()}
        try:
            return actuator.changed(limited)
        except ParameterError:  # the parameters do not allow one another: a unit nearer to nominal
            drawn = {p: math.sqrt(x * actuator.value(p)) for p, x in drawn.items()}
    return actuator


def fault(one: Unknown, random: np.random.Generator) -> dict[str, float]:
    """A severity between a third and two thirds, by name."""
    return {one.name: towards(one, random.uniform(0.3, 0.7))}


def nuisances(
    model: Model, actuator: ParameterSet, random: np.random.Generator
) -> dict[str, float]:
    """Nuisances as their priors have them."""
    found = {}
    for one in model.unknowns(actuator):
        if one.role == "nuisance" and one.spread is not None:
            off = one.spread * random.standard_normal()
            value = one.healthy * math.exp(off) if one.logarithmic else one.healthy + off
            found[one.name] = float(np.clip(value, one.lower, one.upper))
    return found


def with_noise(model: Model, recording: Recording, random: np.random.Generator) -> Recording:
    """The recording with white noise of 1 % of their RMS on the compared channels."""
    noisy = {}
    for name in model.outputs:
        values = recording.channels.get(name)
        if values is not None:
            noise = 0.01 * float(values.std()) * random.standard_normal(len(values))
            noisy[name] = values + noise
    return recording.changed(**noisy)


def at_most(count: int, rate: float) -> int:
    """Limit that a binomial number exceeds once in a thousand cases."""
    chances = [
        math.comb(count, k) * rate**k * (1.0 - rate) ** (count - k) for k in range(count + 1)
    ]
    return int(np.searchsorted(np.cumsum(chances), 1.0 - 1e-3))


def by_name(unknowns: list[Unknown], rows: np.ndarray) -> dict[str, np.ndarray]:
    """Rows (B, d) as candidates."""
    return {one.name: rows[:, n].copy() for n, one in enumerate(unknowns)}
