"""Knowledge of unknowns besides a recording: normal distributions of their coordinates."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.chart import Chart
from ematwin.models.unknown import Unknown


@dataclass(frozen=True)
class Prior:
    """A joint normal distribution of some unknowns.

    Parameters
    ----------
    names : of P unknowns
    mean : (P,) array; of logarithms where an unknown is logarithmic
    covariance : (P, P) array
    """

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray

    @cached_property
    def _whitening(self) -> np.ndarray:
        """(P, P), the inverse root of the covariance."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)).T)

    def distances(self, z: np.ndarray) -> np.ndarray:
        """(B, P), standard deviations, of coordinates (B, P) from the mean."""
        return np.asarray((z - self.mean) @ self._whitening)

    def of(self, names: Iterable[str]) -> "Prior":
        """The marginal distribution of some of them."""
        wanted = set(names)
        kept = [n for n, name in enumerate(self.names) if name in wanted]
        return Prior(
            tuple(self.names[n] for n in kept), self.mean[kept], self.covariance[np.ix_(kept, kept)]
        )

    @classmethod
    def independent(cls, unknowns: Iterable[Unknown]) -> "Prior":
        """From the spreads of unknowns; those without one are left out."""
        known = [one for one in unknowns if one.spread is not None]
        mean = [np.log(one.healthy) if one.logarithmic else one.healthy for one in known]
        return cls(
            tuple(one.name for one in known),
            np.array(mean, dtype=float),
            np.diag([one.spread**2 for one in known if one.spread is not None]),
        )

    def given(self, values: Mapping[str, float]) -> "Prior":
        """The distribution of the others where some are known (as values, or their logarithms)."""
        known = [n for n, name in enumerate(self.names) if name in values]
        rest = [n for n in range(len(self.names)) if n not in known]
        across = self.covariance[np.ix_(rest, known)]
        gain = across @ np.linalg.inv(self.covariance[np.ix_(known, known)])
        off = np.array([values[self.names[n]] for n in known]) - self.mean[known]
        return Prior(
            tuple(self.names[n] for n in rest),
            self.mean[rest] + gain @ off,
            self.covariance[np.ix_(rest, rest)] - gain @ across.T,
        )

    def and_(self, other: "Prior") -> "Prior":
        """Both, independent of one another."""
        size = len(self.names)
        total = np.zeros((size + len(other.names),) * 2)
        total[:size, :size], total[size:, size:] = self.covariance, other.covariance
        return Prior((*self.names, *other.names), np.concatenate([self.mean, other.mean]), total)


class Remainder(NamedTuple):
    """What an equation along the motion leaves of a recording, by norms of residuals.

    Attributes
    ----------
    norm : of its residual
    least : what noise and its own errors leave
    alike : the same of those of its errors that are alike throughout
    independent : samples of the noise
    noise : of the motion, as of `Equation.noise`
    weights : (K,) array, or 1, of residuals in standard deviations: less where they jump
    """

    norm: float
    least: float
    alike: float
    independent: float
    noise: Any = None
    weights: Any = 1.0

    def deviation(self, norm: float) -> float:
        """Standard deviation of its residuals where so much is left; independent ones count.

        Beyond the least it is a discrepancy, and how many independent parts that has is unknown:
        from one to as many as the noise. Their geometric mean counts.
        """
        beyond = max(0.0, norm**2 - self.least**2) / math.sqrt(self.independent)
        return math.sqrt(self.least**2 / self.independent + self.alike**2 + beyond)


class Information(NamedTuple):
    """Knowledge of unknowns: the density exp(-|left + root (z - z_0)|^2/2).

    Its last row is what stays of the residuals wherever the unknowns lie.

    Attributes
    ----------
    chart : Chart, of the unknowns
    z : (d,) array, coordinates z_0
    root : (k, d) array
    left : (k,) array
    remainders : Remainder of each equation, by its recording and name
    unexplained : float, largest share of the currents that an equation leaves, where
        noise leaves less than half
    wider : float, by which all counts less than ``remainders`` say, as errors of the model do
    whole : bool, whether it holds all that the recordings show of faults
    """

    chart: Chart
    z: np.ndarray
    root: np.ndarray
    left: np.ndarray
    remainders: Mapping[tuple[int, str], Remainder]
    unexplained: float = 0.0
    wider: float = 1.0
    whole: bool = False

    def distances(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """(B, k), standard deviations, of values (B,) by name."""
        return np.asarray(self.left + (coordinates(self.chart, values) - self.z) @ self.root.T)

    def beyond(self, other: "Information") -> float:
        """Squared distance by which its residuals grow where another explains more.

        A discrepancy that the other one explains is none, and does not count as noise.
        """
        total = 0.0
        for name, mine in self.remainders.items():
            if name in other.remainders and other.remainders[name].norm < mine.norm:
                less = mine.deviation(other.remainders[name].norm)
                total += mine.norm**2 * (less**-2 - mine.deviation(mine.norm) ** -2)
        return total / self.wider**2


def coordinate(one: Unknown, value: Any) -> Any:
    """A value, or an array, of an unknown as its prior counts it: it, or its logarithm."""
    return np.log(value) if one.logarithmic else value


def coordinates(chart: Chart, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Coordinates (B, d) in a chart of values (B,) by name, which may hold others too."""
    return chart.from_values(np.array([values[one.name] for one in chart.unknowns]).T)
