"""How the best cost falls with the evaluations, and how many evaluations a target takes.

The evaluations to target follow the COCO platform (Hansen et al. 2021, Optim. Methods Softw. 36,
114-144): targets are spread evenly over a logarithm, and every pair of run and target counts alike.
A target is a misfit relative to a twin that does not answer (`Problem.relative_misfit`), the same
for every study: neither another algorithm nor another run moves it. Where the twin itself is
farther from the record than a target, no algorithm meets it.

Intervals are 95 % percentile bootstrap intervals; runs are drawn anew within each case and
algorithm, cases are not.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ematwin.benchmarking.table import RunTable
from ematwin.showing.frames import frame_of_rows

TARGETS = np.geomspace(0.5, 0.003, 31)
STATED_MISFITS = (0.1, 0.02, 0.005)
_GRID = 60
_RESAMPLES = 999
_RESAMPLES_OF_MANY = 199
_MANY = 20_000  # runs of a study, above which fewer resamples are drawn


def bands(table: RunTable) -> Any:
    """Give quartiles of the best cost: case, algorithm, evaluations, q1, median, q3.

    Infinite where a quarter of the runs (half, ...) had no cost yet; no rows where none had any.
    """
    evaluations = _grid(table)
    parts = []
    for (case, algorithm), rows in table.cells.items():
        costs = _costs_at(table, rows, evaluations)
        costs = costs[np.isfinite(costs).any(axis=1)] if costs.size else costs
        if len(costs):
            quartiles = np.quantile(costs, [0.25, 0.5, 0.75], axis=0, method="inverted_cdf")
            parts += [
                {"case": case, "algorithm": algorithm, "evaluations": n,
                 "q1": q1, "median": median, "q3": q3}
                for n, q1, median, q3 in zip(evaluations, *quartiles, strict=True)
            ]  # fmt: skip
    return frame_of_rows(parts)


def evaluations_to_target(
    table: RunTable, misfits: Sequence[float] = STATED_MISFITS, seed: int = 1
) -> tuple[Any, Any]:
    """Give the distribution of the evaluations to target, and expected running times.

    Parameters
    ----------
    misfits : relative misfits to state expected running times for
    seed : of the bootstrap

    Returns
    -------
    curves : DataFrame of algorithm, evaluations, share of all pairs of run and target met by then,
        low_95, high_95. A failed run meets what its history says; one without meets none.
    times : DataFrame of algorithm, misfit, share of the runs that met it (reached), expected
        running time (all evaluations spent over the number of runs that met it, infinite if none
        did), low_95, high_95. Intervals are NaN where a case has one run.
    """
    evaluations, scales = _grid(table), _scales(table)
    curves: list[dict[str, Any]] = []
    times: list[dict[str, Any]] = []
    for a, algorithm in enumerate(table.algorithms):
        runs, once, again = _sums(
            table, algorithm, scales, evaluations, misfits, np.random.default_rng([seed, a])
        )
        share, low, high = (part / (runs * len(TARGETS)) for part in (once[0], *_ends(again[0])))
        curves += [
            {"algorithm": algorithm, "evaluations": n, "share": s, "low_95": l, "high_95": h}
            for n, s, l, h in zip(evaluations, share, low, high, strict=True)
        ]
        expected = _running_time(*once[1:])
        for n, (low_n, high_n) in enumerate(np.transpose(_ends(_running_time(*again[1:])))):
            times.append(
                {"algorithm": algorithm, "misfit": misfits[n], "reached": once[1][n] / runs,
                 "expected": expected[n], "low_95": low_n, "high_95": high_n}
            )  # fmt: skip
    return frame_of_rows(curves), frame_of_rows(times)


def expected_by_case(table: RunTable, misfit: float) -> Any:
    """Give the expected running time to a relative misfit: case, algorithm, expected.

    Infinite where no run met it.
    """
    scales = _scales(table)
    rows = []
    for (case, algorithm), places in table.cells.items():
        hits, spent = _to_misfits(table, places, scales[case], (misfit,))
        expected = _running_time(hits.sum(axis=0), spent.sum(axis=0))[0]
        rows.append({"case": case, "algorithm": algorithm, "expected": expected})
    return frame_of_rows(rows)


_Sums = tuple[np.ndarray, np.ndarray, np.ndarray]


def _sums(
    table: RunTable,
    algorithm: str,
    scales: dict[str, float],
    evaluations: np.ndarray,
    misfits: Sequence[float],
    rng: np.random.Generator,
) -> tuple[int, _Sums, _Sums]:
    """Add up the runs of an algorithm over all cases, as they are and drawn anew.

    Returns
    -------
    runs : int
    once : targets met by each number of evaluations (G,), hits (M,) and evaluations spent (M,)
    again : the same of each resample, (B, G) and (B, M); NaN where a case has one run
    """
    resamples = _RESAMPLES if len(table) <= _MANY else _RESAMPLES_OF_MANY
    runs = 0
    once: Any = [0.0, 0.0, 0.0]
    again: Any = [0.0, 0.0, 0.0]
    for case in table.cases:
        rows = table.cells[case, algorithm]
        if not len(rows):
            continue
        scale = scales[case]
        # targets fall: those before the first one below the run's own misfit are met; none is
        # where no run tells the scale
        costs = _costs_at(table, rows, evaluations)
        misfit = np.sqrt(costs / scale) if math.isfinite(scale) else np.full_like(costs, np.inf)
        met = np.searchsorted(-TARGETS, -misfit, "right").astype(float)
        count = len(rows)
        weights = rng.multinomial(count, np.full(count, 1.0 / count), size=resamples)
        weights = weights if count > 1 else np.full(weights.shape, np.nan)
        runs += count
        for n, part in enumerate((met, *_to_misfits(table, rows, scale, misfits))):
            once[n] = once[n] + part.sum(axis=0)
            again[n] = again[n] + weights @ part
    return runs, tuple(once), tuple(again)


def _running_time(hits: np.ndarray, spent: np.ndarray) -> np.ndarray:
    """All evaluations spent over the number of runs that met a target; infinite if none did."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(hits == 0.0, np.inf, spent / hits)


def _to_misfits(
    table: RunTable, rows: np.ndarray, scale: float, misfits: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Whether each run met each misfit, and what it spent until then or in all: (runs, M) both."""
    limits = np.square(misfits) * scale
    hits, spent = np.zeros((2, len(rows), len(limits)))
    in_all = table.frame["evaluations"].to_numpy()
    for n, row in enumerate(rows):
        evaluations, cost = table.histories[row]
        whole = float(evaluations[-1] if len(cost) else in_all[row])
        # costs fall: the first one not above a limit
        first = np.searchsorted(-cost, -limits, side="left")
        hits[n] = first < len(cost)
        spent[n] = np.append(evaluations, whole)[first]
    return hits, spent


def _costs_at(table: RunTable, rows: np.ndarray, evaluations: np.ndarray) -> np.ndarray:
    """Best cost of each run after so many evaluations, (runs, G), inf before its first."""
    costs = np.full((len(rows), len(evaluations)), np.inf)
    for n, row in enumerate(rows):
        spent, best = table.histories[row]
        costs[n] = np.r_[np.inf, best][np.searchsorted(spent, evaluations, side="right")]
    return costs


def _grid(table: RunTable) -> np.ndarray:
    """Evaluations at which the curves are given, evenly spaced in their logarithm."""
    spent = np.concatenate([evaluations for evaluations, _ in table.histories])
    spent = spent[spent > 0]
    if not len(spent):
        return np.empty(0)
    return np.unique(np.geomspace(spent.min(), spent.max(), _GRID).round())


def _scales(table: RunTable) -> dict[str, float]:
    """Cost of a twin that does not answer: the same for all runs of a case but for sensor noise.

    NaN where no run tells it.
    """
    cost, misfit = table.frame["cost"], table.frame["relative_misfit"]
    known = (cost / misfit**2).where(np.isfinite(cost) & (misfit > 0.0))
    return dict(known.groupby(table.frame["case"], sort=False).median())


def _ends(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """2.5 and 97.5 % of the resamples (B, ...), of which some may be infinite; NaN of NaN."""
    low, high = np.quantile(values, [0.025, 0.975], axis=0, method="inverted_cdf")
    unknown = np.isnan(values).any(axis=0)
    return np.where(unknown, np.nan, low), np.where(unknown, np.nan, high)
