"""How walkers move: proposals that know where the valleys are and how wide.

`Surrogate` takes many cheap steps on the normal approximation of a valley within the bounds, and
then asks the twin once whether it agrees (Liu 2001, Monte Carlo Strategies in Scientific Computing,
section 9.4.3, "surrogate transition"; Christen and Fox 2005, J. Comput. Graph. Stat. 14, 795-810).
Its steps are hit-and-run (Smith 1984, Oper. Res. 32, 1296-1308): along a direction the
approximation is a normal distribution between two bounds, which is drawn from exactly. `Jump`
carries a walker from one valley to another at the same distance in standard deviations. Both are
proposals as `emcee.moves.MHMove` takes them: ``(walkers, rng) -> (walkers, log factors)``.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ematwin.estimation.joint import Joint, Valley

_STEPS = (2, 8, 30)  # in units of dimensions: one of these, at random


@dataclass(frozen=True)
class Surrogate:
    """Steps on the normal approximation of a valley that each walker draws anew.

    Parameters
    ----------
    joint : of the walkers' even coordinates
    """

    joint: Joint

    def __call__(self, even: np.ndarray, rng: Any) -> tuple[np.ndarray, np.ndarray]:
        """New walkers (W, d) and the logarithms (W,) of what makes up for the proposal."""
        valleys = self.joint.valleys
        z = self.joint.to_chart(even)
        change = np.zeros(len(z))
        steps = _STEPS[rng.randint(len(_STEPS))]
        # each walker for itself: walkers that choose alike are not worth as many
        own = rng.randint(len(valleys), size=len(z))
        for n, valley in enumerate(valleys):
            here = own == n
            if here.any():
                before = valley.log_density(z[here])
                z[here] = walked(self.joint, valley, z[here], steps, rng)
                change[here] = before - valley.log_density(z[here])
        return self.joint.to_even(z), change


@dataclass(frozen=True)
class Jump:
    """From one valley to another, keeping the place within it."""

    joint: Joint

    def __call__(self, even: np.ndarray, rng: Any) -> tuple[np.ndarray, np.ndarray]:
        """New walkers (W, d) and the logarithms (W,) of what makes up for the proposal."""
        valleys = self.joint.valleys
        z = self.joint.to_chart(even)
        moved, stretch = z.copy(), np.zeros(len(z))
        first = rng.randint(len(valleys), size=len(z))
        other = (first + 1 + rng.randint(len(valleys) - 1, size=len(z))) % len(valleys)
        for a, here in enumerate(valleys):
            for b, there in enumerate(valleys):
                chosen = (first == a) & (other == b)
                root, to = (np.linalg.cholesky(one.covariance) for one in (here, there))
                map_ = np.linalg.solve(root.T, to.T)
                moved[chosen] = there.z + (z[chosen] - here.z) @ map_
                stretch[chosen] = np.log(np.diag(to)).sum() - np.log(np.diag(root)).sum()
        # even coordinates are not those of the map: an area of the chart is 1/r of theirs
        change = stretch + _log_radii(self.joint, z) - _log_radii(self.joint, moved)
        return self.joint.to_even(moved), change


def walked(joint: Joint, valley: Valley, z: np.ndarray, steps: int, rng: Any) -> np.ndarray:
    """Points (W, d) after steps that leave the bounded approximation of a valley as it is."""
    chart = joint.problem.chart
    values, vectors = np.linalg.eigh(valley.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    z = z.copy()
    radii = _log_radii(joint, z)
    for _ in range(steps):
        ways = rng.standard_normal(z.shape) @ root.T
        pull = ways @ valley.precision
        curvature = np.einsum("wi,wi->w", pull, ways)
        middle = -np.einsum("wi,wi->w", pull, z - valley.mean) / curvature
        size = 1.0 / np.sqrt(curvature)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_low, to_high = (chart.lower - z) / ways, (chart.upper - z) / ways
        low = np.where(ways > 0.0, to_low, to_high).max(axis=1)
        high = np.where(ways > 0.0, to_high, to_low).min(axis=1)
        t = _truncated_normal((low - middle) / size, (high - middle) / size, rng)
        tried = z + (middle + size * t)[:, None] * ways
        # an even density is 1/r in the chart
        then = _log_radii(joint, tried)
        taken = (np.log(rng.random_sample(len(z))) < radii - then) & joint.inside(tried)
        z[taken], radii[taken] = tried[taken], then[taken]
    return z


def _log_radii(joint: Joint, z: np.ndarray) -> np.ndarray:
    """Sums (W,) of the logarithms of the magnitudes that have directions."""
    total = np.zeros(len(z))
    for radius, direction in joint.problem.chart.pairs:
        total += np.log(np.maximum(np.hypot(z[:, radius], z[:, direction]), 1e-300))
    return total


def _truncated_normal(low: np.ndarray, high: np.ndarray, rng: Any) -> np.ndarray:
    """Draws (W,) of a standard normal distribution between bounds (W,) each."""
    from scipy.special import ndtr, ndtri

    # the lower tail is the one that floats resolve
    sign = np.where(low + high > 0.0, -1.0, 1.0)
    a, b = np.where(sign > 0.0, low, -high), np.where(sign > 0.0, high, -low)
    start, stop = ndtr(a), ndtr(b)
    found = ndtri(start + (stop - start) * rng.random_sample(len(a)))
    found = np.where(np.isfinite(found), found, b)
    return np.asarray(sign * np.clip(found, a, b))
