"""`compare`: algorithms compared fairly, from Python: runs, store and analysis in one call."""

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ematwin.benchmarking.analysis import StudyAnalysis, analyse
from ematwin.benchmarking.engine import LocalEngine
from ematwin.benchmarking.plan import Plan
from ematwin.benchmarking.statistics import TARGETS, THRESHOLD
from ematwin.benchmarking.store import Store
from ematwin.benchmarking.study import Progress, Tally, run_study
from ematwin.benchmarking.subject import Subject, cases_of
from ematwin.benchmarking.table import check_extra
from ematwin.errors import InputError
from ematwin.models.scenario import Scenario
from ematwin.numerics.side_by_side import cores
from ematwin.recordings.noise import Noise
from ematwin.showing.bars import told


def compare(
    algorithms: str | Iterable[str] = "paper",
    cases: str | Mapping[str, Mapping[str, float]] = "own",
    *,
    runs: int = 10,
    population: int = 50,
    iterations: int = 200,
    seed: int = 1,
    noise: Noise | None = None,
    box: str = "plain",
    actuator: Any = None,
    scenario: Scenario | str | None = None,
    store: str | Path | None = None,
    workers: int | None = None,
    time_limit: float | None = None,
    retry_failed: bool = False,
    targets: tuple[float, ...] = TARGETS,
    threshold: float = THRESHOLD,
    progress: Progress | bool | None = None,
) -> StudyAnalysis:
    """Compare search algorithms on the same recordings with the same budget.

    Parameters
    ----------
    algorithms : names of ``ematwin algorithms``, also registered by `ematwin.register`, or
        presets: paper, improved, best
    cases : "own" (cases of the kind), "multi" (random faults at once), a TOML file, or a mapping
        of names to faults: ``{"worn": {"friction": 0.4}}``
    runs : repetitions of each case with each algorithm
    population, iterations : their product is the budget of each run
    seed : of the study; all others follow from it
    noise : of the sensors, or None
    box : "plain", or "remapped", where healthy is not in a corner
    actuator : of any kind, or the name of one; None takes the default brushless actuator
    scenario : of the recordings; None takes the default of the kind
    store : file or URL in which the runs are kept: runs that it holds are not done again. None
        keeps them only until they are analysed
    workers : processes on this machine; None takes one for each core
    time_limit : s, of a run
    retry_failed : do again what ended otherwise than done
    targets : Err% whose success rates are given
    threshold : deviation from healthy, as a share of the range, that counts as a fault
    progress : True shows a bar, in a terminal or a notebook; else called with a `Tally`

    Returns
    -------
    StudyAnalysis, of all runs in the store

    Raises
    ------
    InputError
        If an algorithm or case is unknown, or a number cannot be used.
    FileError
        If the store holds another study, or cannot be written.
    MissingExtraError
        If pandas is not installed.
    """
    check_extra()
    if workers is not None and workers < 1:
        raise InputError(f"workers must be at least 1, received {workers}.")
    subject = Subject.of(actuator)
    plan = Plan(
        cases=cases_of(cases, subject.actuator, seed=seed),
        algorithms=(algorithms,) if isinstance(algorithms, str) else tuple(algorithms),
        runs=runs, population=population, iterations=iterations, seed=seed, noise=noise, box=box,
        actuator=subject.actuator, scenario=scenario,
    )  # fmt: skip
    engine = LocalEngine(workers or cores(), time_limit)

    def shown(tally: Tally) -> tuple[float, str]:
        return tally.complete / tally.planned, f"{tally.complete} of {tally.planned}"

    with (
        tempfile.TemporaryDirectory() as folder,
        Store(Path(folder, "study.db") if store is None else store) as opened,
        told(progress, "runs", shown) as tell,
    ):
        run_study(plan, opened, engine, retry_failed=retry_failed, progress=tell)
        return analyse(opened.runs(), targets=targets, threshold=threshold)
