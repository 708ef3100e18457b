"""How the best cost falls with the evaluations, and how many evaluations a target takes.

The evaluations to target follow the COCO platform (Hansen et al. 2021, Optim. Methods Softw. 36,
114-144): targets are spread evenly over a logarithm, and every pair of run and target counts alike.
A target is a misfit relative to a twin that does not answer (`Problem.relative_misfit`), the same
for every study: neither another algorithm nor another run moves it. Where the twin itself is
farther from the record than a target, no algorithm meets it.

Intervals are 95 % percentile bootstrap intervals; runs are drawn anew within each case and
algorithm, cases are not.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ematwin.benchmarking.statistics import RESAMPLES
from ematwin.benchmarking.table import RunTable
from ematwin.showing.results import frame_of_rows

TARGETS = np.geomspace(0.5, 0.003, 31)
STATED_MISFITS = (0.1, 0.02, 0.005)


def bands(table: RunTable) -> Any:
    """Give quartiles of the best cost: case, algorithm, evaluations, q1, median, q3.

    Infinite where a quarter of the runs (half, ...) had no cost yet; no rows where none had any.
    """
    evaluations = _grid(table)
    costs = _costs_at(table, evaluations)
    parts = []
    for (case, algorithm), rows in table.cells.items():
        known = costs[rows][np.isfinite(costs[rows]).any(axis=1)]
        if len(known):
            quartiles = np.quantile(known, [0.25, 0.5, 0.75], axis=0, method="inverted_cdf")
            parts += [
                {"case": case, "algorithm": algorithm, "evaluations": n,
                 "q1": q1, "median": median, "q3": q3}
                for n, q1, median, q3 in zip(evaluations, *quartiles, strict=True)
            ]  # fmt: skip
    return frame_of_rows(parts)


def evaluations_to_target(
    table: RunTable, misfits: Sequence[float] = STATED_MISFITS, seed: int = 1
) -> tuple[Any, Any]:
    """Give the distribution of the evaluations to target, and expected running times to misfits.

    Returns
    -------
    curves : DataFrame of algorithm, evaluations, share of all pairs of run and target met by then,
        low_95, high_95. A failed run meets what its history says; one without meets none.
    times : DataFrame of algorithm, misfit, share of the runs that met it (reached), expected
        running time (all evaluations spent over the number of runs that met it, infinite if none
        did), low_95, high_95. Intervals are NaN where a case has one run.
    """
    evaluations, scales = _grid(table), _scales(table)
    misfit = np.sqrt(_costs_at(table, evaluations) / scales[:, None])
    misfit[np.isnan(misfit)] = np.inf  # no target is met where no run of the case has a scale
    # targets fall: those before the first one below the run's own misfit are met
    met = np.searchsorted(-TARGETS, -misfit, "right").astype(float)
    each = np.hstack([met, *_to_misfits(table, scales, misfits)])  # a row for each run
    curves: list[dict[str, Any]] = []
    times: list[dict[str, Any]] = []
    for a, algorithm in enumerate(table.algorithms):
        rng = np.random.default_rng([seed, a])
        parts = [rows for case in table.cases if len(rows := table.cells[case, algorithm])]
        runs = sum(map(len, parts))
        once = sum(each[rows].sum(axis=0) for rows in parts)
        again = sum(_drawn_anew(each[rows], RESAMPLES, rng) for rows in parts)
        (share, hits, spent), (shares, *others) = (
            np.split(sums, [met.shape[1], -len(misfits)], axis=-1) for sums in (once, again)
        )
        pairs = runs * len(TARGETS)
        low, high = _ends(shares / pairs)
        curves += [
            {"algorithm": algorithm, "evaluations": n, "share": s, "low_95": l, "high_95": h}
            for n, s, l, h in zip(evaluations, share / pairs, low, high, strict=True)
        ]
        low, high = _ends(_running_time(*others))
        times += [
            {"algorithm": algorithm, "misfit": m, "reached": hit / runs, "expected": time,
             "low_95": l, "high_95": h}
            for m, hit, time, l, h in zip(
                misfits, hits, _running_time(hits, spent), low, high, strict=True
            )
        ]  # fmt: skip
    return frame_of_rows(curves), frame_of_rows(times)


def _drawn_anew(values: np.ndarray, resamples: int, rng: np.random.Generator) -> np.ndarray:
    """Sums over resamples of the rows (n, k), (B, k) array; NaN of a single row."""
    count = len(values)
    weights = rng.multinomial(count, np.full(count, 1.0 / count), size=resamples)
    return weights @ values if count > 1 else np.full((resamples, values.shape[1]), np.nan)


def _running_time(hits: np.ndarray, spent: np.ndarray) -> np.ndarray:
    """All evaluations spent over the number of runs that met a target; infinite if none did."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(hits == 0.0, np.inf, spent / hits)


def _to_misfits(
    table: RunTable, scales: np.ndarray, misfits: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Whether each run met each misfit, and the evaluations until then or in all: (R, M) both."""
    limits = np.square(misfits) * scales[:, None]
    hits, spent = np.zeros((2, *limits.shape))
    in_all = table.frame["evaluations"].to_numpy()
    for n, (evaluations, cost) in enumerate(table.histories):
        whole = float(evaluations[-1] if len(cost) else in_all[n])
        # costs fall: the first one not above a limit
        first = np.searchsorted(-cost, -limits[n], side="left")
        hits[n] = first < len(cost)
        spent[n] = np.append(evaluations, whole)[first]
    return hits, spent


def _costs_at(table: RunTable, evaluations: np.ndarray) -> np.ndarray:
    """Best cost of each run after so many evaluations, (R, G), inf before its first."""
    costs = np.full((len(table), len(evaluations)), np.inf)
    for n, (spent, best) in enumerate(table.histories):
        costs[n] = np.r_[np.inf, best][np.searchsorted(spent, evaluations, side="right")]
    return costs


def _grid(table: RunTable) -> np.ndarray:
    """Evaluations at which the curves are given, evenly spaced in their logarithm."""
    spent = np.concatenate([evaluations for evaluations, _ in table.histories])
    spent = spent[spent > 0]
    if not len(spent):
        return np.empty(0)
    return np.unique(np.geomspace(spent.min(), spent.max(), 60).round())


def _scales(table: RunTable) -> np.ndarray:
    """Cost of a twin that does not answer, (R,), equal within a case but for sensor noise.

    NaN where no run of the case gives it.
    """
    cost, misfit = table.frame["cost"], table.frame["relative_misfit"]
    known = (cost / misfit**2).where(np.isfinite(cost) & (misfit > 0.0))
    return np.asarray(known.groupby(table.frame["case"]).transform("median"), dtype=float)


def _ends(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """2.5 and 97.5 % of the resamples (B, ...), some of them infinite; NaN of NaN."""
    low, high = np.quantile(values, [0.025, 0.975], axis=0, method="inverted_cdf")
    unknown = np.isnan(values).any(axis=0)
    return np.where(unknown, np.nan, low), np.where(unknown, np.nan, high)
