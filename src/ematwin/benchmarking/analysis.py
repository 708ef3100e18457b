"""The whole analysis of a study, from its runs alone."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ematwin.benchmarking import statistics
from ematwin.benchmarking.conclusions import conclude, lead_of
from ematwin.benchmarking.convergence import STATED_MISFITS, bands, evaluations_to_target
from ematwin.benchmarking.run import StoredRun
from ematwin.benchmarking.statistics import TARGETS, THRESHOLD, RankComparison, matrix
from ematwin.benchmarking.table import RunTable, collect
from ematwin.errors import InputError
from ematwin.showing.results import drawn, html, plain


@dataclass(frozen=True, repr=False)
class StudyAnalysis:
    """Everything that a report says.

    Attributes
    ----------
    table : the runs
    cells : DataFrame, a row for each case and algorithm: middles, quartiles, intervals, success,
        performance coefficients
    effects : DataFrame, a row for each case and pair of algorithms: A12
    ranks : tests over the case means of Err%
    curves : DataFrame, shares of targets met over the evaluations, by algorithm
    times : DataFrame, expected running times to stated misfits, by algorithm
    diagnosis : DataFrame, a row for each algorithm (`diagnose`)
    threshold : of the diagnosis
    """

    table: RunTable
    cells: Any
    effects: Any
    ranks: RankComparison
    curves: Any
    times: Any
    diagnosis: Any
    threshold: float

    @cached_property
    def bands(self) -> Any:
        """DataFrame of the quartiles of the best cost of each case and algorithm."""
        return bands(self.table)

    @property
    def lead(self) -> str:
        """Which algorithm errs least, and whether that is more than chance."""
        return lead_of(self)

    @cached_property
    def conclusions(self) -> list[str]:
        """Plain sentences."""
        return conclude(self)

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
    runs: Iterable[StoredRun],
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
