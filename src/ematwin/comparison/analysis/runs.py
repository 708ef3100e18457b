"""The runs of a study as columns: scalars and thinned histories, gathered in one pass.

A store may hold a hundred thousand runs, so each is dropped once its scalars and at most
`HISTORY_POINTS` points of its history are taken.
"""

import re
from array import array
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np

from ematwin.comparison.analysis.paper import PAPER_ALGORITHMS, PAPER_KIND, TABLE_2
from ematwin.comparison.study.history import PackedHistory
from ematwin.comparison.study.run import StoredRun
from ematwin.comparison.study.subject import Subject
from ematwin.errors import InputError
from ematwin.optimizers.presets import PRESETS

HISTORY_POINTS = 100  # kept of a run: improvements, evenly thinned
_SCALARS = (
    "cost", "relative_misfit", "err", "err_wrapped", "evaluations", "seconds", "cpu_seconds",
)  # fmt: skip


@dataclass(frozen=True)
class RunTable:
    """Runs by columns, ordered by case, algorithm and repetition.

    Attributes
    ----------
    subject : the actuator and its d searched unknowns
    cases, algorithms : names, those of the kind and of the paper first and in their order
    case, algorithm : (R,) int arrays, places in ``cases`` and ``algorithms``
    run, seed, record_seed, population, iterations : (R,) int arrays
    ids, status, stopped : (R,) lists of str
    injected, found : (R, d) arrays, NaN where nothing was found
    scalars : (R,) arrays by name: cost, relative_misfit, err, err_wrapped, evaluations, seconds,
        cpu_seconds
    settings, provenance : how many runs have which value, by name
    """

    subject: Subject
    cases: list[str]
    algorithms: list[str]
    case: np.ndarray
    algorithm: np.ndarray
    run: np.ndarray
    seed: np.ndarray
    record_seed: np.ndarray
    population: np.ndarray
    iterations: np.ndarray
    ids: list[str]
    status: list[str]
    stopped: list[str]
    injected: np.ndarray
    found: np.ndarray
    scalars: dict[str, np.ndarray]
    settings: dict[str, Counter[str]]
    provenance: dict[str, Counter[str]]
    history_start: np.ndarray
    history_stop: np.ndarray
    history_evaluations: np.ndarray
    history_cost: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def done(self) -> np.ndarray:
        """(R,) bool array: the run ended well and has an error."""
        ended = np.array([status == "done" for status in self.status], dtype=bool)
        return ended & np.isfinite(self.scalars["err"])

    def cell(self, case: int, algorithm: int) -> slice:
        """The runs of a case and an algorithm; they stand together."""
        key = self.case * len(self.algorithms) + self.algorithm
        wanted = case * len(self.algorithms) + algorithm
        return slice(
            int(np.searchsorted(key, wanted, "left")), int(np.searchsorted(key, wanted, "right"))
        )

    def history(self, run: int) -> tuple[np.ndarray, np.ndarray]:
        """Evaluations and best cost of a run, thinned; both empty if it kept none."""
        part = slice(int(self.history_start[run]), int(self.history_stop[run]))
        return self.history_evaluations[part], self.history_cost[part]


def collect(runs: Iterable[StoredRun]) -> RunTable:
    """Gather runs, in any order, into columns.

    Raises
    ------
    InputError
        If there is no run, or they are of actuators with different unknowns.
    """
    subjects = _Subjects()
    names: list[tuple[str, str]] = []
    ids: list[str] = []
    status: list[str] = []
    stopped: list[str] = []
    whole = {name: array("q") for name in _WHOLE}
    scalars = {name: array("d") for name in _SCALARS}
    injected, found = array("d"), array("d")
    evaluations, cost = array("q"), array("d")
    start = array("q", [0])
    settings: dict[str, Counter[str]] = {}
    provenance: dict[str, Counter[str]] = {}
    shared: dict[str, str] = {}  # equal texts are kept once
    for stored in runs:
        spec, result = stored.spec, stored.result
        subject = subjects.of(spec.actuator)
        size = len(subject.names)
        names.append((spec.case, spec.algorithm))
        ids.append(result.id)
        status.append(shared.setdefault(result.status, result.status))
        stopped.append(shared.setdefault(result.stopped, result.stopped))
        for name in _WHOLE:
            whole[name].append(getattr(spec, name))
        for name in _SCALARS:
            scalars[name].append(float(getattr(result, name)))
        injected.extend(spec.faults)
        found.extend(result.faults if len(result.faults) == size else [np.nan] * size)
        kept_evaluations, kept_cost = thinned(result.history)
        evaluations.frombytes(kept_evaluations.astype(np.int64).tobytes())
        cost.frombytes(kept_cost.tobytes())
        start.append(len(cost))
        _count(settings, _settings(stored, subject))
        _count(provenance, {k: str(v) for k, v in result.provenance.items()})
    if not ids:
        raise InputError("The store holds no runs: there is nothing to report.")
    return _ordered(
        subjects.first, names, ids, status, stopped, whole, scalars, injected, found, start,
        evaluations, cost, settings, provenance,
    )  # fmt: skip


# the paper's six in its order, as published before this package's own form, then the others
_ORDER = list(dict.fromkeys(chain(
    *zip(PRESETS["paper"], PAPER_ALGORITHMS, strict=True), PRESETS["improved"], PRESETS["best"]
)))  # fmt: skip
_WHOLE = ("run", "seed", "record_seed", "population", "iterations")


class _Subjects:
    """The subject of all runs; runs of one study share their actuator's values in memory."""

    def __init__(self) -> None:
        self._seen: dict[int, tuple[object, Subject]] = {}

    @property
    def first(self) -> Subject:
        return next(iter(self._seen.values()))[1]

    def of(self, values: dict[str, Any]) -> Subject:
        if id(values) not in self._seen:
            subject = Subject.stored(values)
            self._seen[id(values)] = (values, subject)  # kept: its id must stay its own
            if _told_apart(subject) != _told_apart(self.first):
                raise InputError(
                    f"The runs are of {self.first.actuator.name} and {subject.actuator.name}, "
                    "whose unknowns differ. Report them apart."
                )
        return self._seen[id(values)][1]


def _told_apart(subject: Subject) -> list[tuple[object, ...]]:
    """What must be the same of the unknowns of all runs."""
    return [(one.name, one.healthy, one.lower, one.upper) for one in subject.unknowns]


def _ordered(
    subject: Subject,
    names: list[tuple[str, str]],
    ids: list[str],
    status: list[str],
    stopped: list[str],
    whole: dict[str, "array[int]"],
    scalars: dict[str, "array[float]"],
    injected: "array[float]",
    found: "array[float]",
    start: "array[int]",
    evaluations: "array[int]",
    cost: "array[float]",
    settings: dict[str, Counter[str]],
    provenance: dict[str, Counter[str]],
) -> RunTable:
    """The table in an order that does not depend on which run ended first."""
    own = [*TABLE_2] if subject.kind == PAPER_KIND else [*subject.model.cases(subject.actuator)]
    cases = _in_order({case for case, _ in names}, own)
    algorithms = _in_order({algorithm for _, algorithm in names}, _ORDER)
    case_place = {name: n for n, name in enumerate(cases)}
    algorithm_place = {name: n for n, name in enumerate(algorithms)}
    case = np.array([case_place[name] for name, _ in names])
    algorithm = np.array([algorithm_place[name] for _, name in names])
    order = np.lexsort((np.array(ids), np.asarray(whole["run"]), algorithm, case))
    starts = np.asarray(start)
    columns = {name: np.asarray(values)[order] for name, values in whole.items()}
    size = len(subject.names)
    return RunTable(
        subject=subject,
        cases=cases,
        algorithms=algorithms,
        case=case[order],
        algorithm=algorithm[order],
        **columns,
        ids=[ids[n] for n in order],
        status=[status[n] for n in order],
        stopped=[stopped[n] for n in order],
        injected=np.asarray(injected).reshape(-1, size)[order],
        found=np.asarray(found).reshape(-1, size)[order],
        scalars={name: np.asarray(values)[order] for name, values in scalars.items()},
        settings=settings,
        provenance=provenance,
        history_start=starts[:-1][order],
        history_stop=starts[1:][order],
        history_evaluations=np.asarray(evaluations),
        history_cost=np.asarray(cost),
    )


def thinned(
    history: Sequence[tuple[int, float]], most: int = HISTORY_POINTS
) -> tuple[np.ndarray, np.ndarray]:
    """The points where the best cost improved, and the last; at most ``most`` of them.

    A target may so seem to be met later than it was, by one kept step, and never earlier.

    Returns
    -------
    evaluations : int64 array, cost : float array
    """
    if isinstance(history, PackedHistory):
        evaluations, cost = history.arrays()
    else:
        pairs = np.array(list(history), dtype=float).reshape(-1, 2)
        evaluations, cost = pairs[:, 0].astype(np.int64), pairs[:, 1]
    known = np.isfinite(cost)
    if not known.all():
        evaluations, cost = evaluations[known], cost[known]
    if not len(cost):
        return evaluations[:0], cost[:0]
    best = np.minimum.accumulate(cost)
    improved = np.empty(len(best), dtype=bool)
    improved[0] = improved[-1] = True
    np.less(best[1:-1], best[:-2], out=improved[1:-1])
    keep = np.flatnonzero(improved)
    if len(keep) > most:
        keep = keep[_even(len(keep), most)]
    return evaluations[keep], best[keep]


@lru_cache(maxsize=1024)
def _even(length: int, most: int) -> np.ndarray:
    """Places of ``most`` of ``length`` points, the first and the last among them."""
    return np.linspace(0, length - 1, most).round().astype(int)


def _settings(stored: StoredRun, subject: Subject) -> dict[str, str]:
    spec = stored.spec
    noise = "of a usual rig" if subject.model.noisy else "none"
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


def _count(counters: dict[str, Counter[str]], values: dict[str, str]) -> None:
    for name, value in values.items():
        counters.setdefault(name, Counter())[value] += 1


def _in_order(names: set[str], known: list[str]) -> list[str]:
    """Known names in their order, then the others, numbers within them counting as numbers."""
    others = sorted(
        names - set(known),
        key=lambda name: [
            (int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)
        ],
    )
    return [name for name in known if name in names] + others
