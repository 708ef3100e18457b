"""The health index: how far a recording lies from the healthy population, and its threshold.

The index is a weighted root mean square of scores, in healthy standard deviations: the magnitudes
of the twin, the means of the residual, and its bands count as three groups, so that a few
magnitudes are not drowned by many statistics. Each score is limited so that one glitch does not
decide. The index of a run takes the mean scores of its recordings. The threshold comes from healthy
runs, each judged by the others: a one-sided prediction bound for a new run, since runs differ by
more than recordings within a run do.

Runs of one occasion say nothing of how far occasions differ. The allowance for that is an
assumption (`DRIFT`).
"""

from collections.abc import Sequence

import numpy as np

# Weight of a kind of features, and the most standard deviations that one of them counts. A
# magnitude of the twin raises an alarm alone from about four on; its limit is that of one in three.
WEIGHTS = {"model": (0.15, 8.0), "mean": (0.35, 4.0), "band": (0.5, 4.0)}

# Scatter of the logarithm of the index, within a run and between runs: 0.14 and 0.13 on the healthy
# runs of docs/real-recordings.md, each judged by the others.
TYPICAL = (0.14, 0.13)
TYPICAL_RUNS = 2
USUAL_RATE = 0.1  # of a healthy recording, or run, of another day

# Healthy deviations by which one magnitude and the level of one channel may move together from one
# occasion to the next: an assumption, since healthy recordings of one occasion cannot show it. It
# was set with drift made up on scores of the healthy runs of docs/real-recordings.md: at two
# deviations the plain threshold calls seven in ten motions under the drifting load.
DRIFT = 2.0


def health_index(scores: np.ndarray, kinds: Sequence[str]) -> np.ndarray:
    """Index (N,) of scores (N, F) of features of these kinds (F)."""
    of = np.array(kinds)
    total, weight = np.zeros(len(scores)), 0.0
    for kind, (share, _) in WEIGHTS.items():
        own = scores[:, of == kind]
        if own.shape[1]:
            limit = limit_of(kind, own.shape[1])
            total += share * np.mean(np.clip(own, -limit, limit) ** 2, axis=1)
            weight += share
    found: np.ndarray = np.sqrt(total / weight)
    return found


def limit_of(kind: str, count: int) -> float:
    """The most that one score of ``count`` features of a kind counts.

    The limit of a magnitude grows with their number, so that a single one always reaches as far.
    """
    limit = WEIGHTS[kind][1]
    return limit * float(np.sqrt(count / 3.0)) if kind == "model" else limit


def single_reach(kinds: Sequence[str] = tuple(WEIGHTS)) -> float:
    """The index where one magnitude is at its limit, and all else as usual."""
    here = set(kinds)
    weight = sum(share for kind, (share, _) in WEIGHTS.items() if kind in here)
    share, limit = WEIGHTS["model"]
    return float(np.sqrt((share * limit**2 / 3.0 + weight - share) / weight))


def clear_limit(threshold: float, kinds: Sequence[str], channels: int) -> float:
    """The index from which no drift between occasions explains a change, as `DRIFT` assumes.

    Parameters
    ----------
    threshold : of the index
    kinds : of the features
    channels : that are compared, which share the means of the residual evenly
    """
    of = list(kinds)
    shares = {kind: share for kind, (share, _) in WEIGHTS.items() if kind in of}
    moved = shares.get("model", 0.0) / max(1, of.count("model"))
    moved += shares.get("mean", 0.0) / max(1, channels)
    return float(np.hypot(threshold, DRIFT * np.sqrt(moved / sum(shares.values()))))


def prediction_bound(index: np.ndarray, groups: np.ndarray, false_alarm_rate: float) -> float:
    """The index that a new healthy run exceeds with this probability.

    One-way random effects on the logarithm of the index. With few runs their scatter is hardly
    known, and Student's t alone would put the bound where no fault reaches; so the typical scatter
    of a real rig (`TYPICAL`) counts as much as `TYPICAL_RUNS`.

    Parameters
    ----------
    index : (N,) array, of healthy recordings
    groups : (N,) array, number of the run (and condition) of each
    false_alarm_rate : in (0, 1)
    """
    from scipy.special import stdtrit  # takes longer to import than a motion to judge

    y = np.log(index)
    members = [y[groups == g] for g in np.unique(groups)]
    count = len(members)
    inner = sum(float(((m - m.mean()) ** 2).sum()) for m in members)
    means = np.array([m.mean() for m in members])
    outer = float(((means - means.mean()) ** 2).sum())
    within = _with_prior(inner, y.size - count, TYPICAL[0])
    between = _with_prior(outer, count - 1, TYPICAL[1])
    if y.size == count:  # single recordings: their scatter holds both, and so does the prior
        within, between = 0.0, _with_prior(outer, count - 1, float(np.hypot(*TYPICAL)))
    reach = stdtrit(count - 1 + TYPICAL_RUNS, 1.0 - false_alarm_rate)
    return float(np.exp(means.mean() + reach * np.sqrt((within + between) * (1.0 + 1.0 / count))))


def _with_prior(squares: float, freedom: int, typical: float) -> float:
    """Variance from a sum of squares and a typical value."""
    return (squares + TYPICAL_RUNS * typical**2) / (freedom + TYPICAL_RUNS)
