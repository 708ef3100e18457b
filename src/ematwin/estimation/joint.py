"""What a recording and all that was known before say together of everything that is unknown.

The one density under intervals, profiles and posteriors. With r the weighted residuals of the data
at a point, sigma their noise, f the model's own error (`Problem.model_error`), N the independent
residuals and p the distances from priors in standard deviations,

    D = N_0 + (|r|^2 - |r_0|^2)/(f sigma)^2,      -2 log density = N log(D/N) + |p|^2 + constant,

the noise integrated out with a prior uniform in its logarithm (Gelman et al. 2013, Bayesian Data
Analysis, 3rd ed., section 14.2); N_0 is |r_0|^2/sigma^2 at the best point. Noise below what healthy
recordings left is not believed: where D falls below N times its share, sigma stays there. Rises
count f^2 times less, because what the twin misses pulls the same way throughout (Bissiri, Holmes
and Walker 2016, J. R. Stat. Soc. B 78, 1103-1130, call this a general Bayesian update).

The prior is uniform over the declared range of each fault and of each direction. In the components
(x, y) of a vector that is no uniform density; it is one where the length of the vector is the root
of the magnitude, since dr dphi = 2 rho drho dphi for r = rho^2. `Joint.to_chart` turns these
*even* coordinates into those of the chart.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ematwin.estimation.laplace import Laplace, inverse
from ematwin.estimation.problem import Problem

_EDGE = 1e-9
_STEP = 1e-3  # of differences of what is linear


@dataclass(frozen=True)
class Valley:
    """A normal approximation of the joint density in coordinates of the chart, without bounds.

    Attributes
    ----------
    z : (d,) array, best point within the bounds
    mean : (d,) array
    precision, covariance : (d, d) arrays, inverse to one another
    """

    z: np.ndarray
    mean: np.ndarray
    precision: np.ndarray
    covariance: np.ndarray

    def log_density(self, z: np.ndarray) -> np.ndarray:
        """(B,) logarithms of the density at z (B, d), but for a constant."""
        away = z - self.mean
        return -0.5 * np.einsum("bi,ij,bj->b", away, self.precision, away)


@dataclass(frozen=True)
class Joint:
    """The joint density of all that is free.

    Parameters
    ----------
    peaks : its peaks as `laplace` found them, the best first
    factor : times that the noise of the data is larger (`Problem.model_error`)
    own : how many of the unknowns, the first ones, were searched: faults and what was asked for
    least_noise : float, in the unit of `Problem.noise`
    scatter : by fault, standard deviation by which healthy recordings may be found off healthy
    """

    peaks: tuple[Laplace, ...]
    factor: float
    own: int
    least_noise: float = 0.0
    scatter: Mapping[str, float] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """With the noise of the best peak."""
        return self.peaks[0].problem

    @cached_property
    def independent(self) -> float:
        """Independent residuals N of the data."""
        return float(sum(one.independent for one in self.problem.comparisons))

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """(B, K) in standard deviations, the model's own error included, at points z (B, d)."""
        problem = self.problem
        found = problem.residuals(problem.chart.to_values(z)) / problem.noise
        parts = problem.split(found)
        parts.data[...] /= self.factor
        parts.evidence[...] /= self.factor
        return found

    def rises(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sums of squares (B,) over those of data at the best peak, and of evidence and priors."""
        return self.rises_of(self.residuals(z))

    def rises_of(self, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of residuals (B, K)."""
        parts = self.problem.split(found)
        data = np.einsum("bk,bk->b", parts.data, parts.data)
        rest = found[:, parts.data.shape[1] :]
        known = np.einsum("bk,bk->b", rest, rest)
        least = self.peaks[0].cost / (self.factor * self.problem.noise) ** 2
        return np.where(np.isfinite(data), data - least, np.inf), known

    def deviance(self, z: np.ndarray) -> np.ndarray:
        """Minus twice the logarithm of the density (B,) at z (B, d), but for a constant.

        Infinite where the twin diverged. Points must lie within the bounds.
        """
        return self.deviance_of(*self.rises(z))

    def deviance_of(self, rise: np.ndarray, known: np.ndarray) -> np.ndarray:
        """The deviance (B,) where data rise by ``rise`` and the rest stands at ``known``."""
        count, noise = self.independent, self.problem.noise
        squares = np.maximum(self.peaks[0].cost / noise**2 + rise, 1e-300)
        size = np.maximum(squares / count, (self.least_noise / noise) ** 2)
        with np.errstate(invalid="ignore"):
            found = count * np.log(size) + squares / size + known
        return np.where(np.isfinite(found), found, np.inf)

    def inside(self, z: np.ndarray) -> np.ndarray:
        """(B,) of bool: which z (B, d) values can have."""
        chart = self.problem.chart
        return np.asarray(np.abs(chart.project(z) - z).max(axis=1) < _EDGE)

    @cached_property
    def valleys(self) -> tuple[Valley, ...]:
        """Each peak with the width that the noise of the best one gives it."""
        return tuple(self._valley(one) for one in self.peaks)

    def _valley(self, peak: Laplace) -> Valley:
        # the gradient of priors is exact by differences: they are linear in the chart
        chart, problem = self.problem.chart, self.problem
        at = chart.to_values(np.vstack([peak.z[None], peak.z + _STEP * np.eye(len(peak.z))]))
        distances = problem.prior_distances(at) / problem.noise
        slope = (distances[1:] - distances[0]) @ distances[0] / _STEP
        total = inverse(peak.covariance) @ (peak.z - peak.mean)
        share = (peak.problem.noise / (self.factor * problem.noise)) ** 2
        precision = share * peak.data + peak.priors
        covariance = inverse(precision)
        mean = peak.z - covariance @ (share * (total - slope) + slope)
        return Valley(peak.z, mean, precision, covariance)

    def to_chart(self, even: np.ndarray) -> np.ndarray:
        """Coordinates z (B, d) of the chart of even coordinates (B, d)."""
        z = np.array(even, dtype=float)
        for pair in self.problem.chart.pairs:
            z[:, list(pair)] *= np.hypot(z[:, pair[0]], z[:, pair[1]])[:, None]
        return z

    def to_even(self, z: np.ndarray) -> np.ndarray:
        """Even coordinates (B, d) of z (B, d)."""
        even = np.array(z, dtype=float)
        for pair in self.problem.chart.pairs:
            size = np.hypot(even[:, pair[0]], even[:, pair[1]])
            even[:, list(pair)] /= np.sqrt(np.maximum(size, 1e-300))[:, None]
        return even

    def log_density(self, even: np.ndarray) -> np.ndarray:
        """(B,) logarithms of the density at even coordinates (B, d); -inf outside the bounds."""
        z = self.to_chart(even)
        found = np.full(len(z), -np.inf)
        within = self.inside(z)
        if within.any():
            found[within] = -0.5 * self.deviance(z[within])
        return found
