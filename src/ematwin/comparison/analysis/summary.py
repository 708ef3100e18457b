"""Middle, spread and success of every case and algorithm.

The intervals are 95 % percentile bootstrap intervals (Efron and Tibshirani 1993, chapter 13) over
repeated runs. They say how well the middle of the search results is known: how far a search with
another seed would come out. They say nothing of how uncertain a measurement is.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import bootstrap

from ematwin.comparison.analysis.runs import RunTable

METRICS = ("err", "err_wrapped", "evaluations", "seconds", "cpu_seconds")
TARGETS = (0.5, 1.0, 2.0, 5.0)  # Err%
RESAMPLES = 999
MANY = 200  # runs of a cell, above which fewer resamples are drawn
RESAMPLES_OF_MANY = 299
_ELEMENTS = 200_000  # of a resampled block: 1.6 MB, so that it stays in the cache


@dataclass(frozen=True)
class Spread:
    """Middle and spread over the runs that ended well; NaN where there are too few.

    Attributes
    ----------
    mean, median, q1, q3 : float
    mean_interval, median_interval : (low, high), bootstrap, NaN with fewer than two runs
    """

    mean: float = math.nan
    median: float = math.nan
    q1: float = math.nan
    q3: float = math.nan
    mean_interval: tuple[float, float] = (math.nan, math.nan)
    median_interval: tuple[float, float] = (math.nan, math.nan)

    @property
    def iqr(self) -> float:
        """Interquartile range."""
        return self.q3 - self.q1


@dataclass(frozen=True)
class Cell:
    """A case and an algorithm.

    Attributes
    ----------
    runs, done : int; the others failed
    metrics : `Spread` of each of `METRICS`
    success : share of all runs, failed ones included, that came to a target of Err%
    """

    case: str
    algorithm: str
    runs: int
    done: int
    metrics: dict[str, Spread]
    success: dict[float, float]

    @property
    def failed(self) -> int:
        """Runs that did not end well."""
        return self.runs - self.done


def summarise(
    table: RunTable, targets: tuple[float, ...] = TARGETS, seed: int = 1
) -> list[list[Cell]]:
    """`Cell` of each case (rows) and algorithm (columns)."""
    done = table.done
    places = [
        (c, a, table.cell(c, a))
        for c in range(len(table.cases))
        for a in range(len(table.algorithms))
    ]
    values = {
        name: [table.scalars[name][part][done[part]] for _, _, part in places] for name in METRICS
    }
    spreads = {name: spreads_of(values[name], seed) for name in METRICS}
    rows: list[list[Cell]] = [[] for _ in table.cases]
    for n, (c, a, part) in enumerate(places):
        count = part.stop - part.start
        err = values["err"][n]
        rows[c].append(
            Cell(
                table.cases[c],
                table.algorithms[a],
                count,
                len(err),
                {name: spreads[name][n] for name in METRICS},
                {
                    target: float((err <= target).sum()) / count if count else math.nan
                    for target in targets
                },
            )
        )
    return rows


def spreads_of(samples: list[np.ndarray], seed: int = 1) -> list[Spread]:
    """`Spread` of each sample. Samples of one length are resampled together, for speed."""
    found = [Spread()] * len(samples)
    by_length: dict[int, list[int]] = {}
    for n, sample in enumerate(samples):
        by_length.setdefault(len(sample), []).append(n)
    for length, members in by_length.items():
        if length == 0:
            continue
        together = max(1, _ELEMENTS // length)
        for first in range(0, len(members), together):
            chunk = members[first : first + together]
            block = np.stack([samples[n] for n in chunk])
            for n, spread in zip(chunk, _spreads(block, seed), strict=True):
                found[n] = spread
    return found


def _spreads(block: np.ndarray, seed: int) -> list[Spread]:
    """`Spread` of each row of (S, n)."""
    middle = block.mean(axis=1)
    q1, median, q3 = np.quantile(block, [0.25, 0.5, 0.75], axis=1)
    low, high = np.full((2, 2, len(block)), np.nan)
    varied = np.ptp(block, axis=1) > 0.0
    low[:, ~varied] = high[:, ~varied] = middle[~varied] if block.shape[1] > 1 else np.nan
    if varied.any():
        low[:, varied], high[:, varied] = _intervals(block[varied], seed)
    columns = (middle, median, q1, q3, low[0], high[0], low[1], high[1])
    return [
        Spread(m, d, a, b, (m_low, m_high), (d_low, d_high))
        for m, d, a, b, m_low, m_high, d_low, d_high in np.stack(columns, axis=1).tolist()
    ]


def _intervals(block: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper ends, (2, S) each, of mean and median of the rows of (S, n)."""
    resamples = RESAMPLES if block.shape[1] <= MANY else RESAMPLES_OF_MANY

    def middles(sample: np.ndarray, axis: int = -1) -> np.ndarray:
        return np.stack([sample.mean(axis=axis), np.median(sample, axis=axis)])

    interval = bootstrap(
        (block,),
        middles,
        n_resamples=resamples,
        batch=max(1, _ELEMENTS // block.size),
        axis=-1,
        method="percentile",
        vectorized=True,
        random_state=np.random.default_rng(seed),
    ).confidence_interval
    return np.asarray(interval.low), np.asarray(interval.high)


def matrix(cells: list[list[Cell]], metric: str, of: str = "mean") -> np.ndarray:
    """(C, A) array of a number of each cell, e.g. the mean of "err"."""
    return np.array([[getattr(cell.metrics[metric], of) for cell in row] for row in cells])
