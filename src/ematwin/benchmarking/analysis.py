"""The whole analysis of a study, from its runs alone, and what can be concluded from it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from typing import Any

from jinja2 import Template

from ematwin.benchmarking import statistics
from ematwin.benchmarking.convergence import STATED_MISFITS, bands, evaluations_to_target
from ematwin.benchmarking.plan import Run
from ematwin.benchmarking.statistics import ALPHA, TARGETS, THRESHOLD, RankComparison, matrix
from ematwin.benchmarking.table import RunTable, collect
from ematwin.errors import InputError
from ematwin.showing.results import drawn, html, plain
from ematwin.showing.text import counted, listed

ENOUGH = 5  # runs of a case and algorithm, below which nothing is claimed


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
        return self._paragraphs[0]

    @property
    def conclusions(self) -> list[str]:
        """Plain sentences, most important first, each only where its numbers allow it."""
        return self._paragraphs[1:]

    @cached_property
    def _paragraphs(self) -> list[str]:
        return _concluded(self)

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
        table, ranks = self.table, vars(self.ranks)
        names = ("cells", "effects", "curves", "times", "failures", "diagnosis")
        rows = {name: getattr(self, name).to_dict("records") for name in names}
        return plain({
            "runs": len(table), "done": int(table.done.sum()),
            "kind": table.subject.model.kind, "unknowns": table.subject.names,
            "cases": table.cases, "algorithms": table.algorithms,
            "settings": table.settings, "provenance": table.provenance,
            "cells": rows["cells"], "effects": rows["effects"],
            "ranks": {
                **{n: x for n, x in ranks.items() if n not in ("smallest_holm", "pairs")},
                "pairs": ranks["pairs"].to_dict("records"),
                "smallest_p_holm": ranks["smallest_holm"],
            },
            "evaluations_to_target": rows["curves"], "running_times": rows["times"],
            "diagnosis": {"threshold": self.threshold, "algorithms": rows["diagnosis"]},
            "failures": rows["failures"], "lead": self.lead, "conclusions": self.conclusions,
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


def prose(name: str, **values: Any) -> str:
    """The text of a template of this folder."""
    template = resources.files("ematwin.benchmarking").joinpath(name).read_text("utf-8")
    return Template(template, trim_blocks=True).render(counted=counted, **values)


def _concluded(study: StudyAnalysis) -> list[str]:
    """The paragraphs of ``conclusions.j2``."""
    table, ranks, cells, subject = study.table, study.ranks, study.cells, study.table.subject
    wins = matrix(cells, "err_mean").dropna().idxmin(axis=1).value_counts(sort=False)
    best = [str(name) for name in wins.index[wins == wins.max()]]
    different = ranks.pairs[ranks.different]
    better = different["first"].where(different["a12"] > 0.5, different["second"])
    before = {one: worse for one in ranks.order if ranks.blocks and (worse := ranks.behind(one))}
    corner = (subject.healthy == subject.lower) | (subject.healthy == subject.upper)
    zero = subject.healthy == 0.0
    # families whose moves scale the coordinates themselves
    pulled = [name for name in table.algorithms if name.partition("-")[0] in ("gwo", "woa", "da")]
    favoured = [f"{', '.join(pulled)} (drawn to the origin)"] if pulled and zero.any() else []
    favoured += ["every method that clips at the bounds"] if corner.any() else []
    diagnosis = study.diagnosis.set_index("algorithm")
    named = (diagnosis["exact"] / diagnosis["runs"]).dropna()
    without = cells[cells["done"] == 0]
    text = prose(
        "conclusions.j2", runs=len(table), done=int(table.done.sum()), enough=ENOUGH,
        missing=[f"{one.algorithm} on {one.case}" for one in without.itertuples()],
        fewest=int(cells["done"].min()), ranks=ranks, tested=math.isfinite(ranks.friedman_p),
        significant=ranks.friedman_p < ALPHA, algorithms=len(table.algorithms), best=best,
        listed=listed, surely=int(better.isin(best[:1]).sum()), won=wins.max(), whole=wins.sum(),
        different=different, before=before,
        named=named.sort_values(ascending=False, kind="stable").to_dict(),
        threshold=study.threshold, machines=len(table.provenance.get("machine", ())),
        box=table.settings["search box"], special=int((corner | zero).sum()), corner=corner.any(),
        unknowns=len(corner), favoured=favoured,
    )  # fmt: skip
    return [" ".join(part.split()) for part in text.split("\n\n") if part.strip()]
