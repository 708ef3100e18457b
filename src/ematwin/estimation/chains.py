"""Whether chains have arrived, and how many independent draws they are worth.

Autocorrelation time by Sokal's window as emcee has it (Goodman and Weare 2010, Commun. Appl. Math.
Comput. Sci. 5, 65-80); rank-normalised split R-hat by Vehtari, Gelman, Simpson, Carpenter and
Buerkner (2021), Bayesian Anal. 16, 667-718, section 3.1, the larger of that of the draws and that
of their distances from the median. Walkers of an ensemble are short chains, whose R-hat would be
large only for that; they are put together into a few, by where they set out (nested R-hat:
Margossian et al. 2024, Bayesian Anal.), so that walkers which stay in their valleys show.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

GROUPS = 4  # of walkers
# 1.01 is for one quantity; the largest of some thirty is more where each has 400 effective samples
RHAT = 1.02
_LONG_ENOUGH = 10.0  # autocorrelation times that a chain must last for its own to be believed


@dataclass(frozen=True)
class Diagnostics:
    """What is known of chains of W walkers and T steps.

    Attributes
    ----------
    rhat, tau, effective : by name of the coordinate: split R-hat, autocorrelation time in steps,
        effective samples
    steps, walkers : of what was kept
    evaluations : int, simulations altogether
    acceptance : float, share of the proposals that were taken
    wanted : float, effective samples that were asked for
    """

    rhat: dict[str, float]
    tau: dict[str, float]
    effective: dict[str, float]
    steps: int
    walkers: int
    evaluations: int
    acceptance: float
    wanted: float

    @property
    def worst(self) -> str:
        """The coordinate with the fewest effective samples."""
        return min(self.effective, key=lambda name: self.effective[name])

    @property
    def largest_rhat(self) -> tuple[str, float]:
        """Of all coordinates."""
        return max(self.rhat.items(), key=lambda one: one[1])

    @property
    def converged(self) -> bool:
        """Whether all of them have arrived."""
        return (
            self.effective[self.worst] >= self.wanted
            and self.largest_rhat[1] < RHAT
            and self.steps >= _LONG_ENOUGH * max(self.tau.values())
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; what is infinite is null."""
        rhat = {name: one if np.isfinite(one) else None for name, one in self.rhat.items()}
        return {**vars(self), "rhat": rhat, "converged": self.converged}

    def __str__(self) -> str:
        name, largest = self.largest_rhat
        return (
            f"{self.effective[self.worst]:.0f} effective samples of {self.worst} (the fewest), "
            f"largest R-hat {largest:.3f} ({name}), longest autocorrelation time "
            f"{max(self.tau.values()):.0f} steps of {self.steps}, {self.walkers} walkers, "
            f"{self.evaluations} simulations, {100.0 * self.acceptance:.0f} % accepted"
        )


def diagnosed(
    chains: np.ndarray, names: Sequence[str], *, evaluations: int, acceptance: float, wanted: float
) -> Diagnostics:
    """Diagnostics of chains (T, W, d), walkers in the order of where they set out."""
    from emcee.autocorr import integrated_time

    steps, walkers, _ = chains.shape
    with np.errstate(invalid="ignore"):
        tau = np.maximum(integrated_time(chains, tol=0, quiet=True), 1.0)
    tau = np.where(np.isfinite(tau), tau, float(steps))
    tau = np.where(np.ptp(chains, axis=(0, 1)) > 0.0, tau, 1.0)  # a valley where nobody is
    each = [split_rhat(grouped(chains[:, :, n])) for n in range(len(names))]
    return Diagnostics(
        rhat=dict(zip(names, each, strict=True)),
        tau=dict(zip(names, tau.tolist(), strict=True)),
        effective=dict(zip(names, (steps * walkers / tau).tolist(), strict=True)),
        steps=steps,
        walkers=walkers,
        evaluations=evaluations,
        acceptance=acceptance,
        wanted=wanted,
    )


def grouped(walkers: np.ndarray) -> np.ndarray:
    """(M, N) chains of walkers (T, W): groups of neighbours, their early and their late halves."""
    half = len(walkers) // 2
    parts = np.array_split(np.arange(walkers.shape[1]), min(GROUPS, walkers.shape[1]))
    size = min(len(part) for part in parts)
    return np.array([
        walkers[start : start + half, part[:size]].ravel()
        for part in parts
        for start in (0, len(walkers) - half)
    ])  # fmt: skip


def split_rhat(chains: np.ndarray) -> float:
    """Rank-normalised R-hat of chains (M, N) that are split already."""
    folded = np.abs(chains - np.median(chains))
    return max(_rhat(_normal_scores(chains)), _rhat(_normal_scores(folded)))


def _normal_scores(chains: np.ndarray) -> np.ndarray:
    """Ranks as quantiles of a normal distribution (Blom 1958); ties share the mean of theirs."""
    from scipy.special import ndtri

    _, place, count = np.unique(chains.ravel(), return_inverse=True, return_counts=True)
    ranks = np.cumsum(count) - 0.5 * (count - 1.0)
    return np.asarray(ndtri((ranks[place] - 0.375) / (chains.size + 0.25)).reshape(chains.shape))


def _rhat(chains: np.ndarray) -> float:
    count = chains.shape[1]
    within = chains.var(axis=1, ddof=1).mean()
    between = count * chains.mean(axis=1).var(ddof=1)
    if within <= 0.0:
        return 1.0 if between <= 0.0 else float("inf")
    return float(np.sqrt((count - 1.0) / count + between / (count * within)))
