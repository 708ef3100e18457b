"""The healthy population: where features of healthy recordings lie, and how far they scatter.

Features may depend on a covariate that is unknown and estimated with each recording, such as the
load; their healthy mean is a parabola in it. Their spread has two parts: between recordings of one
run, and between runs. The latter is larger, and thresholds must cover it.
"""

from dataclasses import dataclass

import numpy as np

_RIDGE = 0.05  # of the number of recordings: holds the parabola down where one load was recorded
_LEAST_SPREAD = 1e-12


def basis(covariate: np.ndarray, scale: float | None) -> np.ndarray:
    """(N, 3) array: 1, u, u^2 - 1 with u the covariate in units of ``scale``.

    Without a scale there is no covariate: (N, 1) array of ones.
    """
    if scale is None:
        return np.ones((len(covariate), 1))
    u = np.asarray(covariate) / scale
    return np.column_stack([np.ones_like(u), u, u * u - 1.0])


def fit_mean(covariate: np.ndarray, scale: float | None, values: np.ndarray) -> np.ndarray:
    """Coefficients (3, F) or (1, F) of the mean of values (N, F); slope and curvature by ridge."""
    terms = basis(covariate, scale)
    held = np.diag([0.0, 1.0, 1.0][: terms.shape[1]]) * _RIDGE * len(covariate)
    return np.linalg.solve(terms.T @ terms + held, terms.T @ values)


@dataclass(frozen=True)
class Population:
    """Healthy mean and spread of each feature.

    Attributes
    ----------
    scale : float, of the covariate, SI; None if there is none
    coefficients : (3, F) array, of the mean over the covariate; (1, F) without one
    within, between : (F,) arrays, standard deviations between recordings of a run, and between the
        means of runs
    """

    scale: float | None
    coefficients: np.ndarray
    within: np.ndarray
    between: np.ndarray

    @classmethod
    def of(
        cls,
        features: np.ndarray,
        covariate: np.ndarray,
        groups: np.ndarray,
        scale: float | None,
        errors: np.ndarray | None = None,
        cut: np.ndarray | None = None,
    ) -> "Population":
        """The population of healthy recordings.

        Parameters
        ----------
        features : (N, F) array
        covariate : (N,) array, SI; not looked at without a scale
        groups : (N,) array, number of the run (and condition) of each recording
        scale : of the covariate
        errors : (F,) array, standard errors of the features, which stand in where each run has a
            single recording; zero where not known
        cut : (F,) array of bool, features whose healthy value lies on a bound, which hides a part
            of their scatter: their standard error is the least that counts
        """
        coefficients = fit_mean(covariate, scale, features)
        rest = features - basis(covariate, scale) @ coefficients
        members = [rest[groups == g] for g in np.unique(groups)]
        inner = sum(((m - m.mean(0)) ** 2).sum(0) for m in members)
        freedom = len(rest) - len(members)
        within = np.sqrt(np.maximum(inner / max(1, freedom), _LEAST_SPREAD**2))
        if errors is not None:
            stand_in = np.full(errors.shape, freedom == 0) if cut is None else cut | (freedom == 0)
            within = np.where(stand_in, np.maximum(within, errors), within)
        means = np.stack([m.mean(0) for m in members])
        # the scatter of the means of runs holds a share of that within; not taking it off keeps
        # few runs, which may agree by chance, from promising that no run differs
        between = (means**2).sum(0) / max(1, len(members) - 1)
        return cls(scale, coefficients, within, np.sqrt(between))

    def mean(self, covariate: np.ndarray) -> np.ndarray:
        """Healthy mean (N, F) at covariates (N,)."""
        return basis(covariate, self.scale) @ self.coefficients

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (F,) of a recording of another healthy run."""
        return np.hypot(self.within, self.between)

    def scores(self, features: np.ndarray, covariate: np.ndarray) -> np.ndarray:
        """Features (N, F) in standard deviations from the healthy mean at their covariate."""
        return (features - self.mean(covariate)) / self.spread
