"""Draws of the contract of models: candidates, faults, other actuators of a kind."""

import math
from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import binom

from ematwin.errors import ParameterError
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.sensors import as_sensed
from ematwin.models.simulating import simulate
from ematwin.models.unknown import Unknown
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

PERFECT = Noise()  # a sensor without noise, where a kind would otherwise add that of a usual rig


class Bench:
    """A model with one of its actuators."""

    def __init__(self, model: Model, actuator: ParameterSet) -> None:
        self.model, self.actuator = model, actuator
        self.unknowns = model.unknowns(actuator)
        self.searched = [one for one in self.unknowns if one.role in ("fault", "nuisance")]
        self.magnitudes = [one for one in model.faults(actuator) if one.direction_of is None]
        self.held = {one.name: one.healthy for one in self.searched}

    def simulated(self, **values: float) -> Recording:
        """The answer to the default scenario, without noise of sensors."""
        return simulate(None, None, values, self.actuator, noise=PERFECT)

    @cached_property
    def healthy(self) -> Recording:
        """The same of a healthy actuator."""
        return self.simulated()

    @cached_property
    def comparison(self) -> Comparison:
        """The healthy recording beside the twin."""
        return self.model.compare(self.healthy, self.actuator)

    def candidates(self, count: int) -> dict[str, np.ndarray]:
        """Values (B,) of all searched unknowns, the first healthy, the others near by."""
        shares = 0.2 * np.random.default_rng(1).random((count, len(self.searched)))
        shares[0] = 0.0
        return {one.name: towards(one, x) for one, x in zip(self.searched, shares.T, strict=True)}

    def unit(self, random: np.random.Generator) -> "Bench":
        """An actuator whose parameters are drawn within their tolerances."""
        drawn, own = {}, self.actuator
        for place, value, *_ in own.parameters():
            tolerance = own.tolerance(place)
            # as `uncertain` has it, but for what a kind leaves out by mistake
            factor = self.model.nominal.get(place)
            factor = factor if tolerance is None else math.sqrt(1.0 + tolerance)
            if factor is not None and value > 0.0:
                drawn[place] = value * factor ** random.standard_normal()
        for _ in range(20):  # tries to find a unit whose parameters allow one another
            limited = {place: float(np.clip(x, *own.limits(place))) for place, x in drawn.items()}
            try:
                return Bench(self.model, own.changed(limited))
            except ParameterError:  # one nearer to nominal
                drawn = {place: math.sqrt(x * own.value(place)) for place, x in drawn.items()}
        return self

    def as_recorded(self, recording: Recording, random: np.random.Generator) -> Recording:
        """The recording by sensors as their priors have them, with white noise of 1 % of its RMS.

        Of the compared channels.
        """
        known = {n: recording.channels[n] for n in self.model.outputs if n in recording.channels}
        drawn = nuisances(self.model.sensors(self.actuator), random)
        seen = as_sensed(
            {name: values[None] for name, values in known.items()},
            {name: np.array([value]) for name, value in drawn.items()},
            {name: float(np.abs(values).max()) for name, values in known.items()},
            recording.interval,
        )
        return recording.changed(**{
            name: x[0] + 0.01 * x.std() * random.standard_normal(x.size) for name, x in seen.items()
        })  # fmt: skip


def nuisances(unknowns: Iterable[Unknown], random: np.random.Generator) -> dict[str, float]:
    """Values of nuisances as their priors have them."""
    found = {}
    for one in unknowns:
        if one.role == "nuisance" and one.spread is not None:
            off = one.spread * random.standard_normal()
            value = one.healthy * math.exp(off) if one.logarithmic else one.healthy + off
            found[one.name] = float(np.clip(value, one.lower, one.upper))
    return found


def towards(one: Unknown, share: Any) -> Any:
    """A value that lies a share of the way from healthy to the further bound."""
    up = one.upper - one.healthy >= one.healthy - one.lower
    return one.healthy + share * ((one.upper if up else one.lower) - one.healthy)


def at_most(count: int, rate: float) -> int:
    """Limit that a binomial number exceeds once in a thousand cases."""
    return int(binom.ppf(1.0 - 1e-3, count, rate))
