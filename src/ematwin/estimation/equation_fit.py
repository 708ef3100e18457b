"""The linearised fit of one equation along the recorded motion to all recordings.

It tells what would be left of other residuals if all that is fitted were fitted anew, and what is
left of stretches that the fit has not seen (cross-validation).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ematwin.estimation.constants import TWO_SIGMA
from ematwin.models.parameter_set import ParameterSet

_STRETCHES = 6  # of a recording, each counted once


@dataclass(frozen=True)
class EquationFit:
    """A fit of one equation to all recordings.

    Attributes
    ----------
    actuator : ParameterSet, with the values found
    places : of the d fitted parameters
    left : of each recording (K,), as shares of the norm of all that is to be explained
    slopes : of each recording (d, K), by the coordinates of the fit
    pull, prior : (d,) and (d, d), gradient and curvature of the prior, in the unit of the cost
    weight : float, the cost of an independent residual
    alike : float, the same for the idealisation error of the equations, one sample in all
    """

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
        return _step(self.left, self.slopes, self.prior, self.pull)

    @property
    def information(self) -> tuple[np.ndarray, np.ndarray]:
        """Inverse covariance (d, d) and its gradient (d,) here, by the recordings alone."""
        unit = self.weight + self.alike
        data = sum((one @ one.T for one in self.slopes), np.zeros_like(self.prior))
        slope = sum(one @ r for one, r in zip(self.slopes, self.left, strict=True))
        return data / unit, np.asarray(slope) / unit

    def projected(self, left: Sequence[np.ndarray], scaled: bool) -> float:
        """What would be left of other residuals if all that is fitted were fitted anew.

        With ``scaled`` the change from this fit's residuals to them may be of any size, as that by
        a parameter of a form is; infinite where the size would be negative, which no form has.
        """
        slopes, prior, pull = self.slopes, self.prior, self.pull
        if scaled:
            slopes = [
                np.vstack([one, r - before])
                for one, r, before in zip(slopes, left, self.left, strict=True)
            ]
            prior, pull = np.pad(prior, (0, 1)), np.pad(pull, (0, 1))
        step = _step(left, slopes, prior, pull)
        if scaled and step[-1] < -1.0:
            return math.inf
        return energy([r + step @ one for r, one in zip(left, slopes, strict=True)])

    def held_back(self) -> np.ndarray:
        """Energy left in each stretch by a fit that has not seen its recording, or its stretch."""
        pieces: list[tuple[int, np.ndarray, np.ndarray]] = []
        for n, (r, slopes) in enumerate(zip(self.left, self.slopes, strict=True)):
            for some in np.array_split(np.arange(r.size), _STRETCHES):
                pieces.append((n if len(self.left) > 1 else len(pieces), r[some], slopes[:, some]))
        found = []
        for group, r, slopes in pieces:
            others = [one for one in pieces if one[0] != group]
            seen, moved = [one[1] for one in others], [one[2] for one in others]
            found.append(energy([r + _step(seen, moved, self.prior, self.pull) @ slopes]))
        return np.array(found)

    def beats(self, other: "EquationFit") -> bool:
        """Whether held-out data are explained better, by more than the scatter of the gain."""
        gain = np.log(other.held_back() / self.held_back())
        return bool(gain.mean() > TWO_SIGMA * gain.std(ddof=1) / math.sqrt(gain.size))


def _step(
    left: Sequence[np.ndarray], slopes: Sequence[np.ndarray], prior: np.ndarray, pull: np.ndarray
) -> np.ndarray:
    """(d,) step to the least squares of linearised residuals and the prior."""
    curvature = prior + sum(one @ one.T for one in slopes)
    gradient = pull + sum(one @ r for one, r in zip(slopes, left, strict=True))
    return np.asarray(-np.linalg.lstsq(curvature, gradient, rcond=1e-12)[0])


def with_secant(slopes: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Slopes (d, K) of residuals that changed by ``change`` (K,) on a step (d,).

    Broyden's update (1965, Math. Comp. 19, 577-593), the least one by which slopes agree with it.
    """
    return slopes + np.outer(step / (step @ step), change - step @ slopes)


def energy(left: Sequence[np.ndarray]) -> float:
    """Sum of squares of residuals (K,) of several recordings."""
    return float(sum(r @ r for r in left))
