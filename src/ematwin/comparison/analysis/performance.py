"""Performance coefficient (paper, eq. 3) and its likeness to the paper's Table 2.

    PC_i = 100 (1 - t_i err_i / sum_j t_j err_j),    j over all algorithms compared

With A algorithms the coefficients of a case add up to 100 (A - 1): 500 with six, as the paper's
Table 2 does. The "4" over the sum in its eq. 3 is a slip.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import kendalltau, spearmanr

from ematwin.comparison.analysis.paper import PAPER_KIND, paper_coefficients


def performance_coefficients(seconds: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """PC of the algorithms of each case.

    Parameters
    ----------
    seconds, errors : (..., A) arrays, mean time (s) and mean Err% of each algorithm

    Returns
    -------
    (..., A) array, per cent; NaN for an algorithm without a result, which is left out of the sum,
        and where fewer than two algorithms remain or all products are zero
    """
    product = np.asarray(seconds, dtype=float) * np.asarray(errors, dtype=float)
    known = np.isfinite(product)
    total = np.where(known, product, 0.0).sum(axis=-1, keepdims=True)
    possible = known & (known.sum(axis=-1, keepdims=True) >= 2) & (total > 0.0)
    share = np.divide(product, total, out=np.full(product.shape, np.nan), where=possible)
    return np.asarray(100.0 * (1.0 - share))


@dataclass(frozen=True)
class Likeness:
    """Rank correlation of two lists; NaN where fewer than three pairs or no variation.

    Attributes
    ----------
    spearman, kendall : float, -1 to 1
    pairs : int
    """

    spearman: float
    kendall: float
    pairs: int


@dataclass(frozen=True)
class PaperLikeness:
    """How alike the order of the algorithms is here and in the paper's Table 2.

    Attributes
    ----------
    cells : over all cells at once. The cells of a case are not independent (they add up to a
        constant), so no p-value is given.
    average : of the averages over the cases
    by_case : each case for itself
    """

    cells: Likeness
    average: Likeness
    by_case: dict[str, Likeness]


def likeness(ours: np.ndarray, theirs: np.ndarray) -> Likeness:
    """Rank correlation of the finite pairs."""
    both = np.isfinite(ours) & np.isfinite(theirs)
    x, y = ours[both], theirs[both]
    if len(x) < 3 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return Likeness(math.nan, math.nan, len(x))
    return Likeness(float(spearmanr(x, y).statistic), float(kendalltau(x, y).statistic), len(x))


def likeness_to_paper(
    coefficients: np.ndarray, cases: list[str], algorithms: list[str], kind: str = PAPER_KIND
) -> PaperLikeness:
    """Rank correlation of our Table 2, (C, A), with the paper's."""
    theirs = paper_coefficients(cases, algorithms, kind)
    both = np.isfinite(theirs) & np.isfinite(coefficients)
    ours = np.where(both, coefficients, np.nan)
    theirs = np.where(both, theirs, np.nan)
    shared = both.any(axis=1)
    return PaperLikeness(
        likeness(ours.ravel(), theirs.ravel()),
        likeness(_average(ours[shared]), _average(theirs[shared])),
        {case: likeness(ours[c], theirs[c]) for c, case in enumerate(cases) if shared[c]},
    )


def _average(values: np.ndarray) -> np.ndarray:
    """Mean over the cases, where an algorithm has all of them."""
    return values.mean(axis=0) if len(values) else np.full(values.shape[1], np.nan)
