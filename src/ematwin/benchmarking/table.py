"""The runs of a study as one table: a row for each run, in an order that no run decides.

A store may hold a hundred thousand runs, so each is dropped once its numbers and at most
`HISTORY_POINTS` points of its history are taken.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import numpy as np

from ematwin.benchmarking.plan import SHARED, Run, unpack
from ematwin.benchmarking.subject import Subject
from ematwin.errors import InputError, MissingExtraError
from ematwin.estimation.search import methods
from ematwin.showing.results import frame

HISTORY_POINTS = 100  # kept of a run: improvements, evenly thinned
_INPUTS = ("case", "algorithm", "run", "seed", "record_seed", "population", "iterations")
_OUTCOME = (
    "status", "err", "err_wrapped", "cost", "relative_misfit", "evaluations", "seconds",
    "cpu_seconds", "stopped",
)  # fmt: skip


def check_extra() -> None:
    """Raise `MissingExtraError` unless pandas, which the analysis needs, is there."""
    if find_spec("pandas") is None:
        raise MissingExtraError("pandas", "study", "The analysis of a study")


@dataclass(frozen=True)
class RunTable:
    """Runs of a study."""

    subject: Subject  # the actuator and its d searched unknowns
    # cases, algorithms: names; first those that the kind and ``ematwin algorithms`` know, in
    # their order
    cases: list[str]
    algorithms: list[str]
    # DataFrame, a row for each run, ordered by case, algorithm and repetition: id, case,
    # algorithm, run, seeds, budget, status, err and other numbers (NaN unless done), stopped,
    # injected_ and found_ of each unknown
    frame: Any
    # evaluations and best cost of each row, thinned; both empty if it kept none
    histories: list[tuple[np.ndarray, np.ndarray]]
    settings: dict[str, str]  # of the study, in words
    provenance: dict[str, Counter[str]]  # how many runs have which value, by name

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def done(self) -> np.ndarray:
        """(R,) bool array: the run ended well and has an error."""
        return np.asarray(self.frame["status"] == "done")

    @cached_property
    def cells(self) -> dict[tuple[str, str], np.ndarray]:
        """Places of the rows of each case and algorithm, empty where there are none."""
        groups = self.frame.groupby(["case", "algorithm"], sort=False).indices
        none = np.empty(0, dtype=int)
        return {(c, a): groups.get((c, a), none) for c in self.cases for a in self.algorithms}


def collect(runs: Iterable[Run]) -> RunTable:
    """Gather runs of one study, in any order, into a table."""
    rows: list[dict[str, Any]] = []
    provenance: dict[str, Counter[str]] = {}
    first = None
    for one in runs:
        spec = one.spec
        if first is None:
            first, subject = spec, Subject.stored(spec.actuator)
        elif any(getattr(spec, name) != getattr(first, name) for name in SHARED):
            raise InputError("The runs are of different studies. Report them apart.")
        row = {name: getattr(spec, name) for name in ("id", *_INPUTS)}
        row |= {name: getattr(one, name) for name in _OUTCOME}
        for which, vector in (("injected", spec.faults), ("found", one.faults)):
            row |= {f"{which}_{name}": k for name, k in zip(subject.names, vector, strict=False)}
        rows.append(row | {"history": thinned(one.history)})
        for name, value in one.provenance.items():
            provenance.setdefault(name, Counter())[str(value)] += 1
    if first is None:
        raise InputError("The store holds no runs: there is nothing to report.")
    cases = _in_order({row["case"] for row in rows}, subject.cases())
    algorithms = _in_order({row["algorithm"] for row in rows}, [one.name for one in methods()])
    rows.sort(
        key=lambda row: (
            cases.index(row["case"]), algorithms.index(row["algorithm"]), row["run"], row["id"]
        )
    )  # fmt: skip
    noise = "of a usual rig" if subject.model.study.noisy else "none"
    settings = {
        "population x iterations": f"{first.population} x {first.iterations}",
        "search box": first.box,
        "sensor noise": noise if first.noise is None else str(dict(sorted(first.noise.items()))),
        "record made by": f"{first.model} model",
        "actuator": str(first.actuator.get("name", "unnamed")),
        "scenario": str(first.scenario.get("name", "unnamed")),
    }
    histories = [row.pop("history") for row in rows]
    return RunTable(subject, cases, algorithms, frame(rows), histories, settings, provenance)


def thinned(packed: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Give the points where the best cost improved, and the last; at most `HISTORY_POINTS`.

    A target may so seem to be met later than it was, by one kept step, and never earlier.
    """
    evaluations, cost = unpack(packed)
    known = np.isfinite(cost)
    evaluations, best = evaluations[known], np.minimum.accumulate(cost[known])
    improved = np.diff(best, prepend=np.inf) < 0.0
    improved[-1:] = True
    keep = np.flatnonzero(improved)
    if len(keep) > HISTORY_POINTS:
        keep = keep[np.linspace(0, len(keep) - 1, HISTORY_POINTS).round().astype(int)]
    return evaluations[keep], best[keep]


def _in_order(names: set[str], known: Iterable[str]) -> list[str]:
    """Known names in their order, then the others, numbers within them counting as numbers."""
    first = [name for name in known if name in names]
    return first + sorted(
        names - set(first), key=lambda name: re.sub(r"\d+", lambda n: n[0].zfill(20), name)
    )
