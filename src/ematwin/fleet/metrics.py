"""Metrics of prognoses, and of quantities that prognoses could rest on, by the names of the field.

Of predictions, each a `Life` at its moment: prognostic horizon, alpha-lambda, relative accuracy and
its cumulative form, convergence (Saxena et al. 2010, Int. J. Progn. Health Manag. 1(1)). Of
quantities: monotonicity, trendability, prognosability (Coble and Hines 2009, Annual Conf. PHM
Society).
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ematwin.errors import InputError
from ematwin.fleet.life import Life


def _ordered(predictions: Sequence[Life], end: float) -> list[Life]:
    if not predictions:
        raise InputError("Metrics need at least one prediction; none was given.")
    found = sorted(predictions, key=lambda one: one.moment)
    if not found[-1].moment < end:
        raise InputError(
            f"Predictions are made before the end of life, {end:g}; received one at "
            f"{found[-1].moment:g}."
        )
    return found


def is_accurate(one: Life, end: float, alpha: float = 0.2, beta: float = 0.5) -> bool:
    """Whether a share ``beta`` of the draws lies within ``alpha`` of the actual life left."""
    left = end - one.moment
    return _near(one, left, alpha * left) >= beta


def _near(one: Life, life: float, reach: float) -> float:
    """Probability of a life left within ``reach`` of another one."""
    return float(np.mean(np.abs(one.draws - life) <= reach))


def prognostic_horizon(
    predictions: Sequence[Life], end: float, alpha: float = 0.2, beta: float = 0.5,
    begin: float = 0.0,
) -> float:  # fmt: skip
    """Life left when predictions first are good enough, and stay so until the end; 0 if never.

    Good enough: ``beta`` of the draws end within ``alpha`` of the whole life, ``end - begin``.
    """
    reach, horizon = alpha * (end - begin), 0.0
    for one in reversed(_ordered(predictions, end)):
        if _near(one, end - one.moment, reach) < beta:
            break
        horizon = end - one.moment
    return horizon


def alpha_lambda(
    predictions: Sequence[Life], end: float, share: float = 0.5, alpha: float = 0.2,
    beta: float = 0.5, begin: float = 0.0,
) -> bool:  # fmt: skip
    """Whether the prediction closest to a share lambda of the whole life is accurate."""
    moment = begin + share * (end - begin)
    nearest = min(_ordered(predictions, end), key=lambda one: abs(one.moment - moment))
    return is_accurate(nearest, end, alpha, beta)


def relative_accuracy(one: Life, end: float) -> float:
    """One less the relative error of the median; 0 where that is larger than the life left."""
    left = end - one.moment
    error = abs(one.median - left) / left
    return max(0.0, 1.0 - error) if np.isfinite(error) else 0.0


def cumulative_relative_accuracy(predictions: Sequence[Life], end: float) -> float:
    """Mean of the relative accuracy of all predictions."""
    return float(np.mean([relative_accuracy(one, end) for one in _ordered(predictions, end)]))


def convergence(predictions: Sequence[Life], end: float) -> float:
    """Distance from the origin to the centre below the curve of the error of the median.

    In units of time and error; the smaller, the faster errors fall. Predictions without a median
    do not count.
    """
    kept = [one for one in _ordered(predictions, end) if np.isfinite(one.median)]
    if len(kept) < 2:
        return float("nan")
    time = np.array([one.moment for one in kept])
    error = np.array([abs(one.median - (end - one.moment)) for one in kept])
    steps = np.diff(time)
    area = float((steps * error[:-1]).sum())
    if area == 0.0:
        return 0.0
    at = 0.5 * float((np.diff(time**2) * error[:-1]).sum()) / area
    height = 0.5 * float((steps * error[:-1] ** 2).sum()) / area
    return float(np.hypot(at - time[0], height))


def monotonicity(histories: Sequence[np.ndarray]) -> float:
    """Mean of |steps up less steps down| over all steps; 1 for histories that only rise."""
    shares = [
        abs(float(np.sign(np.diff(one)).sum())) / max(len(one) - 1, 1)
        for one in map(np.asarray, histories)
    ]
    return float(np.mean(shares))


def trendability(histories: Sequence[np.ndarray]) -> float:
    """Smallest correlation between any two histories, brought to one length."""
    length = min(len(one) for one in histories)
    place = np.linspace(0.0, 1.0, length)
    alike = [np.interp(place, np.linspace(0.0, 1.0, len(one)), one) for one in histories]
    pairs = [abs(float(np.corrcoef(a, b)[0, 1])) for a, b in combinations(alike, 2)]
    return min(pairs, default=float("nan"))


def prognosability(histories: Sequence[np.ndarray]) -> float:
    """How alike values at failure are, beside how far they came: exp(-deviation / mean range)."""
    ends = np.array([one[-1] for one in histories])
    reach = np.mean([abs(float(one[-1] - one[0])) for one in histories])
    return float(np.exp(-np.std(ends, ddof=1) / reach)) if len(ends) > 1 else float("nan")
