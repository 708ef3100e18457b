"""Which faults a recording shows: the posterior of all sets of faults.

Beforehand each fault is absent with a probability of `1 - BEFOREHAND`, else anywhere in its range:
a spike and a slab (Mitchell and Beauchamp 1988, J. Am. Stat. Assoc. 83, 1023-1032). Near a minimum
in which everything is free, recording and priors together are a normal distribution (Laplace's
approximation). With the faults A that are not in a set held healthy, its integral over all else is
the evidence of the set S,

    w(S) ~ p(S) N(healthy_A; mean_A, covariance_AA) P(S within its bounds | A healthy)

in coordinates in which ranges are one. A set of parallel faults that a drift explains as well has
three slabs to pay for, and the drift only its prior: the smaller explanation is the more probable
one (MacKay 1992, Neural Computation 4, 415-447). Sets far less probable than the best one are left
out (Occam's window: Madigan and Raftery 1994, J. Am. Stat. Assoc. 89, 1535-1546).

Of several minima, each has the integral of the normal distribution there as its evidence
(`FaultSets.over`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ematwin.estimation.constants import BEFOREHAND, CERTAIN, SMALLEST
from ematwin.estimation.intervals import Draws
from ematwin.estimation.prior import coordinate
from ematwin.estimation.restricted_normal import RestrictedNormal
from ematwin.models.chart import Chart
from ematwin.models.unknown import Alias, Unknown

WINDOW = 7.0  # logarithm of the ratio of probabilities: sets below 0.1 % of the best are left out
_MOST = 300  # sets
_DRAWS = 8000
SEED = 20_201  # of draws
_FEWEST = 20.0  # draws that all together must be worth


@dataclass(frozen=True)
class FaultSet:
    """One explanation: some faults are there, the others are not.

    Attributes
    ----------
    faults : names of those that are there
    probability : float
    values : (N, d) array, draws of all unknowns
    undetermined : faults that may be anything; as likely there as not, and anywhere in draws
    """

    faults: frozenset[str]
    probability: float
    values: np.ndarray
    undetermined: frozenset[str] = frozenset()


@dataclass(frozen=True)
class FaultSets:
    """The posterior of sets of faults.

    Attributes
    ----------
    unknowns : (d,), in the order of the draws
    sets : the most probable one first; their probabilities sum to one
    distances : by fault, standard errors from healthy with all faults free
    log_evidence : logarithm of the integral over all sets, in units of the density at a point
    minima : probability of each minimum
    points : values (d,) of the answer at each minimum, in which improbable faults are healthy and
        all else explains what they did; none where draws were given
    """

    unknowns: tuple[Unknown, ...]
    sets: tuple[FaultSet, ...]
    distances: dict[str, float] = field(default_factory=dict)
    log_evidence: float = 0.0
    minima: tuple[float, ...] = (1.0,)
    points: tuple[np.ndarray, ...] = ()

    @classmethod
    def over(cls, minima: Sequence["FaultSets"], rises: Sequence[float]) -> "FaultSets":
        """The posterior over several minima, the best first.

        Parameters
        ----------
        minima : around each, by the density at its best point
        rises : how much less dense each best point is than the first, minus twice the logarithm
        """
        logs = np.array([one.log_evidence for one in minima]) - 0.5 * np.array(rises)
        shares = np.exp(logs - logs.max())
        shares /= shares.sum()
        sets = [
            replace(one, probability=share * one.probability)
            for share, found in zip(shares.tolist(), minima, strict=True)
            for one in found.sets
        ]
        sets.sort(key=lambda one: -one.probability)
        points = tuple(one for found in minima for one in found.points)
        return replace(minima[0], sets=tuple(sets), minima=tuple(shares.tolist()), points=points)

    @classmethod
    def of_draws(cls, unknowns: Sequence[Unknown], values: np.ndarray) -> "FaultSets | None":
        """The posterior from draws (N, d) for which all faults are there, somewhere in their range.

        A draw of a fault within `SMALLEST` of healthy stands for its absence, and counts by how
        much likelier that is beforehand than its share of the range. None where a few draws would
        outweigh all others, or no fault is among the unknowns.
        """
        found = cls(tuple(unknowns), ())
        if not found.faults:
            return None
        absent = np.column_stack([
            ~found._is_beyond(one, values, SMALLEST) for one in found.faults
        ])  # fmt: skip
        logs = absent @ np.log([_weight_of(one) for one in found.faults])
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        if 1.0 / float(weights @ weights) < _FEWEST:
            return None
        patterns, chosen = np.unique(absent, axis=0, return_inverse=True)
        sets = [
            FaultSet(
                frozenset(o.name for o, out in zip(found.faults, pattern, strict=True) if not out),
                float(weights[chosen.ravel() == n].sum()), values[chosen.ravel() == n],
            )
            for n, pattern in enumerate(patterns)
        ]  # fmt: skip
        return replace(found, sets=tuple(sorted(sets, key=lambda one: -one.probability)))

    def multiplied(self, alias: Alias, at: float) -> "FaultSets":
        """The same with the draws of what an unknown multiplies, which held for one value of it."""
        names = [one.name for one in self.unknowns]
        pivot = self.unknowns[names.index(alias.pivot)]
        moved = []
        for s in self.sets:
            values = s.values.copy()
            drawn = coordinate(pivot, values[:, names.index(alias.pivot)])
            away = drawn - coordinate(pivot, at)
            for n, one in enumerate(self.unknowns):
                grown = values[:, n] * (1.0 - alias.same.get(one.name, 0.0) * away)
                values[:, n] = np.clip(grown, one.lower, one.upper)
            moved.append(replace(s, values=values))
        return replace(self, sets=tuple(moved))

    @cached_property
    def probabilities(self) -> dict[str, float]:
        """By fault, the probability that it is as far from healthy as matters."""
        return self.beyond(SMALLEST)

    def beyond(self, share: float) -> dict[str, float]:
        """By fault, the probability that it is a share of its range from healthy, or more."""
        return {
            one.name: sum(s.probability * self._share(one, s, share) for s in self.sets)
            for one in self.faults
        }

    @cached_property
    def faulty(self) -> float:
        """The probability that any fault is as far from healthy as matters."""
        found = 0.0
        for s in self.sets:
            own = [one for one in self.faults if one.name in s.faults]
            healthy = 1.0
            if own:
                far = [self._is_beyond(one, s.values, SMALLEST) for one in own]
                healthy = 1.0 - float(np.mean(np.any(far, axis=0)))
            for one in self.faults:
                if one.name in s.undetermined:
                    healthy *= 1.0 - self._share(one, s, SMALLEST)
            found += s.probability * (1.0 - healthy)
        return found

    @property
    def faults(self) -> tuple[Unknown, ...]:
        """Magnitudes of faults."""
        return tuple(
            one for one in self.unknowns if one.role == "fault" and one.direction_of is None
        )

    def presence(self, name: str) -> float:
        """The probability of all sets with a fault."""
        return sum(
            s.probability * (BEFOREHAND if name in s.undetermined else name in s.faults)
            for s in self.sets
        )

    def is_improbable(self, name: str) -> bool:
        """Whether a fault is not there, with a probability of `CERTAIN`."""
        return self.presence(name) < 1.0 - CERTAIN

    @cached_property
    def drawn(self) -> Draws:
        """Draws over all sets."""
        return self._resampled(self.sets)

    def given(self, *names: str) -> Draws:
        """Draws over the sets with any of some faults; over all if there are none, or no faults."""
        own = [s for s in self.sets if s.probability > 0.0 and not s.faults.isdisjoint(names)]
        return self._resampled(own) if own else self.drawn

    def interval(self, one: Unknown, value: float) -> tuple[float, float]:
        """Interval of a fault if present, with its best value, to healthy if it may be absent."""
        low, high = self.given(one.name).interval(one.name, one.lower, one.upper)
        ends = [value] + [one.healthy] * (self.presence(one.name) < CERTAIN)
        return min(low, *ends), max(high, *ends)

    def share(self, of: Callable[[Draws], np.ndarray]) -> float:
        """The probability of a statement on draws: ``of`` gives (N,) of bool."""
        return sum(s.probability * float(np.mean(of(self._draws(s.values)))) for s in self.sets)

    def _resampled(self, sets: Sequence[FaultSet]) -> Draws:
        total = sum(s.probability for s in sets)
        rng = np.random.default_rng(SEED)
        picked = [
            s.values[rng.choice(len(s.values), round(_DRAWS * s.probability / total))] for s in sets
        ]
        return self._draws(np.concatenate(picked))

    def _draws(self, values: np.ndarray) -> Draws:
        directions = {one.name: one.direction_of for one in self.unknowns if one.direction_of}
        return Draws(tuple(one.name for one in self.unknowns), values, directions)

    def _share(self, one: Unknown, of: FaultSet, share: float) -> float:
        """The probability in a set that a fault is a share of its range from healthy, or more."""
        if one.name not in of.faults | of.undetermined:
            return 0.0
        there = BEFOREHAND if one.name in of.undetermined else 1.0
        return there * float(np.mean(self._is_beyond(one, of.values, share)))

    def _is_beyond(self, one: Unknown, values: np.ndarray, share: float) -> np.ndarray:
        n = self.unknowns.index(one)
        return np.asarray(np.abs(values[:, n] - one.healthy) >= share * one.width)


def _weight_of(one: Unknown) -> float:
    """How many times likelier an absent fault is beforehand than its share of the range."""
    reach = SMALLEST * one.width
    ends = np.clip([one.healthy - reach, one.healthy + reach], one.lower, one.upper)
    share = float(np.diff(ends)[0] / one.width)
    if one.logarithmic:
        share = float(np.diff(np.log(ends))[0] / np.log(one.upper / one.lower))
    return (1.0 - BEFOREHAND) / BEFOREHAND * (1.0 - share) / share


def fault_sets(
    chart: Chart, mean: np.ndarray, covariance: np.ndarray, at: np.ndarray | None = None
) -> FaultSets:
    """The posterior of sets of the faults among the unknowns of a chart.

    Parameters
    ----------
    chart : of d unknowns
    mean, covariance : (d,) and (d, d) arrays, in its coordinates, as if all faults were there and
        had no bounds. A fault whose standard error there is more than a quarter may be anything
    at : (d,) array, the point whose density is the unit of the evidence; the mean if not given
    """
    normal = RestrictedNormal(chart, mean, covariance, mean if at is None else at)
    logs = {names: normal.evidence(names) for names in (frozenset[str](), frozenset(normal.faults))}
    waiting, best = list(logs), max(logs, key=lambda names: logs[names])
    while waiting and len(logs) < 100 * _MOST:
        names = waiting.pop()
        for other in (names ^ {name} for name in normal.faults):
            if other in logs:
                continue
            logs[other] = normal.evidence(other, logs[best] - WINDOW)
            best = max(best, other, key=lambda names: logs[names])
            if logs[other] > logs[best] - WINDOW:
                waiting.append(other)
    near = [names for names in logs if logs[names] > logs[best] - WINDOW]
    # those with a fault more or less tell how large each fault is, if it is there
    kept = sorted(near, key=lambda names: -logs[names])[:_MOST]
    kept += [best ^ {name} for name in normal.faults if best ^ {name} not in kept]
    rng = np.random.default_rng(SEED)
    found = [(*normal.drawn(names, rng), names) for names in kept]
    most = max(log for log, *_ in found)
    weights = np.exp([log - most for log, *_ in found])
    total = most + math.log(weights.sum())
    weights /= weights.sum()
    anything = frozenset(normal.undetermined)
    sets = [
        FaultSet(names, float(weight), chart.to_values(z), anything)
        for weight, (_, z, names) in zip(weights, found, strict=True)
    ]
    sets.sort(key=lambda one: -one.probability)
    evidence = total + normal.log_volume()
    there = frozenset(
        name for name in normal.faults
        if sum(one.probability for one in sets if name in one.faults) >= 1.0 - CERTAIN
    )  # fmt: skip
    return FaultSets(
        chart.unknowns, tuple(sets), normal.distances, evidence, points=(normal.best(there),)
    )
