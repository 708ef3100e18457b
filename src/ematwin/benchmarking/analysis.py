"""The whole analysis of a study, from its runs alone, and what can be concluded from it."""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ematwin.benchmarking import statistics
from ematwin.benchmarking.convergence import STATED_MISFITS, bands, evaluations_to_target
from ematwin.benchmarking.plan import Run
from ematwin.benchmarking.statistics import ALPHA, TARGETS, THRESHOLD, RankComparison, matrix
from ematwin.benchmarking.table import RunTable, collect
from ematwin.errors import InputError
from ematwin.showing.results import drawn, html, plain
from ematwin.showing.text import counted, listed

ENOUGH = 5  # runs of a case and algorithm, below which nothing is claimed
_TO_ZERO = {"gwo", "woa", "da"}  # families whose moves scale the coordinates themselves


@dataclass(frozen=True, repr=False)
class StudyAnalysis:
    """Everything that a report says; tables are DataFrames."""

    table: RunTable  #: the runs
    #: a row for each case and algorithm: middles, quartiles, intervals, success, coefficients
    cells: Any
    effects: Any  #: a row for each case and pair of algorithms: A12
    ranks: RankComparison  #: tests over the case means of Err%
    curves: Any  #: shares of targets met over the evaluations, by algorithm
    times: Any  #: expected running times to stated misfits, by algorithm
    diagnosis: Any  #: a row for each algorithm (`ematwin.benchmarking.statistics.diagnose`)
    threshold: float  #: of the diagnosis

    @cached_property
    def bands(self) -> Any:
        """DataFrame of the quartiles of the best cost of each case and algorithm."""
        return bands(self.table)

    @property
    def lead(self) -> str:
        """Which algorithm errs least, and whether that is more than chance."""
        return _lead(self)

    @cached_property
    def conclusions(self) -> list[str]:
        """Plain sentences, most important first, each only where its numbers allow it."""
        return [
            *_runs(self.table, self.cells),
            *_differences(self.ranks),
            *_diagnosis(self.diagnosis, self.threshold),
            *_machines(self.table),
            *_limits(self.table),
        ]

    @property
    def failures(self) -> Any:
        """DataFrame of the runs that did not end well, with the message of each (stopped)."""
        columns = ["id", "case", "algorithm", "run", "status", "stopped"]
        return self.table.frame.loc[~self.table.done, columns]

    def plot(self) -> dict[str, Any]:
        """Draw all its figures, of plotly, by heading."""
        return drawn(self, "all", {"all": "plot_study"})

    def to_frame(self, each: str = "cell") -> Any:
        """Give a pandas DataFrame with a row for each "cell" (case and algorithm) or "run"."""
        if each not in ("cell", "run"):
            raise InputError(f"each must be cell or run, received {each!r}.")
        return (self.cells if each == "cell" else self.table.frame).copy()

    to_dataframe = to_frame

    def __repr__(self) -> str:
        table = self.table
        return (
            f"StudyAnalysis({len(table)} runs of {', '.join(table.algorithms)} on "
            f"{len(table.cases)} cases)"
        )

    def __str__(self) -> str:
        """Give who errs least, then the conclusions."""
        return "\n".join([self.lead, *self.conclusions])

    def _repr_html_(self) -> str:
        """Show the mean Err% of each case and algorithm and the conclusions in a notebook."""
        means = matrix(self.cells, "err_mean")
        rows = [(case, *(f"{value:.3g}" for value in row)) for case, row in means.iterrows()]
        lead = html(self.lead, notes=["Mean Err% by case and algorithm"])
        return lead + html("", ("case", *means.columns), rows, self.conclusions)

    def as_dict(self) -> dict[str, Any]:
        """Give all tables as plain values; None where a number could not be computed."""
        table, ranks = self.table, self.ranks
        return plain({
            "runs": len(table),
            "done": int(table.done.sum()),
            "kind": table.subject.model.kind,
            "unknowns": table.subject.names,
            "cases": table.cases,
            "algorithms": table.algorithms,
            "settings": table.settings,
            "provenance": table.provenance,
            "cells": self.cells.to_dict("records"),
            "effects": self.effects.to_dict("records"),
            "ranks": {
                **{k: v for k, v in vars(ranks).items() if k not in ("smallest_holm", "pairs")},
                "pairs": [pair._asdict() for pair in ranks.pairs],
                "smallest_p_holm": ranks.smallest_holm,
            },
            "evaluations_to_target": self.curves.to_dict("records"),
            "running_times": self.times.to_dict("records"),
            "diagnosis": {
                "threshold": self.threshold, "algorithms": self.diagnosis.to_dict("records")
            },
            "failures": self.failures.to_dict("records"),
            "lead": self.lead,
            "conclusions": self.conclusions,
        })  # fmt: skip


def analyse(
    runs: Iterable[Run],
    *,
    targets: tuple[float, ...] = TARGETS,
    misfits: tuple[float, ...] = STATED_MISFITS,
    threshold: float = THRESHOLD,
    seed: int = 1,
) -> StudyAnalysis:
    """Analyse the runs of a study, in any order; targets and threshold as of `ematwin.compare`.

    ``misfits`` are relative ones, to which expected running times are given; ``seed`` is of the
    bootstrap.
    """
    if not (targets and all(target > 0.0 and math.isfinite(target) for target in targets)):
        raise InputError(f"Targets of Err% must be positive, received {targets}.")
    if not (misfits and all(0.0 < misfit < 1.0 for misfit in misfits)):
        raise InputError(f"Misfits to reach must lie between 0 and 1, received {misfits}.")
    if not 0.0 < threshold < 0.5:
        raise InputError(f"The threshold must lie between 0 and 0.5, received {threshold:g}.")
    table = collect(runs)
    cells = statistics.summarise(table, targets, seed)
    effects = statistics.effect_sizes(table)
    ranks = statistics.compare_ranks(matrix(cells, "err_mean"), effects)
    curves, times = evaluations_to_target(table, misfits, seed)
    diagnosis = statistics.diagnose(table, threshold)
    return StudyAnalysis(table, cells, effects, ranks, curves, times, diagnosis, threshold)


def _lead(study: StudyAnalysis) -> str:
    table, ranks = study.table, study.ranks
    whole = matrix(study.cells, "err_mean").dropna()
    if not len(whole) or len(table.algorithms) < 2:
        return f"{int(table.done.sum())} of {counted(len(table), 'run')} ended well."
    wins = Counter(whole.idxmin(axis=1))
    cases = counted(len(whole), "case")
    best, count = wins.most_common(1)[0]
    tied = [str(name) for name, won in wins.items() if won == count]
    if len(tied) > 1:
        return (
            f"{listed(tied)} have the lowest mean Err% equally often, on {count} of {cases} each."
        )
    others = len(table.algorithms) - 1
    surely = sum(
        (pair.a12 > 0.5) == (pair.first == best)
        for pair in ranks.different
        if best in (pair.first, pair.second)
    )
    sure = "no test tells that from chance"
    if surely:
        whom = "the other" if others == 1 else f"{surely} of the {others} others"
        sure = f"it is better than {whom} by more than chance"
    return f"{best} has the lowest mean Err% on {count} of {cases}; {sure}."


def _runs(table: RunTable, cells: Any) -> list[str]:
    done, failed = int(table.done.sum()), int((~table.done).sum())
    sentences = [f"{done} of {len(table)} runs ended well."]
    if failed:
        sentences[0] += (
            f" Those that did not ({failed}) count as failures in the success rates, lose every "
            "comparison of runs, and have no Err% to average."
        )
    if not done:
        return [*sentences, "No run has a result: no errors, times or ranks can be given."]
    missing = cells[cells["done"] == 0]
    if len(missing):
        named = [f"{cell.algorithm} on {cell.case}" for cell in missing.head(5).itertuples()]
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        sentences.append(f"No result yet: {', '.join(named)}{more}.")
    fewest = int(cells["done"].min())
    if fewest < ENOUGH:
        sentences.append(
            f"Some cases have fewer than {ENOUGH} runs of a method (the fewest {fewest}): their "
            "spread is poorly known, and nothing is claimed about single cases."
        )
    return sentences


def _differences(ranks: RankComparison) -> list[str]:
    if not all(map(math.isfinite, ranks.average.values())):
        return list(ranks.notes)
    order = ", ".join(f"{name} {ranks.average[name]:.2f}" for name in ranks.order)
    sentences = [
        f"Average rank by mean Err% over {counted(len(ranks.blocks), 'case')}, 1 the best: {order}."
    ]
    if math.isfinite(ranks.friedman_p):
        test = f"Friedman test: chi-squared {ranks.friedman:.3g}, p = {ranks.friedman_p:.2g}"
        if ranks.friedman_p >= ALPHA:
            sentences.append(
                f"{test}. That the algorithms differ in Err% cannot be concluded; the order above "
                "may be chance."
            )
            return [*sentences, *ranks.notes]
        sentences.append(f"{test}: the algorithms differ in Err%.")
    return [*sentences, *_pairs(ranks), *ranks.notes]


def _pairs(ranks: RankComparison) -> list[str]:
    """Which pairs differ after Holm's correction."""
    if not ranks.pairs:
        return []
    if not ranks.different:
        return [
            "No pair of algorithms differs significantly after Holm's correction: which of two is "
            "the better cannot be concluded."
        ]
    before = []
    for n, better in enumerate(ranks.order):
        worse = [other for other in ranks.order[n + 1 :] if ranks.differ(better, other)]
        if worse:
            before.append(f"{better} before {', '.join(worse)}")
    count, every = len(ranks.different), len(ranks.pairs)
    rest = " Nothing can be concluded about the others." if count < every else ""
    return [
        f"Of {every} pairs, {count} differ after Holm's correction (p at most "
        f"{max(pair.p_holm for pair in ranks.different):.2g}): {'; '.join(before)}.{rest}"
    ]


def _diagnosis(diagnosis: Any, threshold: float) -> list[str]:
    named = (diagnosis["exact"] / diagnosis["runs"]).set_axis(diagnosis["algorithm"]).dropna()
    if not len(named):
        return []
    order = named.sort_values(ascending=False, kind="stable")
    shares = ", ".join(f"{algorithm} {100.0 * share:.0f} %" for algorithm, share in order.items())
    return [
        f"With a deviation of {threshold:g} of the range counted as a fault, the faults were named "
        f"exactly, none missed and none false, in this share of the runs: {shares}."
    ]


def _machines(table: RunTable) -> list[str]:
    machines = len(table.provenance.get("machine", ()))
    if machines < 2:
        return []
    return [
        f"The runs were made on several machines ({machines}): their seconds should not be "
        "compared, nor coefficients built on them."
    ]


def _limits(table: RunTable) -> list[str]:
    sentences = [
        "Spread and intervals here come from repeating the search with other seeds. They are "
        "search spread, not measurement uncertainty, and say nothing about how far the twin is "
        "from a real actuator: the records are simulated."
    ]
    subject, box = table.subject, table.settings["search box"]
    corner = (subject.healthy == subject.lower) | (subject.healthy == subject.upper)
    zero = subject.healthy == 0.0
    if box == "plain" and (corner | zero).any():
        pulled = [name for name in table.algorithms if name.partition("-")[0] in _TO_ZERO]
        favoured = [f"{', '.join(pulled)} (drawn to the origin)"] if pulled and zero.any() else []
        favoured += ["every method that clips at the bounds"] if corner.any() else []
        special = int((corner | zero).sum())
        sentences.append(
            f"{special} of the {len(corner)} healthy values lie at a bound of this search box or "
            f"at the origin, which favours {' and '.join(favoured) or 'methods drawn there'}. "
            "Repeat the study with the remapped box before concluding that a method is good at "
            "finding faults."
        )
    if box == "remapped" and np.any(corner):
        sentences.append(
            "In the remapped box a healthy value lies beside a cliff, where the plain box has a "
            "wall, so all methods err more. What a method loses between the boxes it owed to the "
            "corner of the plain one."
        )
    return sentences
