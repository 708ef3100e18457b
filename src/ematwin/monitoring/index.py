"""The health index: how far a motion lies from the healthy population, and its threshold.

The index is the root mean square of the scores of all features, in healthy standard deviations,
each limited so that one glitch does not decide. That of a run takes the mean scores of its
motions. The threshold comes from healthy runs that took no part in the calibration: a one-sided
prediction bound for a new run, since runs differ by more than motions within a run do.
"""

import numpy as np
from scipy.stats import t as student

LIMIT = 4.0  # standard deviations, the most that one feature counts


def health_index(scores: np.ndarray) -> np.ndarray:
    """Index (N,) of scores (N, F)."""
    limited = np.clip(scores, -LIMIT, LIMIT)
    found: np.ndarray = np.sqrt((limited**2).mean(axis=-1))
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
