"""A fit of one equation along the recorded motion to all recordings (`equations.Equations`).

The linearised residuals tell what other residuals would leave after a fit of their own, and what is
left of stretches that the fit has not seen (cross-validation).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ematwin.estimation.constants import TWO_SIGMA
from ematwin.models.parameter_set import ParameterSet

if TYPE_CHECKING:
    from ematwin.estimation.equations import Equations

_STRETCHES = 6  # of a recording, each counted once


@dataclass(frozen=True)
class EquationFit:
    """A fit of one equation to all recordings.

    Attributes
    ----------
    equations : that were fitted
    actuator : ParameterSet, with the values found
    places : of the d fitted parameters
    left : of each recording (K,), as shares of the norm of all that is to be explained
    slopes : of each recording (d, K), by the coordinates of the fit
    pull, prior : (d,) and (d, d), gradient and curvature of the prior, in the unit of the cost
    weight : float, the cost of an independent residual
    alike : float, the same for the idealisation error of the equations, one sample in all
    """

    equations: "Equations"
    actuator: ParameterSet
    places: tuple[str, ...]
    left: list[np.ndarray]
    slopes: list[np.ndarray]
    pull: np.ndarray
    prior: np.ndarray
    weight: float
    alike: float = 0.0

    def of(self, n: int) -> "EquationFit":
        """The same of the nth recording alone."""
        return replace(self, left=self.left[n : n + 1], slopes=self.slopes[n : n + 1])

    @property
    def cost(self) -> float:
        """Share of the energy that is left."""
        return energy(self.left)

    @property
    def step(self) -> np.ndarray:
        """(d,) step to the least squares of the linearised residuals."""
        return _least(self.prior + self._moments, self.pull + self._slope(self.left))

    @property
    def information(self) -> tuple[np.ndarray, np.ndarray]:
        """Inverse covariance (d, d) and its gradient (d,) here, by the recordings alone."""
        unit = self.weight + self.alike
        return self._moments / unit, self._slope(self.left) / unit

    @cached_property
    def _moments(self) -> np.ndarray:
        """(d, d), products of the slopes over all samples."""
        return np.asarray(sum((one @ one.T for one in self.slopes), np.zeros_like(self.prior)))

    def _slope(self, left: Sequence[np.ndarray]) -> np.ndarray:
        """(d,), products of the slopes with residuals over all samples."""
        return np.asarray(sum(one @ r for one, r in zip(self.slopes, left, strict=True)))

    def projected(self, left: Sequence[np.ndarray], scaled: bool) -> float:
        """What would be left of other residuals if all that is fitted were fitted anew.

        With ``scaled`` the change from this fit's residuals to them may be of any size, as that by
        a parameter of a form is; infinite where the size would be negative, which no form has.
        """
        moments, prior, pull = self._moments, self.prior, self.pull
        slope = self._slope(left)
        if scaled:
            changes = [r - before for r, before in zip(left, self.left, strict=True)]
            beside = self._slope(changes)
            moments = np.block([[moments, np.c_[beside]], [np.r_[beside, energy(changes)]]])
            slope = np.append(slope, sum(x @ r for x, r in zip(changes, left, strict=True)))
            prior, pull = np.pad(prior, (0, 1)), np.pad(pull, (0, 1))
        step = _least(prior + moments, pull + slope)
        if scaled and step[-1] < -1.0:
            return math.inf
        return energy(left) + float(step @ (2.0 * slope + moments @ step))

    def held_back(self) -> np.ndarray:
        """Energy left in each stretch by a fit that has not seen its recording, or its stretch."""
        pieces: list[tuple[int, np.ndarray, np.ndarray]] = []
        for n, (r, slopes) in enumerate(zip(self.left, self.slopes, strict=True)):
            for some in np.array_split(np.arange(r.size), _STRETCHES):
                pieces.append((n if len(self.left) > 1 else len(pieces), r[some], slopes[:, some]))
        found = []
        for group, r, slopes in pieces:
            others = [one for one in pieces if one[0] != group]
            seen = replace(self, left=[one[1] for one in others], slopes=[one[2] for one in others])
            found.append(energy([r + seen.step @ slopes]))
        return np.array(found)

    def beats(self, other: "EquationFit") -> bool:
        """Whether held-out data are explained better, by more than the scatter of the gain."""
        gain = np.log(other.held_back() / self.held_back())
        return bool(gain.mean() > TWO_SIGMA * gain.std(ddof=1) / math.sqrt(gain.size))


def _least(curvature: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """(d,) step to the minimum of a quadratic form."""
    return np.asarray(-np.linalg.lstsq(curvature, gradient, rcond=1e-12)[0])


def with_secant(slopes: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Slopes (d, K) of residuals that changed by ``change`` (K,) on a step (d,).

    Broyden's update (1965, Math. Comp. 19, 577-593), the least one by which slopes agree with it.
    """
    return slopes + np.outer(step / (step @ step), change - step @ slopes)


def energy(left: Sequence[np.ndarray]) -> float:
    """Sum of squares of residuals (K,) of several recordings."""
    return float(sum(r @ r for r in left))
