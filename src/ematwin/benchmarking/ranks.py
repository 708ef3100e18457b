"""Which algorithms differ: ranks, Friedman test, Wilcoxon pairs with Holm's correction, A12.

Demsar (2006), J. Mach. Learn. Res. 7, 1-30: algorithms are compared over cases, each case a block
and each algorithm's mean Err% of a case one number. Runs of one case are no blocks of their own:
they share the fault, so counting them would make a case ten times as sure as it is.
Holm (1979), Scand. J. Statist. 6, 65-70. Vargha and Delaney (2000), J. Educ. Behav. Stat. 25,
101-132.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from scipy.stats import friedmanchisquare, rankdata, wilcoxon

from ematwin.benchmarking.table import RunTable
from ematwin.showing.frames import frame

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
    average : average rank by algorithm, 1 is best, NaN where no case has all
    blocks : cases used; left_out : cases in which an algorithm has no result
    friedman : statistic, friedman_p : NaN where the test could not be made
    pairs : every two algorithms
    smallest_holm : float, the least corrected p that so many cases and pairs allow
    notes : what could not be computed, as sentences
    """

    average: dict[str, float]
    blocks: list[str]
    left_out: list[str]
    friedman: float
    friedman_p: float
    pairs: list[Pair]
    smallest_holm: float = math.nan
    notes: list[str] = field(default_factory=list)

    @property
    def order(self) -> list[str]:
        """Algorithms by their average rank, the best first."""
        return sorted(self.average, key=lambda name: self.average[name])

    def differ(self, first: str, second: str) -> bool:
        """Whether two algorithms differ after correction."""
        return any(
            pair.p_holm < ALPHA
            for pair in self.pairs
            if {pair.first, pair.second} == {first, second}
        )


def compare_ranks(means: Any, effects: Any) -> RankComparison:
    """Test whether algorithms differ.

    Parameters
    ----------
    means : DataFrame of cases by algorithms, mean Err%, NaN where there is none
    effects : DataFrame of `effect_sizes`
    """
    names = [str(name) for name in means.columns]
    whole = means.notna().all(axis=1)
    blocks = means[whole].to_numpy(dtype=float)
    left_out = [str(case) for case in means.index[~whole]]
    count, cases = len(names), len(blocks)
    notes = []
    if left_out:
        notes.append(
            "Left out of the rank tests, because an algorithm has no result there: "
            f"{', '.join(left_out)}."
        )
    statistic = p = math.nan
    if count < 2:
        notes.append("There is one algorithm only: nothing can be compared.")
    elif not cases:
        notes.append("No case has results of all algorithms: no ranks.")
    elif count < 3 or cases < 3:
        notes.append(
            "The Friedman test needs three algorithms and three cases; here are "
            f"{count} and {cases}."
        )
    elif np.any(np.ptp(blocks, axis=1) > 0.0):
        statistic, p = (float(value) for value in friedmanchisquare(*blocks.T))
    pairs = list(combinations(range(count), 2)) if cases else []
    plain = np.array([_wilcoxon(blocks[:, i], blocks[:, j]) for i, j in pairs])
    # all differences of one sign is the least likely outcome: 2 of 2^n ways
    smallest = min(1.0, len(pairs) * 2.0 ** (1 - cases)) if pairs else math.nan
    if smallest >= ALPHA:
        notes.append(
            f"With {cases} cases and {len(pairs)} pairs no corrected p can fall below "
            f"{smallest:.2g}: no pair can come out as different."
        )
    a12 = effects.groupby(["first", "second"], sort=False)["a12"].mean().to_dict()
    return RankComparison(
        average_ranks(means), [str(case) for case in means.index[whole]], left_out, statistic, p,
        [
            Pair(names[i], names[j], p, p_holm, a12.get((names[i], names[j]), math.nan))
            for (i, j), p, p_holm in zip(pairs, plain.tolist(), holm(plain).tolist(), strict=True)
        ],
        smallest, notes,
    )  # fmt: skip


def average_ranks(values: Any) -> dict[str, float]:
    """Give mean ranks over the rows without NaN, 1 the lowest; equal values share theirs."""
    blocks = values.dropna()
    ranks = blocks.rank(axis=1).mean() if len(blocks) else blocks.mean()
    return {str(name): float(rank) for name, rank in ranks.items()}


def _wilcoxon(x: np.ndarray, y: np.ndarray) -> float:
    """Two-sided p-value, NaN with fewer than two pairs, 1 if all are equal."""
    if len(x) < 2:
        return math.nan
    return 1.0 if np.all(x == y) else float(wilcoxon(x, y).pvalue)


def holm(p: np.ndarray) -> np.ndarray:
    """Correct p-values by Holm's step-down method."""
    order = np.argsort(p, kind="stable")
    corrected = np.empty(p.shape)
    corrected[order] = np.maximum.accumulate(p[order] * (len(p) - np.arange(len(p))))
    return np.minimum(corrected, 1.0)


def effect_sizes(table: RunTable) -> Any:
    """Give A12 by Err% of every two algorithms in each case: case, first, second, a12.

    NaN where one of the two has no run; a failed run counts as the largest error.
    """
    err = np.where(table.done, table.frame["err"].to_numpy(dtype=float), np.inf)
    samples = {cell: err[rows] for cell, rows in table.cells.items()}
    rows = [
        (case, first, second, vargha_delaney(samples[case, first], samples[case, second]))
        for case in table.cases
        for first, second in combinations(table.algorithms, 2)
    ]
    columns: Sequence[Any] = list(zip(*rows, strict=True)) or ((), (), (), ())
    return frame(dict(zip(("case", "first", "second", "a12"), columns, strict=True)))


def vargha_delaney(x: np.ndarray, y: np.ndarray) -> float:
    """Give A12: chance that a value of ``x`` is lower than one of ``y``, ties counting half."""
    if not (len(x) and len(y)):
        return math.nan
    ranks = rankdata(np.concatenate([x, y]))[: len(x)]
    higher = (ranks.sum() - len(x) * (len(x) + 1) / 2.0) / (len(x) * len(y))
    return float(1.0 - higher)
