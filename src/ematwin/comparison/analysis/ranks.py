"""Which algorithms differ: ranks, Friedman test, Wilcoxon pairs with Holm's correction, A12.

Demsar (2006), J. Mach. Learn. Res. 7, 1-30: algorithms are compared over cases, each case a block
and each algorithm's mean Err% of a case one number. Runs of one case are no blocks of their own:
they share the fault, so counting them would make a case ten times as sure as it is.
Holm (1979), Scand. J. Statist. 6, 65-70. Vargha and Delaney (2000), J. Educ. Behav. Stat. 25,
101-132.
"""

import math
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy.stats import friedmanchisquare, rankdata, wilcoxon

from ematwin.comparison.analysis.runs import RunTable

ALPHA = 0.05


@dataclass(frozen=True)
class Pair:
    """Two algorithms compared.

    Attributes
    ----------
    first, second : names
    p, p_holm : Wilcoxon signed-rank over the case means, two-sided; plain and corrected
    a12 : chance that a run of ``first`` has the lower Err% than one of ``second``, ties counting
        half, averaged over the cases; 0.5 is no difference. A failed run loses to any other.
    """

    first: str
    second: str
    p: float
    p_holm: float
    a12: float


@dataclass(frozen=True)
class RankComparison:
    """Outcome of the tests.

    Attributes
    ----------
    algorithms : names; average_ranks : (A,) array, 1 is best
    blocks : cases used; left_out : cases in which an algorithm has no result
    friedman : statistic, friedman_p : NaN where the test could not be made
    pairs : every two algorithms
    smallest_holm : float, the least corrected p that so many cases and pairs allow (`least_p`)
    notes : what could not be computed, as sentences
    """

    algorithms: list[str]
    average_ranks: np.ndarray
    blocks: list[str]
    left_out: list[str]
    friedman: float
    friedman_p: float
    pairs: list[Pair]
    smallest_holm: float = math.nan
    notes: list[str] = field(default_factory=list)

    def significance(self) -> np.ndarray:
        """(A, A) array of corrected p-values, 1 where unknown and on the diagonal."""
        p = np.ones((len(self.algorithms),) * 2)
        for pair in self.pairs:
            i, j = self.algorithms.index(pair.first), self.algorithms.index(pair.second)
            p[i, j] = p[j, i] = pair.p_holm if math.isfinite(pair.p_holm) else 1.0
        return p


def compare_ranks(
    means: np.ndarray, a12: np.ndarray, cases: list[str], algorithms: list[str]
) -> RankComparison:
    """Test whether algorithms differ.

    Parameters
    ----------
    means : (C, A) array, mean Err% of each case and algorithm, NaN where there is none
    a12 : (A, A) array of `mean_effect`
    """
    complete = np.isfinite(means).all(axis=1)
    blocks = means[complete]
    used = [case for case, whole in zip(cases, complete, strict=True) if whole]
    left_out = [case for case, whole in zip(cases, complete, strict=True) if not whole]
    notes = []
    if left_out:
        notes.append(
            f"Left out of the rank tests, because an algorithm has no result there: "
            f"{', '.join(left_out)}."
        )
    count = len(algorithms)
    ranks = np.full(count, np.nan)
    statistic = p = math.nan
    if count < 2:
        notes.append("There is one algorithm only: nothing can be compared.")
    elif not len(blocks):
        notes.append("No case has results of all algorithms: no ranks.")
    else:
        ranks = average_ranks(means)
    if count >= 2 and (count < 3 or len(blocks) < 3):
        notes.append(
            f"The Friedman test needs three algorithms and three cases; here are {count} and "
            f"{len(blocks)}."
        )
    elif count >= 3 and np.any(np.ptp(blocks, axis=1) > 0.0):
        statistic, p = (float(value) for value in friedmanchisquare(*blocks.T))
    if count >= 2 and 0 < len(blocks) < 6:
        notes.append(
            f"With {len(blocks)} case{'s' if len(blocks) > 1 else ''} no pair can come out "
            "significant, whatever the data: the Wilcoxon test needs at least six."
        )
    pairs = list(combinations(range(count), 2))
    smallest = min(1.0, len(pairs) * least_p(len(blocks))) if pairs else math.nan
    if len(blocks) >= 6 and smallest >= ALPHA:
        notes.append(
            f"With {len(blocks)} cases and {len(pairs)} pairs no corrected p can fall below "
            f"{smallest:.2g}: no pair can come out significant, whatever the data."
        )
    plain = [_wilcoxon(blocks[:, i], blocks[:, j]) for i, j in pairs]
    corrected = holm(np.array(plain))
    return RankComparison(
        algorithms, ranks, used, left_out, statistic, p,
        [
            Pair(algorithms[i], algorithms[j], plain[n], float(corrected[n]), float(a12[i, j]))
            for n, (i, j) in enumerate(pairs)
        ],
        smallest, notes,
    )  # fmt: skip


def average_ranks(values: np.ndarray) -> np.ndarray:
    """(A,) mean ranks over the rows of (C, A) without NaN, 1 the lowest; equal values share theirs.

    NaN where no row is whole.
    """
    blocks = values[~np.isnan(values).any(axis=1)]
    if not len(blocks):
        return np.full(values.shape[1], np.nan)
    return np.asarray(rankdata(blocks, axis=1).mean(axis=0))


def least_p(blocks: int) -> float:
    """Least two-sided p of Wilcoxon's exact test: every difference of one sign, 2 of 2^n ways."""
    return min(1.0, 2.0 ** (1 - blocks))


def _wilcoxon(x: np.ndarray, y: np.ndarray) -> float:
    """Two-sided p-value, NaN with fewer than two pairs, 1 if all are equal."""
    if len(x) < 2:
        return math.nan
    if np.all(x == y):
        return 1.0
    return float(wilcoxon(x, y).pvalue)


def holm(p: np.ndarray) -> np.ndarray:
    """Holm's step-down correction; NaN stays NaN and does not count."""
    corrected = np.full(p.shape, np.nan)
    known = np.flatnonzero(np.isfinite(p))
    order = known[np.argsort(p[known], kind="stable")]
    factors = len(order) - np.arange(len(order))
    corrected[order] = np.minimum(np.maximum.accumulate(p[order] * factors), 1.0)
    return corrected


def vargha_delaney(x: np.ndarray, y: np.ndarray) -> float:
    """A12: chance that a value of ``x`` is lower than one of ``y``, ties counting half."""
    if not (len(x) and len(y)):
        return math.nan
    ranks = rankdata(np.concatenate([x, y]))[: len(x)]
    higher = (ranks.sum() - len(x) * (len(x) + 1) / 2.0) / (len(x) * len(y))
    return float(1.0 - higher)


def effect_sizes(table: RunTable) -> np.ndarray:
    """(C, A, A) array of A12 by Err% in each case, NaN where one of the two has no run."""
    err = np.where(table.done, table.scalars["err"], np.inf)
    count = len(table.algorithms)
    found = np.full((len(table.cases), count, count), np.nan)
    for c in range(len(table.cases)):
        samples = [err[table.cell(c, a)] for a in range(count)]
        for i, j in combinations(range(count), 2):
            found[c, i, j] = vargha_delaney(samples[i], samples[j])
            found[c, j, i] = 1.0 - found[c, i, j]
    return found


def mean_effect(a12: np.ndarray) -> np.ndarray:
    """(A, A) array, the mean of (C, A, A) over the cases in which both have runs."""
    known = np.isfinite(a12)
    total = np.where(known, a12, 0.0).sum(axis=0)
    return np.divide(total, known.sum(axis=0), out=np.full(total.shape, np.nan),
                     where=known.any(axis=0))  # fmt: skip
