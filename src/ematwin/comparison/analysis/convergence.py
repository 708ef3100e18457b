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
from dataclasses import dataclass

import numpy as np

from ematwin.comparison.analysis.runs import RunTable

TARGETS = np.geomspace(0.5, 0.003, 31)
STATED_MISFITS = (0.1, 0.02, 0.005)
_GRID = 60
_RESAMPLES = 999
_RESAMPLES_OF_MANY = 199
_MANY = 20_000  # runs of a study, above which fewer resamples are drawn


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
    share_low, share_high : (G,) arrays, 95 % interval of ``share``; NaN with fewer than two runs
    reached : share of the runs that met each stated misfit
    expected : expected running time to each: all evaluations spent over the number of runs that
        met it, inf if none did
    interval : (low, high) of ``expected``; NaN with fewer than two runs
    """

    algorithm: str
    evaluations: np.ndarray
    share: np.ndarray
    share_low: np.ndarray
    share_high: np.ndarray
    reached: dict[float, float]
    expected: dict[float, float]
    interval: dict[float, tuple[float, float]]


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


def evaluations_to_target(
    table: RunTable, misfits: Sequence[float] = STATED_MISFITS, seed: int = 1
) -> list[ToTarget]:
    """Empirical distribution of the evaluations to target of each algorithm, over all cases.

    Parameters
    ----------
    misfits : relative misfits to state expected running times for
    seed : of the bootstrap
    """
    evaluations = grid(table)
    found = []
    for a, algorithm in enumerate(table.algorithms):
        rng = np.random.default_rng([seed, a])
        total = _Sums.of(table, a, evaluations, misfits, rng)
        pairs = max(total.runs * len(TARGETS), 1)
        low, high = _ends(total.met_again / pairs) if total.repeated else _unknown(evaluations)
        with np.errstate(divide="ignore", invalid="ignore"):
            # no evaluation spent and no target met is no running time, but no success either
            again = np.where(total.hits_again > 0, total.spent_again / total.hits_again, np.inf)
        ends = np.stack(_ends(again) if total.repeated else _unknown(np.array(misfits)), axis=1)
        found.append(
            ToTarget(
                algorithm,
                evaluations,
                total.met / pairs,
                low,
                high,
                dict(zip(misfits, (total.hits / max(total.runs, 1)).tolist(), strict=True)),
                {
                    misfit: float(total.spent[m] / total.hits[m]) if total.hits[m] else math.inf
                    for m, misfit in enumerate(misfits)
                },
                {
                    misfit: (float(ends[m, 0]), float(ends[m, 1]))
                    for m, misfit in enumerate(misfits)
                },
            )
        )
    return found


def expected_by_case(table: RunTable, misfit: float) -> np.ndarray:
    """(C, A) array, expected running time to a relative misfit; inf where no run met it."""
    expected = np.full((len(table.cases), len(table.algorithms)), np.inf)
    for c in range(len(table.cases)):
        scale = _scale(table, c)
        for a in range(len(table.algorithms)):
            hits, spent = _to_misfits(table, table.cell(c, a), scale, (misfit,))
            if hits.any():
                expected[c, a] = spent.sum() / hits.sum()
    return expected


@dataclass
class _Sums:
    """What the runs of an algorithm add up to, over all cases, as they are and drawn anew."""

    runs: int
    repeated: bool
    met: np.ndarray
    hits: np.ndarray
    spent: np.ndarray
    met_again: np.ndarray
    hits_again: np.ndarray
    spent_again: np.ndarray

    @classmethod
    def of(
        cls,
        table: RunTable,
        algorithm: int,
        evaluations: np.ndarray,
        misfits: Sequence[float],
        rng: np.random.Generator,
    ) -> "_Sums":
        """Sums over the cases; a case's runs are drawn from its own."""
        resamples = _RESAMPLES if len(table) <= _MANY else _RESAMPLES_OF_MANY
        g, m = len(evaluations), len(misfits)
        total = cls(
            0, True, np.zeros(g), np.zeros(m), np.zeros(m),
            np.zeros((resamples, g)), np.zeros((resamples, m)), np.zeros((resamples, m)),
        )  # fmt: skip
        for c in range(len(table.cases)):
            part = table.cell(c, algorithm)
            count = part.stop - part.start
            if not count:
                continue
            scale = _scale(table, c)
            costs = costs_at(table, range(part.start, part.stop), evaluations)
            # targets fall: those before the first one below the run's own misfit are met; none is
            # where no run tells the scale
            costs = costs if math.isfinite(scale) else np.full_like(costs, np.inf)
            met = np.searchsorted(-TARGETS, -np.sqrt(costs / scale), "right").astype(float)
            hits, spent = _to_misfits(table, part, scale, misfits)
            drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=resamples)
            total.runs += count
            total.repeated &= count > 1
            total.met += met.sum(axis=0)
            total.hits += hits.sum(axis=0)
            total.spent += spent.sum(axis=0)
            total.met_again += drawn @ met
            total.hits_again += drawn @ hits
            total.spent_again += drawn @ spent
        return total


def _to_misfits(
    table: RunTable, part: slice, scale: float, misfits: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Whether each run met each misfit, and what it spent until then or in all: (runs, M) both."""
    limits = np.square(misfits) * scale
    shape = (part.stop - part.start, len(limits))
    hits, spent = np.zeros(shape), np.zeros(shape)
    for n, run in enumerate(range(part.start, part.stop)):
        evaluations, cost = table.history(run)
        whole = float(evaluations[-1]) if len(cost) else float(table.scalars["evaluations"][run])
        # costs fall: the first one not above a limit
        first = np.searchsorted(-cost, -limits, side="left")
        hits[n] = first < len(cost)
        spent[n] = np.append(evaluations, whole)[first]
    return hits, spent


def _scale(table: RunTable, case: int) -> float:
    """Cost of a twin that does not answer: the same for all runs of a case but for sensor noise."""
    here = table.case == case
    cost, misfit = table.scalars["cost"][here], table.scalars["relative_misfit"][here]
    known = np.isfinite(cost) & (misfit > 0.0)
    return float(np.median(cost[known] / misfit[known] ** 2)) if known.any() else math.nan


def _ends(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """2.5 and 97.5 % of the resamples (B, ...), of which some may be infinite."""
    low, high = np.quantile(values, [0.025, 0.975], axis=0, method="inverted_cdf")
    return low, high


def _unknown(like: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.full(len(like), np.nan), np.full(len(like), np.nan)
