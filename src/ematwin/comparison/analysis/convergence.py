"""How the best cost falls with the evaluations, and how many evaluations a target takes.

The evaluations to target follow the COCO platform (Hansen et al. 2021, Optim. Methods Softw. 36,
114-144): targets are spread evenly over the logarithm of a gap, and every pair of run and target
counts alike. The cost of the twin never comes to zero, so the gap of a case is measured from the
lowest cost that any run of the study found there:

    gap = (cost - lowest) / (start - lowest),   start: median over the runs of their first cost
"""

import math
from dataclasses import dataclass

import numpy as np

from ematwin.comparison.analysis.runs import RunTable

GAPS = np.logspace(-4.0, -1.0, 31)
STATED_GAPS = (1e-1, 1e-2, 1e-3)
_GRID = 60


@dataclass(frozen=True)
class Band:
    """Best cost of an algorithm on a case.

    Attributes
    ----------
    evaluations : (G,) array
    q1, median, q3 : (G,) arrays over the runs, inf where a quarter (half, ...) had no cost yet
    """

    algorithm: str
    evaluations: np.ndarray
    q1: np.ndarray
    median: np.ndarray
    q3: np.ndarray


@dataclass(frozen=True)
class ToTarget:
    """Evaluations to target of an algorithm.

    Attributes
    ----------
    evaluations, share : (G,) arrays; share of all pairs of run and target met by then. A failed
        run meets what its history says; one without a history meets none.
    reached : share of the runs that met each of `STATED_GAPS`
    expected : expected running time to each: all evaluations spent over the number of runs that
        met it, inf if none did
    """

    algorithm: str
    evaluations: np.ndarray
    share: np.ndarray
    reached: dict[float, float]
    expected: dict[float, float]


def costs_at(table: RunTable, runs: range, evaluations: np.ndarray) -> np.ndarray:
    """Best cost of each run after so many evaluations, (runs, G), inf before its first."""
    costs = np.full((len(runs), len(evaluations)), np.inf)
    for n, run in enumerate(runs):
        spent, best = table.history(run)
        if len(spent):
            place = np.searchsorted(spent, evaluations, side="right")
            costs[n] = np.concatenate([[np.inf], best])[place]
    return costs


def grid(table: RunTable) -> np.ndarray:
    """Evaluations at which the curves are given, evenly spaced in their logarithm."""
    spent = table.history_evaluations
    spent = spent[spent > 0]
    if not len(spent):
        return np.empty(0)
    return np.unique(np.geomspace(spent.min(), spent.max(), _GRID).round())


def bands(table: RunTable, case: int) -> list[Band]:
    """Median and quartiles of the best cost of each algorithm on a case."""
    evaluations = grid(table)
    found = []
    for a, algorithm in enumerate(table.algorithms):
        part = table.cell(case, a)
        costs = costs_at(table, range(part.start, part.stop), evaluations)
        costs = costs[np.isfinite(costs).any(axis=1)] if costs.size else costs
        if len(costs):
            q1, median, q3 = np.quantile(costs, [0.25, 0.5, 0.75], axis=0, method="inverted_cdf")
            found.append(Band(algorithm, evaluations, q1, median, q3))
    return found


def evaluations_to_target(table: RunTable) -> list[ToTarget]:
    """Empirical distribution of the evaluations to target of each algorithm, over all cases."""
    evaluations = grid(table)
    count = len(table.algorithms)
    met = np.zeros((count, len(evaluations)))
    runs = np.zeros(count)
    hits = np.zeros((count, len(STATED_GAPS)))
    spent = np.zeros((count, len(STATED_GAPS)))
    for c in range(len(table.cases)):
        parts = [table.cell(c, a) for a in range(count)]
        lowest, start = _scale(table, range(parts[0].start, parts[-1].stop))
        for a, part in enumerate(parts):
            members = range(part.start, part.stop)
            runs[a] += len(members)
            if not math.isfinite(start):
                continue
            costs = costs_at(table, members, evaluations)
            # a study in which no search improved on its start has a gap of zero everywhere
            scale = max(start - lowest, 1e-300)
            # ascending gaps: those from the first one not below the run's own are met
            met[a] += (len(GAPS) - np.searchsorted(GAPS, (costs - lowest) / scale)).sum(axis=0)
            for run in members:
                n, cost = table.history(run)
                total = float(n[-1]) if len(n) else float(table.scalars["evaluations"][run])
                for g, gap in enumerate(STATED_GAPS):
                    where = np.flatnonzero((cost - lowest) / scale <= gap)
                    hits[a, g] += bool(len(where))
                    spent[a, g] += float(n[where[0]]) if len(where) else total
    return [
        ToTarget(
            algorithm,
            evaluations,
            met[a] / max(runs[a] * len(GAPS), 1.0),
            {gap: hits[a, g] / max(runs[a], 1.0) for g, gap in enumerate(STATED_GAPS)},
            {
                gap: spent[a, g] / hits[a, g] if hits[a, g] else math.inf
                for g, gap in enumerate(STATED_GAPS)
            },
        )
        for a, algorithm in enumerate(table.algorithms)
    ]


def _scale(table: RunTable, runs: range) -> tuple[float, float]:
    """Lowest cost of a case, and the median first cost; inf without any history."""
    histories = [table.history(run)[1] for run in runs]
    histories = [cost for cost in histories if len(cost)]
    if not histories:
        return math.inf, math.inf
    lowest = min(float(cost[-1]) for cost in histories)
    return lowest, float(np.median([cost[0] for cost in histories]))
