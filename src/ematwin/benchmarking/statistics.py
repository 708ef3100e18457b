"""Statistics of a study: middle, spread and success of each case and algorithm, and rank tests.

Intervals are 95 % percentile bootstrap intervals (Efron and Tibshirani 1993, chapter 13) over
repeated runs. They describe how far a search with another seed would come out, and say nothing of
how uncertain a measurement is.

Algorithms are compared over cases (Demsar 2006, J. Mach. Learn. Res. 7, 1-30): each case is a
block, and each algorithm's mean Err% of a case one number. Runs of one case are no blocks of their
own: they share the fault, so counting them would make a case ten times as sure as it is.
Correction: Holm (1979), Scand. J. Statist. 6, 65-70. A12: Vargha and Delaney (2000), J. Educ.
Behav. Stat. 25, 101-132.

Diagnosis is measured as diagnosis (`diagnose`). A fault is present from ``threshold`` of its range
away from healthy, in the injected vector as in the one found. An injected deviation below the
threshold, but not zero, is neither: reporting it is no false alarm, and passing over it is no miss.
The direction of a fault is not a fault; where the fault was injected and found, directions with an
error of ``threshold`` of a turn or more are counted separately.
"""

import math
from collections import Counter
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import numpy as np
from scipy.stats import bootstrap, friedmanchisquare, wilcoxon

from ematwin.benchmarking.table import RunTable
from ematwin.showing.results import frame

ALPHA = 0.05
TARGETS = (0.5, 1.0, 2.0, 5.0)  # Err%
THRESHOLD = 0.05  # of a diagnosis
RESAMPLES = 999
_SPREAD = (
    "mean", "median", "q1", "q3", "mean_low_95", "mean_high_95", "median_low_95", "median_high_95",
)  # fmt: skip


def summarise(table: RunTable, targets: tuple[float, ...] = TARGETS, seed: int = 1) -> Any:
    """Summarise each case and algorithm in a row of a DataFrame.

    Its columns are case, algorithm, runs, done, failed; of each metric mean, median, quartiles and
    the intervals of mean and median over the runs that ended well, NaN where there are too few; the
    share of all runs, failed ones included, that came to each target of Err%; and the performance
    coefficient by seconds and by evaluations (`performance_coefficients`).
    """
    kept = [rows[table.done[rows]] for rows in table.cells.values()]
    cells = frame({
        "case": [case for case, _ in table.cells],
        "algorithm": [algorithm for _, algorithm in table.cells],
        "runs": [len(rows) for rows in table.cells.values()],
        "done": [len(rows) for rows in kept],
    })  # fmt: skip
    cells["failed"] = cells["runs"] - cells["done"]
    for metric in ("err", "err_wrapped", "evaluations", "seconds", "cpu_seconds"):
        values = table.frame[metric].to_numpy(dtype=float)
        cells[[f"{metric}_{name}" for name in _SPREAD]] = spreads([values[r] for r in kept], seed)
    err = table.frame["err"].to_numpy(dtype=float)
    for target in targets:
        reached = [(err[rows] <= target).sum() for rows in kept]
        cells[f"share_err_at_most_{target:g}"] = reached / cells["runs"].replace(0, np.nan)
    shape = len(table.cases), len(table.algorithms)
    for name, spent in (("", "seconds_mean"), ("_by_evaluations", "evaluations_mean")):
        pair = (cells[column].to_numpy().reshape(shape) for column in (spent, "err_mean"))
        cells[f"performance_coefficient{name}"] = performance_coefficients(*pair).ravel()
    return cells


def spreads(samples: list[np.ndarray], seed: int = 1) -> np.ndarray:
    """Give mean, median, quartiles and intervals of each sample, (S, 8) array."""

    def middles(sample: np.ndarray, axis: int = -1) -> np.ndarray:
        return np.stack([sample.mean(axis=axis), np.median(sample, axis=axis)])

    found = np.full((len(samples), len(_SPREAD)), np.nan)
    lengths = np.array([len(sample) for sample in samples])
    for length in np.unique(lengths[lengths > 0]):
        members = np.flatnonzero(lengths == length)
        block = np.stack([samples[n] for n in members])
        q1, median, q3 = np.quantile(block, [0.25, 0.5, 0.75], axis=1)
        found[members, :4] = np.stack([block.mean(axis=1), median, q1, q3], axis=1)
        if length > 1:
            ends = bootstrap(
                # blocks of 1.6 MB stay in the cache
                (block,), middles, n_resamples=RESAMPLES, batch=max(1, 200_000 // block.size),
                axis=-1, method="percentile", vectorized=True,
                random_state=np.random.default_rng(seed),
            ).confidence_interval  # fmt: skip
            found[members, 4:] = np.stack([ends.low, ends.high], axis=1).reshape(4, -1).T
    return found


def performance_coefficients(spent: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Give the performance coefficient (paper, eq. 3) of the A algorithms of each case, per cent.

        PC_i = 100 (1 - t_i err_i / sum_j t_j err_j),    j over all algorithms compared

    of mean time (s) or evaluations and mean Err%, (..., A) arrays. The coefficients of a case add
    up to 100 (A - 1): 500 with six, as the paper's Table 2 does. The "4" over the sum in its eq. 3
    is a slip. NaN for an algorithm without a result, which is left out of the sum, and where fewer
    than two algorithms remain or all products are zero.
    """
    product = np.asarray(spent, dtype=float) * np.asarray(errors, dtype=float)
    known = np.isfinite(product)
    total = np.where(known, product, 0.0).sum(axis=-1, keepdims=True)
    possible = known & (known.sum(axis=-1, keepdims=True) >= 2) & (total > 0.0)
    share = np.divide(product, total, out=np.full(product.shape, np.nan), where=possible)
    return np.asarray(100.0 * (1.0 - share))


def matrix(cells: Any, column: str) -> Any:
    """Give a column of `summarise` as a DataFrame of cases by algorithms, in their order."""
    return cells.pivot(index="case", columns="algorithm", values=column).reindex(
        index=cells["case"].unique(), columns=cells["algorithm"].unique()
    )


def effect_sizes(table: RunTable) -> Any:
    """Give A12 by Err% of every two algorithms in each case: case, first, second, a12.

    NaN where one of the two has no run; a failed run counts as the largest error.
    """
    err = np.where(table.done, table.frame["err"].to_numpy(dtype=float), np.inf)
    samples = {cell: err[rows] for cell, rows in table.cells.items()}
    rows = [
        (case, *pair, vargha_delaney(*(samples[case, name] for name in pair)))
        for case in table.cases
        for pair in combinations(table.algorithms, 2)
    ]
    names = ("case", "first", "second", "a12")
    return frame({name: [row[n] for row in rows] for n, name in enumerate(names)})


def vargha_delaney(x: np.ndarray, y: np.ndarray) -> float:
    """Give A12: chance that a value of ``x`` is lower than one of ``y``, ties counting half."""
    if not (len(x) and len(y)):
        return math.nan
    x = x[:, None]
    return 1.0 - float(np.mean((x > y) + 0.5 * (x == y)))


@dataclass(frozen=True)
class RankComparison:
    """Outcome of the tests."""

    average: dict[str, float]  # average rank by algorithm, 1 is best, NaN where no case has all
    blocks: list[str]  # cases used, and cases in which an algorithm has no result
    left_out: list[str]
    friedman: float  # statistic and p; NaN where the test could not be made
    friedman_p: float
    # DataFrame of every two algorithms (first, second); p, p_holm: Wilcoxon signed-rank over the
    # case means, two-sided, plain and corrected; a12: chance that a run of the first has the lower
    # Err%, ties counting half, averaged over the cases; a failed run loses to any other
    pairs: Any
    smallest_holm: float  # the least corrected p that so many cases and pairs allow
    notes: list[str]  # what could not be computed, as sentences

    @property
    def order(self) -> list[str]:
        """Algorithms by their average rank, the best first."""
        return sorted(self.average, key=self.average.__getitem__)

    @property
    def different(self) -> Any:
        """Whether each pair differs after correction."""
        return self.pairs["p_holm"] < ALPHA

    def differ(self, first: str, second: str) -> bool:
        """Whether two algorithms differ after correction."""
        both = self.pairs[["first", "second"]].isin([first, second]).all(axis=1)
        return bool((both & self.different).any())

    def behind(self, better: str) -> list[str]:
        """Algorithms of higher rank that differ from one after correction, in order."""
        worse = self.order[self.order.index(better) + 1 :]
        return [other for other in worse if self.differ(better, other)]


def compare_ranks(means: Any, effects: Any) -> RankComparison:
    """Test whether algorithms differ, by mean Err% of cases by algorithms and `effect_sizes`."""
    whole = means.dropna()
    names, blocks = [str(name) for name in means], whole.to_numpy(dtype=float)
    left_out = [str(case) for case in means.index if case not in whole.index]
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
        statistic, p = map(float, friedmanchisquare(*blocks.T))
    pairs = list(combinations(names, 2)) if cases else []
    plain = np.array([_wilcoxon(whole[first], whole[second]) for first, second in pairs])
    # all differences of one sign is the least likely outcome: 2 of 2^n ways
    smallest = min(1.0, len(pairs) * 2.0 ** (1 - cases)) if pairs else math.nan
    if smallest >= ALPHA:
        notes.append(
            f"With {cases} cases and {len(pairs)} pairs no corrected p can fall below "
            f"{smallest:.2g}: no pair can come out as different."
        )
    a12 = effects.groupby(["first", "second"], sort=False)["a12"].mean().to_dict()
    return RankComparison(
        {str(name): float(rank) for name, rank in whole.rank(axis=1).mean().items()},
        [str(case) for case in whole.index], left_out, statistic, p,
        frame({
            "first": [first for first, _ in pairs], "second": [second for _, second in pairs],
            "p": plain, "p_holm": holm(plain),
            "a12": [a12.get(pair, math.nan) for pair in pairs],
        }),
        smallest, notes,
    )  # fmt: skip


def _wilcoxon(x: Any, y: Any) -> float:
    """Two-sided p-value, NaN with fewer than two pairs, 1 if all are equal."""
    if len(x) < 2:
        return math.nan
    return 1.0 if np.all(x == y) else float(wilcoxon(x, y).pvalue)


def holm(p: np.ndarray) -> np.ndarray:
    """Correct p-values by Holm's step-down method."""
    order = np.argsort(p, kind="stable")
    corrected = np.empty(p.shape)
    corrected[order] = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    return np.minimum(corrected, 1.0)


def diagnose(table: RunTable, threshold: float = THRESHOLD) -> Any:
    """Count the faults that each algorithm would have named, in a row of a DataFrame.

    Over its runs that ended well:

        runs, without : runs that ended well, and failed runs, which diagnosed nothing
        exact : runs that named the faults exactly: none missed, none false
        faults, missed : injected faults, and how many of them were passed over
        chances, false_alarms : healthy components, and how many of them were called faulty
        confused : runs that missed a fault and named a healthy component instead
        directions, direction_wrong : faults found that have a direction, and those with it turned
        confusions : dict, (missed, named instead) -> runs
    """
    done, subject = table.done, table.subject
    injected, found = (
        table.frame.reindex(columns=[f"{which}_{name}" for name in subject.names]).to_numpy(float)
        for which in ("injected", "found")
    )
    width, slack = subject.upper - subject.lower, 1e-12  # 0.55 - 0.5 is less than 0.05
    least = threshold - slack
    deviation = np.abs(injected - subject.healthy) / width
    faulty = (deviation >= least) & done[:, None]
    called = (np.abs(found - subject.healthy) / width >= least) & done[:, None]
    present, named = (part[:, subject.magnitudes] for part in (faulty, called))
    absent = (deviation[:, subject.magnitudes] <= slack) & done[:, None]
    missed, false = present & ~named, absent & named
    confused = missed.any(axis=1) & false.any(axis=1)
    directed, turned = np.zeros((2, len(table)), dtype=int)
    for magnitude, direction in subject.directions:
        both = faulty[:, magnitude] & called[:, magnitude]
        turn = (found - injected)[:, direction] / width[direction]
        directed += both
        turned += both & (np.abs(turn - np.round(turn)) >= least)
    algorithm = table.frame["algorithm"]
    counts = frame({
        "runs": done, "without": ~done,
        "exact": done & ~missed.any(axis=1) & ~false.any(axis=1),
        "faults": present.sum(axis=1), "missed": missed.sum(axis=1),
        "chances": absent.sum(axis=1), "false_alarms": false.sum(axis=1), "confused": confused,
        "directions": directed, "direction_wrong": turned,
    }).groupby(algorithm).sum().reindex(table.algorithms)  # fmt: skip
    names = np.array(subject.names)[subject.magnitudes]
    confusions = {name: Counter[tuple[str, str]]() for name in table.algorithms}
    for run in np.flatnonzero(confused):
        confusions[algorithm[run]].update(product(names[missed[run]], names[false[run]]))
    counts["confusions"] = [dict(one.most_common()) for one in confusions.values()]
    return counts.reset_index()
