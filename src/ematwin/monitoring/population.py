"""The healthy population: where features of healthy motions lie, and how far they scatter.

Features depend on the load, which is unknown and estimated with each motion; their healthy mean is
a parabola in it. Their spread has two parts: between motions of one run, and between runs, which
is the larger and the one that thresholds must cover.
"""

from dataclasses import dataclass

import numpy as np

_RIDGE = 0.05  # of the number of motions: holds the parabola down where one load was recorded
_LEAST_SPREAD = 1e-12


def load_basis(load: np.ndarray, scale: float) -> np.ndarray:
    """(N, 3) array: 1, u, u^2 - 1 with u the load in units of ``scale``."""
    u = np.asarray(load) / scale
    return np.column_stack([np.ones_like(u), u, u * u - 1.0])


def fit_parabola(load: np.ndarray, scale: float, values: np.ndarray) -> np.ndarray:
    """Coefficients (3, F) of the healthy mean of values (N, F); slope and curvature by ridge."""
    basis = load_basis(load, scale)
    held = np.diag([0.0, 1.0, 1.0]) * _RIDGE * len(load)
    return np.linalg.solve(basis.T @ basis + held, basis.T @ values)


@dataclass(frozen=True)
class Population:
    """Healthy mean and spread of each feature.

    Attributes
    ----------
    load_scale : float, N
    coefficients : (3, F) array, of the mean over the load
    within, between : (F,) arrays, standard deviations between motions of a run, and between the
        means of runs
    """

    load_scale: float
    coefficients: np.ndarray
    within: np.ndarray
    between: np.ndarray

    @classmethod
    def of(
        cls, features: np.ndarray, load: np.ndarray, groups: np.ndarray, load_scale: float
    ) -> "Population":
        """The population of healthy motions.

        Parameters
        ----------
        features : (N, F) array
        load : (N,) array, N
        groups : (N,) array, number of the run (and condition) of each motion
        """
        coefficients = fit_parabola(load, load_scale, features)
        rest = features - load_basis(load, load_scale) @ coefficients
        members = [rest[groups == g] for g in np.unique(groups)]
        inner = sum(((m - m.mean(0)) ** 2).sum(0) for m in members)
        within = inner / max(1, len(rest) - len(members))
        means = np.stack([m.mean(0) for m in members])
        # the scatter of the means of runs holds a share of that within; not taking it off keeps
        # few runs, which may agree by chance, from promising that no run differs
        between = (means**2).sum(0) / max(1, len(members) - 1)
        return cls(
            load_scale,
            coefficients,
            np.sqrt(np.maximum(within, _LEAST_SPREAD**2)),
            np.sqrt(between),
        )

    def mean(self, load: np.ndarray) -> np.ndarray:
        """Healthy mean (N, F) at loads (N,)."""
        return load_basis(load, self.load_scale) @ self.coefficients

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (F,) of a motion of another healthy run."""
        return np.hypot(self.within, self.between)

    def scores(self, features: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Features (N, F) in standard deviations from the healthy mean at their load."""
        return (features - self.mean(load)) / self.spread
