"""The whole analysis of a study, from its runs alone."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ematwin.comparison.analysis.claims import Claim, check_claims
from ematwin.comparison.analysis.conclusions import conclude
from ematwin.comparison.analysis.convergence import (
    STATED_MISFITS,
    ToTarget,
    evaluations_to_target,
    expected_by_case,
)
from ematwin.comparison.analysis.diagnosis import THRESHOLD, Diagnosis, diagnose
from ematwin.comparison.analysis.paper import PAPER_KIND, standing_for
from ematwin.comparison.analysis.performance import (
    PaperLikeness,
    likeness_to_paper,
    performance_coefficients,
)
from ematwin.comparison.analysis.ranks import (
    RankComparison,
    average_ranks,
    compare_ranks,
    effect_sizes,
    mean_effect,
)
from ematwin.comparison.analysis.runs import RunTable, collect
from ematwin.comparison.analysis.summary import TARGETS, Cell, matrix, summarise
from ematwin.comparison.study.run import StoredRun
from ematwin.errors import InputError
from ematwin.optimizers.presets import PRESETS
from ematwin.showing import markup
from ematwin.showing.drawing import drawn
from ematwin.showing.frames import frame, frame_of_rows


@dataclass(frozen=True)
class Failure:
    """A run that did not end well."""

    id: str
    case: str
    algorithm: str
    run: int
    status: str
    message: str


@dataclass(frozen=True, repr=False)
class StudyAnalysis:
    """Everything a report says.

    Attributes
    ----------
    table : the runs
    cells : [case][algorithm]
    coefficients : (C, A) array, PC over all algorithms of the study
    coefficients_by_evaluations : (C, A) array, PC with evaluations in place of seconds
    forms : which method stands for each of the paper's six, by the paper's name
    shared : the paper's names of those
    shared_coefficients : (C, S) array, PC over them
    likeness : of ``shared_coefficients`` and the paper's Table 2
    ranks : tests over the case means of Err%
    ranks_by : (A,) average ranks by "mean Err%", by "median Err%" and by the expected running time
        to ``misfits[len // 2]``
    within : the same tests among the methods of each preset that the study has wholly, beside
        others: more methods make more pairs, and Holm's correction then allows less
    a12 : (C, A, A) array, effect sizes of each case
    misfits : relative misfits whose running times are stated
    to_target, diagnosis : one an algorithm
    threshold : of the diagnosis
    failures : every run that did not end well
    claims : the paper's, checked; conclusions : plain sentences
    """

    table: RunTable
    cells: list[list[Cell]]
    coefficients: np.ndarray
    coefficients_by_evaluations: np.ndarray
    forms: dict[str, str]
    shared: list[str]
    shared_coefficients: np.ndarray
    likeness: PaperLikeness
    ranks: RankComparison
    ranks_by: dict[str, np.ndarray]
    within: dict[str, RankComparison]
    a12: np.ndarray
    misfits: tuple[float, ...]
    to_target: list[ToTarget]
    diagnosis: list[Diagnosis]
    threshold: float
    failures: list[Failure]
    claims: list[Claim]
    conclusions: list[str]

    @property
    def of_paper(self) -> bool:
        """Whether the actuator is of the paper's kind, so that cases and misfits are comparable."""
        return self.table.subject.kind == PAPER_KIND

    @property
    def figures(self) -> Any:
        """What its figures show, see `ematwin.comparison.report.study_figures.StudyFigures`."""
        from ematwin.comparison.report.study_figures import StudyFigures

        return StudyFigures(self)

    def plot(self) -> dict[str, Any]:
        """All its figures, of plotly, by heading."""
        found: dict[str, Any] = drawn(self, "all", {"all": "plot_study"})
        return found

    def to_frame(self, each: str = "cell") -> Any:
        """A pandas DataFrame with a row for each "cell" (case and algorithm) or "run".

        Raises
        ------
        InputError
            If ``each`` is neither.
        """
        if each == "cell":
            return frame_of_rows(
                {
                    "case": cell.case, "algorithm": cell.algorithm, "runs": cell.runs,
                    "done": cell.done,
                    **{f"{name}_{part}": getattr(spread, part)
                       for name, spread in cell.metrics.items() for part in ("mean", "median")},
                }
                for row in self.cells
                for cell in row
            )  # fmt: skip
        if each != "run":
            raise InputError(f"each must be cell or run, received {each!r}.")
        table = self.table
        return frame(
            {
                "case": [table.cases[n] for n in table.case],
                "algorithm": [table.algorithms[n] for n in table.algorithm],
                "run": table.run,
                "status": table.status,
                "stopped": table.stopped,
                **table.scalars,
                **{name: table.found[:, n] for n, name in enumerate(table.subject.names)},
            }
        )

    to_dataframe = to_frame

    def __repr__(self) -> str:
        table = self.table
        return (
            f"StudyAnalysis({len(table)} runs of {', '.join(table.algorithms)} on "
            f"{len(table.cases)} cases)"
        )

    def __str__(self) -> str:
        """What was run, then the conclusions."""
        return "\n".join([f"{self._lead()}.", *self.conclusions])

    def _repr_html_(self) -> str:
        """The conclusions, then the mean Err% of each case and algorithm, in a notebook."""
        names = self.table.algorithms
        rows = [
            (row[0].case, *(f"{cell.metrics['err'].mean:.3g}" for cell in row))
            for row in self.cells
        ]
        return "".join(
            [
                markup.heading(f"{self._lead()}."),
                markup.note("Mean Err% by case and algorithm"),
                markup.table(("case", *names), rows),
                *(markup.note(sentence) for sentence in self.conclusions),
            ]
        )

    def _lead(self) -> str:
        """How many runs, and which method erred least."""
        lead = f"{len(self.table)} runs, {int(self.table.done.sum())} ended well"
        means = {
            name: np.mean([row[n].metrics["err"].mean for row in self.cells])
            for n, name in enumerate(self.table.algorithms)
        }
        known = {name: float(mean) for name, mean in means.items() if math.isfinite(mean)}
        if known:
            best = min(known, key=known.__getitem__)
            lead += f"; lowest mean Err%: {best} with {known[best]:.3g}"
        return lead

    def as_dict(self) -> dict[str, Any]:
        """All tables as plain values, None for what could not be computed."""
        table = self.table
        return plain({
            "runs": len(table),
            "done": int(table.done.sum()),
            "kind": table.subject.kind,
            "unknowns": list(table.subject.names),
            "cases": table.cases,
            "algorithms": table.algorithms,
            "settings": table.settings,
            "provenance": table.provenance,
            "cells": [
                {**asdict(cell), "failed": cell.failed} for row in self.cells for cell in row
            ],
            "performance_coefficient": _named(self.coefficients, table.cases, table.algorithms),
            "performance_coefficient_by_evaluations": _named(
                self.coefficients_by_evaluations, table.cases, table.algorithms
            ),
            "forms_of_papers_algorithms": self.forms,
            "performance_coefficient_of_papers_algorithms": _named(
                self.shared_coefficients, table.cases, self.shared
            ),
            "likeness_to_paper": asdict(self.likeness),
            "ranks": {
                "average": dict(
                    zip(table.algorithms, self.ranks.average_ranks.tolist(), strict=True)
                ),
                "blocks": self.ranks.blocks,
                "left_out": self.ranks.left_out,
                "friedman": self.ranks.friedman,
                "friedman_p": self.ranks.friedman_p,
                "average_by": {
                    by: dict(zip(table.algorithms, values.tolist(), strict=True))
                    for by, values in self.ranks_by.items()
                },
                "smallest_p_holm": self.ranks.smallest_holm,
                "within_presets": {
                    preset: [asdict(pair) for pair in ranks.pairs]
                    for preset, ranks in self.within.items()
                },
                "pairs": [asdict(pair) for pair in self.ranks.pairs],
                "notes": self.ranks.notes,
            },
            "evaluations_to_target": [asdict(curve) for curve in self.to_target],
            "diagnosis": {
                "threshold": self.threshold,
                "algorithms": [asdict(row) for row in self.diagnosis],
            },
            "failures": [asdict(failure) for failure in self.failures],
            "claims": [asdict(claim) for claim in self.claims],
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
    """Analyse the runs of a study, in any order.

    Parameters
    ----------
    targets : Err% whose success rates are given
    misfits : relative misfits whose expected running times are given; ranks are by the middle one
    threshold : deviation from healthy, as a share of the range, that counts as a fault
    seed : of the bootstrap

    Raises
    ------
    InputError
        If there is no run, a target or misfit is not positive, or the threshold not in (0, 0.5).
    """
    if not (targets and all(target > 0.0 and math.isfinite(target) for target in targets)):
        raise InputError(f"Targets of Err% must be positive, received {targets}.")
    if not (misfits and all(0.0 < misfit < 1.0 for misfit in misfits)):
        raise InputError(f"Misfits to reach must lie between 0 and 1, received {misfits}.")
    if not 0.0 < threshold < 0.5:
        raise InputError(f"The threshold must lie between 0 and 0.5, received {threshold:g}.")
    table = collect(runs)
    cells = summarise(table, targets, seed)
    errors, seconds = matrix(cells, "err"), matrix(cells, "seconds")
    kind = table.subject.kind
    forms = standing_for(table.algorithms) if kind == PAPER_KIND else {}
    shared = list(forms)
    places = [table.algorithms.index(form) for form in forms.values()]
    shared_coefficients = performance_coefficients(seconds[:, places], errors[:, places])
    a12 = effect_sizes(table)
    ranks = compare_ranks(errors, mean_effect(a12), table.cases, table.algorithms)
    within = _within_presets(errors, mean_effect(a12), table)
    middle = misfits[len(misfits) // 2]
    ranks_by = {
        "mean Err%": average_ranks(errors),
        "median Err%": average_ranks(matrix(cells, "err", "median")),
        f"evaluations to {100.0 * middle:g} %": average_ranks(expected_by_case(table, middle)),
    }
    claims = check_claims(_as_paper(cells, forms), shared, shared_coefficients) if shared else []
    diagnosis = diagnose(table, threshold)
    done = table.done
    failures = [
        Failure(
            table.ids[n],
            table.cases[table.case[n]],
            table.algorithms[table.algorithm[n]],
            int(table.run[n]),
            table.status[n] if table.status[n] != "done" else "not finite",
            table.stopped[n],
        )
        for n in np.flatnonzero(~done)
    ]
    return StudyAnalysis(
        table, cells, performance_coefficients(seconds, errors),
        performance_coefficients(matrix(cells, "evaluations"), errors), forms, shared,
        shared_coefficients, likeness_to_paper(shared_coefficients, table.cases, shared, kind),
        ranks, ranks_by, within, a12, misfits, evaluations_to_target(table, misfits, seed),
        diagnosis, threshold, failures, claims,
        conclude(table, cells, ranks, within, diagnosis, threshold),
    )  # fmt: skip


def _within_presets(
    errors: np.ndarray, a12: np.ndarray, table: RunTable
) -> dict[str, RankComparison]:
    """The tests among the methods of each preset, where the study has them all and others."""
    found = {}
    for preset, names in PRESETS.items():
        if set(names) < set(table.algorithms):
            places = [table.algorithms.index(name) for name in names]
            found[preset] = compare_ranks(
                errors[:, places], a12[np.ix_(places, places)], table.cases, list(names)
            )
    return found


def _as_paper(cells: list[list[Cell]], forms: dict[str, str]) -> list[list[Cell]]:
    """The cells of the methods that stand for the paper's, by its names and in its order."""
    return [
        [replace(cell, algorithm=name) for name, form in forms.items() for cell in row
         if cell.algorithm == form]
        for row in cells
    ]  # fmt: skip


def _named(values: np.ndarray, cases: list[str], algorithms: list[str]) -> dict[str, Any]:
    return {
        case: dict(zip(algorithms, row, strict=True))
        for case, row in zip(cases, values.tolist(), strict=True)
    }


def plain(value: Any) -> Any:
    """Values for JSON: None for NaN and infinity, text for keys, lists for arrays."""
    if isinstance(value, Mapping):
        return {
            " -> ".join(key) if isinstance(key, tuple) else str(key): plain(item)
            for key, item in value.items()
        }
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
