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
from ematwin.showing.results import frame

TARGETS = np.geomspace(0.5, 0.003, 31)
STATED_MISFITS = (0.1, 0.02, 0.005)


def bands(table: RunTable) -> Any:
    """Give quartiles of the best cost: case, algorithm, evaluations, q1, median, q3.

    Infinite where a quarter of the runs (half, ...) had no cost yet; no rows where none had any.
    """
    evaluations = _grid(table)
    parts = []
    for (case, algorithm), rows in table.cells.items():
        histories = [table.histories[n] for n in rows if len(table.histories[n][0])]
        if histories:
            costs = [
                np.r_[np.inf, best][np.searchsorted(spent, evaluations, side="right")]
                for spent, best in histories
            ]
            quartiles = np.quantile(costs, [0.25, 0.5, 0.75], axis=0, method="inverted_cdf")
            parts += [
                {"case": case, "algorithm": algorithm, "evaluations": n,
                 "q1": q1, "median": median, "q3": q3}
                for n, q1, median, q3 in zip(evaluations, *quartiles, strict=True)
            ]  # fmt: skip
    return frame(parts)


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
    evaluations, first = _grid(table), _first_met(table, misfits)
    whole = table.frame[["evaluations"]].to_numpy()
    met = [np.searchsorted(one, evaluations, "right") for one in _first_met(table, TARGETS)]
    hit = np.isfinite(first)
    each = np.hstack([met, hit, np.where(hit, first, whole)])  # a row for each run
    parts = [
        [each[rows] for case in table.cases if len(rows := table.cells[case, algorithm])]
        for algorithm in table.algorithms
    ]
    runs = np.array([sum(map(len, of)) for of in parts])[:, None, None]
    draws = [np.random.default_rng([seed, a]) for a in range(len(parts))]
    sums = np.array([
        sum(_sums(part, rng) for part in of) for of, rng in zip(parts, draws, strict=True)
    ])  # fmt: skip
    share, hits, spent = np.split(sums, [len(evaluations), -len(misfits)], axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.where(hits == 0.0, np.inf, spent / hits)
    return (
        _by_algorithm(table, "evaluations", evaluations, share=share / (runs * len(TARGETS))),
        _by_algorithm(table, "misfit", misfits, reached=hits / runs, expected=expected),
    )


def _by_algorithm(table: RunTable, label: str, labels: Any, **values: np.ndarray) -> Any:
    """DataFrame of values (A, 1 + B, k) at labels (k,), with the interval of the last of them."""
    columns = {name: of[:, 0] for name, of in values.items()}
    drawn = values[list(values)[-1]][:, 1:]
    ends = np.quantile(drawn, [0.025, 0.975], axis=1, method="inverted_cdf")
    unknown = np.isnan(drawn).any(axis=1)
    columns["low_95"], columns["high_95"] = np.where(unknown, np.nan, ends)
    grid = np.meshgrid(table.algorithms, labels, indexing="ij")
    columns = {"algorithm": grid[0], label: grid[1]} | columns
    return frame({name: of.ravel() for name, of in columns.items()})


def _sums(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Sums over rows (n, k), then over rows drawn anew, (1 + B, k) array; these NaN of one row."""
    count = len(values)
    weights = rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES)
    drawn = weights @ values if count > 1 else np.full((RESAMPLES, values.shape[1]), np.nan)
    return np.vstack([values.sum(axis=0), drawn])


def _first_met(table: RunTable, misfits: Sequence[float] | np.ndarray) -> np.ndarray:
    """Evaluations after which each run met each misfit, (R, M); infinite where it did not."""
    cost, misfit = table.frame["cost"], table.frame["relative_misfit"]
    # cost of a twin that does not answer: equal within a case but for sensor noise; NaN where no
    # run of the case gives it, and no misfit is met then
    known = (cost / misfit**2).where(np.isfinite(cost) & (misfit > 0.0))
    scales = known.groupby(table.frame["case"]).transform("median").to_numpy(dtype=float)
    first = np.empty((len(table), len(misfits)))
    for n, (spent, best) in enumerate(table.histories):
        # costs fall: the first one not above a limit
        place = np.searchsorted(-best, -np.square(misfits) * scales[n])
        first[n] = np.append(spent, np.inf)[place]
    return first


def _grid(table: RunTable) -> np.ndarray:
    """Evaluations at which the curves are given, evenly spaced in their logarithm."""
    spent = np.concatenate([evaluations for evaluations, _ in table.histories])
    spent = spent[spent > 0]
    if not len(spent):
        return np.empty(0)
    return np.unique(np.geomspace(spent.min(), spent.max(), 60).round())
