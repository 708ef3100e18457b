"""Middle, spread, success and performance coefficient of every case and algorithm.

The intervals are 95 % percentile bootstrap intervals (Efron and Tibshirani 1993, chapter 13) over
repeated runs. They say how well the middle of the search results is known: how far a search with
another seed would come out. They say nothing of how uncertain a measurement is.
"""

from typing import Any

import numpy as np
from scipy.stats import bootstrap

from ematwin.benchmarking.table import RunTable
from ematwin.showing.frames import frame

METRICS = ("err", "err_wrapped", "evaluations", "seconds", "cpu_seconds")
TARGETS = (0.5, 1.0, 2.0, 5.0)  # Err%
RESAMPLES = 999
_ELEMENTS = 200_000  # of a resampled block: 1.6 MB, so that it stays in the cache
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
    cells = table.cells
    done = table.done
    kept = [rows[done[rows]] for rows in cells.values()]
    runs = np.array([len(rows) for rows in cells.values()])
    columns: dict[str, Any] = {
        "case": [case for case, _ in cells],
        "algorithm": [algorithm for _, algorithm in cells],
        "runs": runs,
        "done": [len(rows) for rows in kept],
        "failed": [n - len(rows) for n, rows in zip(runs, kept, strict=True)],
    }
    for metric in METRICS:
        values = table.frame[metric].to_numpy(dtype=float)
        found = spreads([values[rows] for rows in kept], seed)
        columns |= {f"{metric}_{name}": found[:, n] for n, name in enumerate(_SPREAD)}
    err = table.frame["err"].to_numpy(dtype=float)
    for target in targets:
        reached = np.array([(err[rows] <= target).sum() for rows in kept])
        share = np.full(len(runs), np.nan)
        columns[f"share_err_at_most_{target:g}"] = np.divide(
            reached, runs, out=share, where=runs > 0
        )
    shape = len(table.cases), len(table.algorithms)
    errors = columns["err_mean"].reshape(shape)
    for name, spent in (("", "seconds_mean"), ("_by_evaluations", "evaluations_mean")):
        coefficients = performance_coefficients(columns[spent].reshape(shape), errors)
        columns[f"performance_coefficient{name}"] = coefficients.ravel()
    return frame(columns)


def spreads(samples: list[np.ndarray], seed: int = 1) -> np.ndarray:
    """Give mean, median, quartiles and intervals of each sample, (S, 8) array.

    Samples of one length are resampled together, for speed.
    """
    found = np.full((len(samples), len(_SPREAD)), np.nan)
    lengths = np.array([len(sample) for sample in samples])
    for length in np.unique(lengths[lengths > 0]):
        members = np.flatnonzero(lengths == length)
        block = np.stack([samples[n] for n in members])
        q1, median, q3 = np.quantile(block, [0.25, 0.5, 0.75], axis=1)
        found[members, :4] = np.stack([block.mean(axis=1), median, q1, q3], axis=1)
        if length > 1:
            found[members, 4:] = _intervals(block, seed)
    return found


def _intervals(block: np.ndarray, seed: int) -> np.ndarray:
    """Ends of the intervals of mean and median of each row of (S, n), (S, 4) array."""

    def middles(sample: np.ndarray, axis: int = -1) -> np.ndarray:
        return np.stack([sample.mean(axis=axis), np.median(sample, axis=axis)])

    ends = bootstrap(
        (block,),
        middles,
        n_resamples=RESAMPLES,
        batch=max(1, _ELEMENTS // block.size),
        axis=-1,
        method="percentile",
        vectorized=True,
        random_state=np.random.default_rng(seed),
    ).confidence_interval
    return np.stack([ends.low[0], ends.high[0], ends.low[1], ends.high[1]], axis=1)


def performance_coefficients(spent: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Give the performance coefficient (paper, eq. 3) of the algorithms of each case.

        PC_i = 100 (1 - t_i err_i / sum_j t_j err_j),    j over all algorithms compared

    With A algorithms the coefficients of a case add up to 100 (A - 1): 500 with six, as the paper's
    Table 2 does. The "4" over the sum in its eq. 3 is a slip.

    Parameters
    ----------
    spent, errors : (..., A) arrays, mean time (s) or evaluations, and mean Err%

    Returns
    -------
    (..., A) array, per cent; NaN for an algorithm without a result, which is left out of the sum,
        and where fewer than two algorithms remain or all products are zero
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
