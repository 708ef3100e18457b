"""The health index: how far a motion lies from the healthy population, and its threshold.

The index is a weighted root mean square of scores, in healthy standard deviations: the magnitudes
of the twin, the means of the residual, and its bands count as three groups, so that a few
magnitudes are not drowned by many statistics. Each score is limited so that one glitch does not
decide. The index of a run takes the mean scores of its motions. The threshold comes from healthy
runs that took no part in the calibration: a one-sided prediction bound for a new run, since runs
differ by more than motions within a run do.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

# Weight of a kind of features, and the most standard deviations that one of them counts. A
# magnitude of the twin raises an alarm alone from about four on.
WEIGHTS = {"model": (0.15, 8.0), "mean": (0.35, 4.0), "band": (0.5, 4.0)}


def health_index(scores: np.ndarray, kinds: Sequence[str]) -> np.ndarray:
    """Index (N,) of scores (N, F) of features of these kinds (F)."""
    of = np.array(kinds)
    total, weight = np.zeros(len(scores)), 0.0
    for kind, (share, limit) in WEIGHTS.items():
        own = scores[:, of == kind]
        if own.shape[1]:
            total += share * np.mean(np.clip(own, -limit, limit) ** 2, axis=1)
            weight += share
    found: np.ndarray = np.sqrt(total / weight)
    return found


def prediction_bound(index: np.ndarray, groups: np.ndarray, false_alarm_rate: float) -> float:
    """The index that a new healthy run exceeds with this probability.

    One-way random effects on the logarithm of the index; with few runs Student's t widens it.

    Parameters
    ----------
    index : (N,) array, of healthy motions
    groups : (N,) array, number of the run (and condition) of each
    false_alarm_rate : in (0, 1)
    """
    y = np.log(index)
    members = [y[groups == g] for g in np.unique(groups)]
    count, size = len(members), len(y) / len(members)
    within = float(np.mean([m.var(ddof=1) for m in members if m.size > 1] or [0.0]))
    means = np.array([m.mean() for m in members])
    between = max(float(means.var(ddof=1)) - within / size, 0.0) if count > 1 else within
    reach = student.ppf(1.0 - false_alarm_rate, max(1, count - 1))
    return float(np.exp(y.mean() + reach * np.sqrt((within + between) * (1.0 + 1.0 / count))))
