"""Joint posterior density of everything that is unknown.

Laplace's intervals, profiles and the sampler evaluate this one density. With r the weighted
residuals of the data at a point, sigma their noise, f the model's own error
(`Problem.model_error`), N the number of independent residuals and p the distances from priors in
standard deviations,

    D = N_0 + (|r|^2 - |r_0|^2)/(f sigma)^2,      -2 log density = N log(D/N) + |p|^2 + constant,

the noise integrated out with a prior uniform in its logarithm (Gelman et al. 2013, Bayesian Data
Analysis, 3rd ed., section 14.2); N_0 is |r_0|^2/sigma^2 at the best point. The noise is no less
than what healthy recordings left: where D falls below N times its share, sigma stays there. Rises
count f^2 times less, because the error of the model is not independent from sample to sample
(Bissiri, Holmes and Walker 2016, J. R. Stat. Soc. B 78, 1103-1130: a general Bayesian update).

The prior is uniform over the declared range of each fault and of each direction. In the components
(x, y) of a vector that is no uniform density; it is one where the length of the vector is the root
of the magnitude, since dr dphi = 2 rho drho dphi for r = rho^2. `Joint.to_chart` turns these
*even* coordinates into coordinates of the chart.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ematwin.estimation.aliases import Aliases
from ematwin.estimation.laplace import Laplace
from ematwin.estimation.problem import Problem
from ematwin.numerics.linear_algebra import inverse


@dataclass(frozen=True)
class Normal:
    """Normal approximation around one maximum, in coordinates of the chart and without bounds.

    Attributes
    ----------
    z : (d,) array, the maximum within the bounds
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
    """Joint posterior density.

    Parameters
    ----------
    peaks : its maxima as `laplace` found them, the best first
    factor : times that the noise of the data is larger (`Problem.model_error`)
    own : how many of the unknowns, the first ones, were searched: faults and requested unknowns
    least_noise : float, in the unit of `Problem.noise`
    scatter : by fault, standard deviation of what the density lacks: the error of the model, and
        how estimates on healthy recordings scatter
    aliases : as of `ematwin.estimation.descent.Descent`
    """

    peaks: tuple[Laplace, ...]
    factor: float
    own: int
    least_noise: float = 0.0
    scatter: Mapping[str, float] = field(default_factory=dict)
    aliases: Aliases | None = None

    @property
    def problem(self) -> Problem:
        """With the noise of the best maximum."""
        return self.peaks[0].problem

    @cached_property
    def normals(self) -> tuple[Normal, ...]:
        """Normal approximations around the maxima, with the noise of the best one."""
        return tuple(self._normal(one) for one in self.peaks)

    def _normal(self, peak: Laplace) -> Normal:
        noise = self.factor * self.problem.noise
        gradient = peak.slope(noise / peak.problem.noise)
        precision = peak.data * (peak.problem.noise / noise) ** 2 + peak.priors
        covariance = inverse(precision)
        return Normal(peak.z, peak.z - covariance @ gradient, precision, covariance)

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """(B, K) in standard deviations, the model's own error included, at points z (B, d)."""
        problem = self.problem
        found = problem.residuals(problem.chart.to_values(z)) / problem.noise
        parts = problem.split(found)
        parts.data[...] /= self.factor
        parts.evidence[...] /= self.factor
        return found

    def deviance(self, residuals: np.ndarray) -> np.ndarray:
        """Minus twice the logarithm of the density (B,), but for a constant; of residuals (B, K).

        Infinite where the model diverged.
        """
        problem, noise = self.problem, self.problem.noise
        data = problem.split(residuals).data
        other = residuals[:, data.shape[1] :]
        count = sum(one.independent for one in problem.comparisons)
        least = self.peaks[0].cost / noise**2
        squares = np.einsum("bk,bk->b", data, data) - least / self.factor**2 + least
        squares = np.maximum(squares, 1e-300)
        size = np.maximum(squares / count, (self.least_noise / noise) ** 2)
        with np.errstate(invalid="ignore"):
            found = count * np.log(size) + squares / size
            found += np.einsum("bk,bk->b", other, other)
        return np.where(np.isfinite(found), found, np.inf)

    def log_density(self, even: np.ndarray) -> np.ndarray:
        """(B,) logarithms of the density at even coordinates (B, d); -inf outside the bounds."""
        z = self.to_chart(even)
        found = np.full(len(z), -np.inf)
        within = self.inside(z)
        if within.any():
            found[within] = -0.5 * self.deviance(self.residuals(z[within]))
        return found

    def inside(self, z: np.ndarray) -> np.ndarray:
        """(B,) of bool: which z (B, d) lie within the bounds."""
        return np.asarray(np.abs(self.problem.chart.project(z) - z).max(axis=1) < 1e-9)

    def nearest(self, z: np.ndarray) -> np.ndarray:
        """The maximum (B,) to which points z (B, d) are nearest, in its standard deviations."""
        return np.argmax([one.log_density(z) for one in self.normals], axis=0)

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

    def log_radii(self, z: np.ndarray) -> np.ndarray:
        """Logarithms (B,) of the product of the magnitudes that have directions, at z (B, d)."""
        total = np.zeros(len(z))
        for x, y in self.problem.chart.pairs:
            total += np.log(np.maximum(np.hypot(z[:, x], z[:, y]), 1e-300))
        return total
