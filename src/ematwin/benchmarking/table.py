"""The runs of a study as one table: a row for each run, in an order that no run decides.

A store may hold a hundred thousand runs, so each is dropped once its numbers and at most
`HISTORY_POINTS` points of its history are taken.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import numpy as np

from ematwin.benchmarking.plan import SHARED, Run, RunSpec, unpack
from ematwin.benchmarking.subject import Subject
from ematwin.errors import InputError, MissingExtraError
from ematwin.estimation.search import methods
from ematwin.showing.results import frame_of_rows

HISTORY_POINTS = 100  # kept of a run: improvements, evenly thinned
_INPUTS = ("run", "seed", "record_seed", "population", "iterations")
_NUMBERS = (
    "err", "err_wrapped", "cost", "relative_misfit", "evaluations", "seconds", "cpu_seconds",
)  # fmt: skip

History = tuple[np.ndarray, np.ndarray]


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
    histories: list[History]
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
    first: RunSpec | None = None
    rows: list[dict[str, Any]] = []
    histories: list[History] = []
    provenance: dict[str, Counter[str]] = {}
    for one in runs:
        spec = one.spec
        if first is None:
            first, subject = spec, Subject.stored(spec.actuator)
            names = subject.names
        elif any(getattr(spec, name) != getattr(first, name) for name in SHARED):
            raise InputError("The runs are of different studies. Report them apart.")
        done = one.status == "done" and math.isfinite(one.err)
        rows.append(
            {
                "id": spec.id, "case": spec.case, "algorithm": spec.algorithm,
                **{name: getattr(spec, name) for name in _INPUTS},
                "status": "not finite" if one.status == "done" and not done else one.status,
                **{name: getattr(one, name) for name in (*_NUMBERS, "stopped")},
                **{f"injected_{name}": k for name, k in zip(names, spec.faults, strict=True)},
                **{f"found_{name}": k for name, k in zip(names, one.faults, strict=False)},
            }
        )  # fmt: skip
        histories.append(thinned(one.history))
        for name, value in one.provenance.items():
            provenance.setdefault(name, Counter())[str(value)] += 1
    if first is None:
        raise InputError("The store holds no runs: there is nothing to report.")
    cases = _in_order({row["case"] for row in rows}, subject.cases())
    known = [method.name for method in methods()]
    algorithms = _in_order({row["algorithm"] for row in rows}, known)
    frame = frame_of_rows(rows)
    keys = {
        "case": frame["case"].map(cases.index),
        "algorithm": frame["algorithm"].map(algorithms.index),
    }
    order = frame.assign(**keys).sort_values(["case", "algorithm", "run", "id"]).index
    return RunTable(
        subject, cases, algorithms, frame.loc[order].reset_index(drop=True),
        [histories[n] for n in order], _settings(first, subject), provenance,
    )  # fmt: skip


def thinned(packed: bytes, most: int = HISTORY_POINTS) -> History:
    """Give the points where the best cost improved, and the last; at most ``most`` of them.

    A target may so seem to be met later than it was, by one kept step, and never earlier.
    """
    evaluations, cost = unpack(packed)
    known = np.isfinite(cost)
    evaluations, best = evaluations[known], np.minimum.accumulate(cost[known])
    if not len(best):
        return evaluations, best
    keep = np.flatnonzero(np.r_[True, best[1:] < best[:-1]])
    keep = np.union1d(keep, len(best) - 1)
    if len(keep) > most:
        keep = keep[np.linspace(0, len(keep) - 1, most).round().astype(int)]
    return evaluations[keep], best[keep]


def _settings(spec: RunSpec, subject: Subject) -> dict[str, str]:
    noise = "of a usual rig" if subject.model.study.noisy else "none"
    if spec.noise is not None:
        noise = str(dict(sorted(spec.noise.items())))
    return {
        "population x iterations": f"{spec.population} x {spec.iterations}",
        "search box": spec.box,
        "sensor noise": noise,
        "record made by": f"{spec.model} model",
        "actuator": str(spec.actuator.get("name", "unnamed")),
        "scenario": str(spec.scenario.get("name", "unnamed")),
    }


def _in_order(names: set[str], known: Iterable[str]) -> list[str]:
    """Known names in their order, then the others, numbers within them counting as numbers."""
    first = [name for name in known if name in names]
    others = sorted(
        names - set(first),
        key=lambda name: [
            (int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)
        ],
    )
    return first + others
