"""What a walk along a fault tells: where its interval ends, its shape, and its density.

The 95 % interval ends where the rise of the deviance passes 3.84 (Wilks 1938; Venzon and Moolgavkar
1988, J. R. Stat. Soc. C 37, 87-94). Impacts make the rise rough: descents stop in its dips before
everything else has made up for a wrong value, and walks end too soon. Where the rise along any
fault lies `ROUGH` about a parabola, no interval is therefore shorter than Laplace's, whose slopes
look past that: descents of all walks go through the same misfit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ematwin.models.unknown import Unknown

LIMIT = 3.841  # quantile of the chi-squared distribution of one degree, 95 %
NEAR = 16.0  # rise of points to which a parabola is fitted
ROUGH = 0.5  # root mean square of the rise about it; 0.1 to 0.4 of what impacts hardly touch
_FEWEST = 5  # points that it needs
_AT_BOUND = 2e-3  # share of the range
_TAIL = 40.0  # rise up to which a walk is continued for probabilities
_FINE = 40  # points between two of a walk


@dataclass(frozen=True)
class Walk:
    """The profile of one fault.

    Attributes
    ----------
    name : of the fault
    values : (n,) array, ascending
    rise : (n,) array, of the deviance over the least one
    points : (n, d) array, values of everything that is free, in the order of the problem
    interval : ends of 95 %
    shape : "bounded", "one-sided", "flat", or "at its bound"
    partners : what it is traded off against: others that make up for it, the strongest first
    roughness : root mean square of the rise about a parabola; 0 if there are too few points
    """

    name: str
    values: np.ndarray
    rise: np.ndarray
    points: np.ndarray
    interval: tuple[float, float]
    shape: str
    partners: tuple[str, ...]
    roughness: float = 0.0

    @property
    def length(self) -> float:
        """Of the interval."""
        return self.interval[1] - self.interval[0]

    @property
    def rough(self) -> bool:
        """Whether impacts make the rise too rough to be relied on."""
        return self.roughness > ROUGH

    @property
    def sentence(self) -> str:
        """The shape, in words."""
        if self.partners:
            return f"{self.shape}, traded off against {' and '.join(self.partners)}"
        return self.shape

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "values": self.values.tolist(),
            "rise": self.rise.tolist(),
            "interval": list(self.interval),
            "shape": self.shape,
            "partners": list(self.partners),
            "roughness": self.roughness,
        }

    def reaching(self, low: float, high: float) -> "Walk":
        """The walk with an interval that ends no sooner; the rise is lower in proportion."""
        best = float(self.values[np.argmin(self.rise)])
        ends = (min(self.interval[0], low), max(self.interval[1], high))
        rise = self.rise.copy()
        for own, end, side in zip(
            self.interval, ends, (self.values < best, self.values > best), strict=True
        ):
            if end != own and own != best:
                rise[side] *= ((own - best) / (end - best)) ** 2
        return replace(self, interval=ends, rise=rise)

    def share_beyond(self, low: float, high: float, bounds: tuple[float, float]) -> float:
        """The share of the normalised profile likelihood outside low and high."""
        x, density = self._density(bounds)
        middle = 0.5 * (x[1:] + x[:-1])
        mass = 0.5 * (density[1:] + density[:-1]) * np.diff(x)
        return float(mass[(middle < low) | (middle > high)].sum() / mass.sum())

    def _density(self, bounds: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """Values and exp(-rise/2), between the points of the walk by the root of the rise."""
        best = int(np.argmin(self.rise))
        root = np.sqrt(self.rise) * np.where(np.arange(len(self.rise)) < best, -1.0, 1.0)
        x, root = _continued(self.values, root, bounds)
        fine = np.unique(
            np.concatenate([
                np.linspace(a, b, _FINE) for a, b in pairwise(x)
            ])
        )  # fmt: skip
        return fine, np.exp(-0.5 * np.interp(fine, x, root) ** 2)


def _continued(
    x: np.ndarray, root: np.ndarray, bounds: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """The walk and what lies between its ends and the bounds, straight on to `_TAIL`."""
    reach = math.sqrt(_TAIL)
    if len(x) == 1:  # nowhere to go: all within the bounds is alike
        return np.array(bounds), np.zeros(2)
    first, last = (max((root[n + 1] - root[n]) / (x[n + 1] - x[n]), 1e-12) for n in (0, -2))
    low = max(bounds[0], x[0] - max(reach + root[0], 0.0) / first)
    high = min(bounds[1], x[-1] + max(reach - root[-1], 0.0) / last)
    if low < x[0]:
        x, root = np.append(low, x), np.append(root[0] + first * (low - x[0]), root)
    if high > x[-1]:
        root, x = np.append(root, root[-1] + last * (high - x[-1])), np.append(x, high)
    return x, root


def smoothed(u: np.ndarray, rise: np.ndarray) -> tuple[np.ndarray, float]:
    """Rises (n,) over the bottom of a parabola through them, at least 0; and how rough they are.

    Impacts make the misfit rough. The least of many rough values is a lucky one, and an interval
    that began there would be too short.
    """
    near = rise < NEAR
    if near.sum() < _FEWEST:
        return rise, 0.0
    at = u[near] - u[near].mean()
    size = float(np.abs(at).max()) or 1.0
    fitted = np.polyfit(at / size, rise[near], 2)
    c, b, a = fitted
    rough = float(np.sqrt(np.mean((rise[near] - np.polyval(fitted, at / size)) ** 2)))
    if c <= 0.0:
        return rise, rough
    lowest = float(np.clip(-b / (2.0 * c), at.min() / size, at.max() / size))
    bottom = a + b * lowest + c * lowest**2
    return np.asarray(np.maximum(rise - max(bottom, 0.0), 0.0)), rough


def crossing(values: np.ndarray, rise: np.ndarray, way: Sequence[int]) -> float | None:
    """Where the root of the rise passes that of the limit, along places from the best one on."""
    root, limit = np.sqrt(rise), math.sqrt(LIMIT)
    for a, b in pairwise(way):
        if root[b] >= limit:
            share = (limit - root[a]) / (root[b] - root[a])
            return float(values[a] + share * (values[b] - values[a]))
    return None


def value_at(one: Unknown, share: float) -> float:
    """The value of an unknown at a share of its range, or of that of its logarithm."""
    if one.logarithmic:
        return float(one.lower * (one.upper / one.lower) ** share)
    return float(one.lower + share * one.width)


def shape_of(crossed: Sequence[bool], best: float, one: Unknown) -> str:
    """The shape in a word, from where the limit was crossed (below, above) and the best value."""
    if all(crossed):
        return "bounded"
    if not any(crossed):
        return "flat"
    bound = one.lower if crossed[1] else one.upper
    return "at its bound" if abs(best - bound) < _AT_BOUND * one.width else "one-sided"
