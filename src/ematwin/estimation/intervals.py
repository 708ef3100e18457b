"""Intervals: the ranges that hold the true values, from draws within the bounds.

An interval is the shortest one with its share of the draws; where that begins at a bound, the bound
belongs to it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ematwin.estimation.constants import COVERAGE, LEVEL
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.linear_algebra import eigen

if TYPE_CHECKING:
    from ematwin.estimation.spike_and_slab import FaultSets

_NEAR = 0.15  # of an interval: so close to a bound it begins there
_WIDE = 12.0  # sharp standard errors: an interval that others than noise make


class Interval(NamedTuple):
    """Where a value lies, 95 %."""

    low: float
    high: float


@dataclass(frozen=True)
class Draws:
    """Values that are as likely as the recording and all that was known before make them.

    Attributes
    ----------
    names : of d unknowns
    values : (N, d) array, within their bounds
    directions : name of a direction -> name of its magnitude
    """

    names: tuple[str, ...]
    values: np.ndarray
    directions: Mapping[str, str]

    def of(self, name: str) -> np.ndarray:
        """(N,) values of an unknown."""
        return np.asarray(self.values[:, self.names.index(name)])

    def interval(self, name: str, lower: float, upper: float) -> tuple[float, float]:
        """The shortest interval that holds 95 % of the draws; bounds as given are snapped to.

        Of a direction: around its mean, and from -1/2 turn to +1/2 where it has no meaning.
        """
        x = self.of(name)
        if name in self.directions:
            turn = np.exp(2j * np.pi * x)
            mean = float(np.angle(turn.mean()) / (2.0 * np.pi))
            away = (x - mean + 0.5) % 1.0 - 0.5
            reach = float(np.quantile(np.abs(away), [LEVEL])[0])
            if reach > 0.25:  # all round: there is no magnitude to speak of
                return lower, upper
            middle = mean % 1.0
            return middle - reach, middle + reach
        x = np.sort(x)
        count = max(2, int(np.ceil(LEVEL * len(x))))
        width = x[count - 1 :] - x[: len(x) - count + 1]
        first = int(np.argmin(width))
        low, high = float(x[first]), float(x[first + count - 1])
        near = max(1e-3 * (upper - lower), _NEAR * (high - low))
        return (lower if low - lower < near else low), (upper if upper - high < near else high)


def conditional(
    covariance: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split a normal distribution (d, d) into a marginal and a conditional one.

    Parameters
    ----------
    covariance : (d, d) array
    first : (d,) array of bool

    Returns
    -------
    root : (f, f) array, of the covariance of the first
    gain : (d - f, f) array, by which the mean of the others follows the first
    rest : (d - f, d - f) array, root of the covariance that the others have beside
    """
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-18))
    scaled = covariance / np.outer(size, size)
    own, across = scaled[np.ix_(first, first)], scaled[np.ix_(~first, first)]
    gain = across @ np.linalg.pinv(own, hermitian=True)
    left = scaled[np.ix_(~first, ~first)] - gain @ across.T
    one, other = size[first], size[~first]
    return (
        _root(own) * one[:, None],
        gain * np.outer(other, 1.0 / one),
        _root(left) * other[:, None],
    )


def _root(covariance: np.ndarray) -> np.ndarray:
    values, vectors = eigen(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def with_corner(
    interval: tuple[float, float], sharp_error: float, one: Unknown
) -> tuple[float, float]:
    """The interval with a margin for noise where bounds of other unknowns end it.

    What cannot be told from the faults of other phases ends where those are healthy, and there the
    truth often is: in a corner, which draws within the bounds do not straddle.
    """
    low, high = interval
    if one.direction_of is not None or high - low < _WIDE * sharp_error:
        return interval
    margin = COVERAGE * sharp_error
    return max(one.lower, low - margin), min(one.upper, high + margin)


def in_physical_units(
    unknowns: Sequence[Unknown],
    actuator: ParameterSet,
    values: Mapping[str, float],
    sets: "FaultSets",
    intervals: Mapping[str, Interval],
) -> dict[str, tuple[float, Interval]]:
    """Unknowns in physical units: of products, where a fault is a multiple of a parameter.

    ``sets`` tells what parameters are where a fault is there. An interval that holds healthy holds
    the healthy value of the actuator as well.
    """
    best = actuator.with_arrays({name: value for name, value in values.items() if "." in name})
    found = {}
    for one in unknowns:
        ends = intervals[one.name]
        if one.physical is None:
            found[one.name] = (values[one.name], ends)
            continue
        value = float(one.physical(best, values[one.name]))
        low, high = (float(one.physical(best, end)) for end in (ends.low, ends.high))
        if one.direction_of is None:
            low, high = sorted((low, high))  # what is lost may be told by what is left
            drawn = sets.given(one.name)
            varied = actuator.with_arrays({n: drawn.of(n) for n in drawn.names if "." in n})
            if _depends_on_parameters(one, varied):
                spread = np.asarray(one.physical(varied, drawn.of(one.name)), dtype=float)
                least, most = float(spread.min()), float(spread.max())
                low, high = Draws((one.name,), spread[:, None], {}).interval(one.name, least, most)
            within = [value]
            if ends.low <= one.healthy <= ends.high:
                within.append(float(one.physical(actuator, one.healthy)))
            low, high = min(low, *within), max(high, *within)
        found[one.name] = (value, Interval(low, high))
    return found


def physical_of(
    one: Unknown, actuator: ParameterSet, value: float, interval: Interval
) -> tuple[float, Interval]:
    """Value and interval of a fault in its physical unit, on one actuator."""
    physical, low, high = (
        one.physical_value(actuator, x).value for x in (value, interval.low, interval.high)
    )
    return physical, Interval(min(low, high), max(low, high))


def _depends_on_parameters(one: Unknown, varied: ParameterSet) -> bool:
    """Whether the physical value changes with parameters (N,); no where a kind takes no arrays."""
    assert one.physical is not None
    try:
        values = np.asarray(one.physical(varied, one.healthy), dtype=float)
    except TypeError:
        return False
    return bool(np.ptp(values) > 0.0)


def contrasts_of(
    model: Model, actuator: ParameterSet, values: Mapping[str, float], sets: "FaultSets"
) -> dict[str, tuple[float, Interval]]:
    """Combinations of faults, value and interval by name: given that any is there, or over all."""
    found = {}
    for one in model.contrasts(actuator):
        if not set(one.weights) <= set(sets.drawn.names):
            continue
        weights = one.weights.items()
        value = float(sum(weight * values[name] for name, weight in weights))
        # the best point may lie in a corner that draws within the bounds do not straddle
        ends = [value]
        for drawn in (sets.drawn, sets.given(*one.weights)):
            spread = np.sum([weight * drawn.of(name) for name, weight in weights], axis=0)
            ends += np.quantile(spread, [0.025, 0.975]).tolist()
        found[one.name] = (value, Interval(min(ends), max(ends)))
    return found


def deviations(one: Unknown, drawn: np.ndarray, value: float) -> np.ndarray:
    """Deviations (N,) of draws from a value.

    A logarithmic unknown deviates by its logarithm, scaled such that the value is as far from
    healthy as its logarithm is: halved deviates as much as doubled.
    """
    if one.direction_of is not None:
        turn = np.exp(2j * np.pi * drawn)
        return np.asarray(np.angle(turn / np.exp(1j * np.angle(turn.mean()))) / (2.0 * np.pi))
    if one.logarithmic:
        return np.asarray(mean_slope(value, one.healthy) * np.log(drawn / value))
    return drawn - value


def mean_slope(value: float, healthy: float) -> float:
    """The logarithmic mean of two values: their difference per difference of logarithms."""
    away = math.log(value / healthy)
    # logarithms so near that their mean slope is the slope
    return (value - healthy) / away if abs(away) > 1e-6 else healthy
