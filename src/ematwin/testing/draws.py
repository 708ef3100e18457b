"""Draws of the contract of models: candidates, faults, other actuators of a kind."""

import math
from functools import cached_property

import numpy as np

from ematwin.errors import ParameterError
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
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

    def by_name(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Rows (B, d) of the searched unknowns as candidates."""
        return {one.name: rows[:, n].copy() for n, one in enumerate(self.searched)}

    def candidates(self, count: int) -> dict[str, np.ndarray]:
        """Values (B,) of all searched unknowns, the first healthy, the others near by."""
        shares = 0.2 * np.random.default_rng(1).random((count, len(self.searched)))
        shares[0] = 0.0
        return self.by_name(np.array([
            [towards(one, s) for one, s in zip(self.searched, row, strict=True)] for row in shares
        ]))  # fmt: skip

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

    def nuisances(self, random: np.random.Generator) -> dict[str, float]:
        """Nuisances as their priors have them."""
        found = {}
        for one in self.unknowns:
            if one.role == "nuisance" and one.spread is not None:
                off = one.spread * random.standard_normal()
                value = one.healthy * math.exp(off) if one.logarithmic else one.healthy + off
                found[one.name] = float(np.clip(value, one.lower, one.upper))
        return found

    def with_noise(self, recording: Recording, random: np.random.Generator) -> Recording:
        """The recording with white noise of 1 % of their RMS on the compared channels."""
        noisy = {}
        for name in self.model.outputs:
            values = recording.channels.get(name)
            if values is not None:
                noise = 0.01 * float(values.std()) * random.standard_normal(len(values))
                noisy[name] = values + noise
        return recording.changed(**noisy)


def towards(one: Unknown, share: float) -> float:
    """A value that lies a share of the way from healthy to the further bound."""
    up = one.upper - one.healthy >= one.healthy - one.lower
    return one.healthy + share * ((one.upper if up else one.lower) - one.healthy)


def at_most(count: int, rate: float) -> int:
    """Limit that a binomial number exceeds once in a thousand cases."""
    chances = [
        math.comb(count, k) * rate**k * (1.0 - rate) ** (count - k) for k in range(count + 1)
    ]
    return int(np.searchsorted(np.cumsum(chances), 1.0 - 1e-3))
