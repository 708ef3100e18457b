"""From one recording to the faults, by the values with which the twin answers as it does."""

import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.along_motion import NO_SEARCH, usual_search
from ematwin.estimation.assess import assess, unassessed
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.corrected_problem import as_searched
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.findings import (
    caveats_of,
    doubts_of,
    obstacles_to,
    remarks_on,
    verdict_on,
)
from ematwin.estimation.identification import Identification
from ematwin.estimation.initial_angle import estimate_initial_angle
from ematwin.estimation.intervals import Interval
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.multistart import Multistart, good_fit
from ematwin.estimation.problem import Problem
from ematwin.estimation.rivals import Rival, hints, objections, qualified, rivals_of
from ematwin.estimation.search import Found, Progress, Search, find, named
from ematwin.estimation.verdict import Verdict
from ematwin.models.base import Model
from ematwin.models.channels_agree import checked
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.optimizers.base import ITERATIONS, POPULATION, Optimizer
from ematwin.recordings.read import assumptions
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told

if TYPE_CHECKING:
    from ematwin.estimation.thresholds import Threshold
    from ematwin.estimation.uncertainty import Method


def identified(
    ready: "Prepared",
    actuator: ParameterSet,
    baseline: Baseline,
    algorithm: str | Search | Optimizer | Any | None = None,
    *,
    budget: int | None = None,
    population: int = POPULATION,
    iterations: int = ITERATIONS,
    seed: int = 1,
    only: Iterable[str] | None = None,
    held: Mapping[str, float] | Any | None = None,
    checkpoint: str | Path | None = None,
    progress: Progress | bool | None = None,
    threads: int | None = None,
    uncertainty: "str | Method | None" = None,
    thresholds: Mapping[str, float | str] | None = None,
) -> Identification:
    """The values with which the twin answers as a prepared recording.

    Other parameters are as in `ematwin.identify`.
    """
    model, recording = model_of(actuator), ready.recording
    if compares_sets(model, algorithm, budget, uncertainty, thresholds):
        from ematwin.estimation.mixed_effects import identified_by_sets

        return identified_by_sets([ready], actuator, baseline, only=only, held=held)
    warnings = list(ready.warnings)
    if thresholds and uncertainty is None:
        uncertainty = "laplace"
    method = None
    if uncertainty is not None:  # imported where it is asked for: most identifications are not
        from ematwin.estimation.uncertainty import named as way_of

        method = way_of(uncertainty)

    def problem_of(one: Recording) -> Problem:
        made = Problem.of(one, actuator, only=only, held=held, threads=threads)
        return as_searched(made)

    problem = problem_of(recording)
    limits: dict[str, Threshold] = {}
    if thresholds:
        from ematwin.estimation.thresholds import thresholds_of

        limits = thresholds_of(thresholds, problem.unknowns, actuator)
    search: Search = named(
        model.default_search if algorithm is None else algorithm,
        population=population, iterations=iterations, checkpoint=checkpoint,
    )  # fmt: skip
    usual = algorithm is None and budget is None
    started = time.perf_counter()
    with told(progress, "searching", _shown) as tell:
        quick = named(model.default_search)
        where = estimate_initial_angle(
            recording, problem, problem_of, quick, seed=seed, progress=tell
        )
        recording, problem = where.recording, where.problem
        warnings += where.said
        found = where.found
        if found is None or not (usual or found.stopped == "interrupted"):
            if usual:
                search = usual_search(model, actuator, problem)
            found = find(problem, search, budget=budget, seed=seed, progress=tell)
        if usual and baseline.calibrated and not ready.barred:
            found = searched_further(problem, found, seed, tell)
        try:
            if found.stopped == "interrupted":
                raise KeyboardInterrupt
            assessed = assess(model, actuator, problem, found, baseline, threads)
            if found.method == NO_SEARCH:
                found = replace(found, cost=assessed.cost)
        except KeyboardInterrupt:
            found = replace(found, stopped="interrupted")
            assessed = unassessed(model, actuator, problem, found, baseline)
        sure = None
        if method is not None and assessed.joint is not None:
            from ematwin.estimation.uncertainty import Question

            question = Question(problem, actuator, assessed, assessed.joint, limits)
            best = found.cost

            def tell_more(spent: int, most: int) -> None:
                if tell is not None:
                    tell(spent, best, most)

            sure = method.run(question, seed=seed, report=tell_more)
    point = np.array([assessed.values[name] for name in problem.names])
    cost = found.cost if found.problem is not None else assessed.cost
    estimate = estimate_of(
        model, actuator, problem, point, assessed.covariance, problem.relative_misfit(cost),
        recording, dict(problem.comparisons[0].statistics),
    )  # fmt: skip
    warnings += doubts_of(estimate, found, problem, assessed.sharp_errors)
    warnings += remarks_on(model, actuator, assessed)
    obstacles = [
        *ready.barred,
        *model.excitation(recording, actuator),
        *obstacles_to(model.load, recording, problem, found, estimate.misfit, assessed, baseline),
        *where.obstacles,
    ]
    faults = [one for one in problem.unknowns if one.role == "fault"]

    def judged(obstacles: list[str]) -> Verdict:
        return verdict_on(
            model, actuator, faults, assessed.sets, assessed.intervals, assessed.physical,
            calibrated=baseline.calibrated, obstacles=obstacles,
        )  # fmt: skip

    verdict = judged(obstacles)
    if found.problem is None:
        rivals: list[Rival] = []
        try:
            rivals = rivals_of(model, actuator, problem, assessed, baseline, verdict, threads)
            objected = objections(rivals, verdict)
        except KeyboardInterrupt:
            found = replace(found, stopped="interrupted")
            objected = ["Interrupted before other forms of the faults were tried."]
        warnings += hints(rivals, verdict)
        if objected:
            verdict = judged(objected)
        verdict = qualified(rivals, verdict)
    warnings += caveats_of(problem, verdict)
    seconds = time.perf_counter() - started
    return Identification(
        verdict=verdict,
        estimate=estimate,
        faults=model.as_faults(problem.values(point)),
        cost=found.cost,
        evaluations=found.evaluations,
        seconds=seconds,
        history=found.history,
        algorithm=found.method,
        seed=found.seed,
        stopped=found.stopped,
        searched=problem.names,
        warnings=warnings,
        assumed=assumptions(recording),
        actuator=actuator,
        provenance=recording.provenance,
        intervals=_ends(assessed.intervals, problem.names),
        physical_values={name: (x, i.low, i.high) for name, (x, i) in assessed.physical.items()},
        contrasts={name: (x, (i.low, i.high)) for name, (x, i) in assessed.contrasts.items()},
        nuisances={name: (x, (i.low, i.high)) for name, (x, i) in assessed.nuisances.items()},
        others=assessed.others,
        fitted={n: x for n, x in assessed.values.items() if n not in problem.names},
        calibrated=baseline.calibrated,
        recording=recording,
        uncertainty=sure,
        reference_runs=assessed.reference_runs,
        probabilities={} if assessed.sets is None else assessed.sets.probabilities,
    )


def searched_further(problem: Problem, near: Found, seed: int, tell: Progress | None) -> Found:
    """The result of a search from samples all over, where a descent ended in a local minimum.

    A reference corrects what the twin of a calibrated actuator misses, so that a poor fit is one.
    """
    descended = near.method == LocalDescent().name and near.stopped == "converged"
    poor = problem.relative_misfit(near.cost) > good_fit(problem)
    if not (descended and poor and problem.comparisons[0].has_reference):
        return near
    far = find(problem, Multistart(), seed=seed, progress=tell)
    best = min(near, far, key=lambda one: one.cost)
    return replace(best, evaluations=near.evaluations + far.evaluations)


def compares_sets(model: Model, *asked: Any) -> bool:
    """Whether sets of faults are compared: of kinds that need it, if nothing else is asked for."""
    return model.recordings_differ and not any(asked)


def _shown(done: int, cost: float, budget: int) -> tuple[float, str]:
    """The share done of a search, and words beside it."""
    return done / budget, f"best misfit {cost:.4g}"


class Prepared(NamedTuple):
    """A recording as it is compared.

    Attributes
    ----------
    recording : at the rate at which it is compared
    warnings : sentences on doubts about it
    barred : sentences on channels that forbid a verdict
    """

    recording: Recording
    warnings: list[str]
    barred: list[str]


def prepared(recording: Recording, actuator: ParameterSet, load: float | None = None) -> Prepared:
    """A recording that is checked, with the load that is given, at the rate it is compared at.

    Raises
    ------
    RecordError
        If it cannot be identified from.
    InputError
        If it has a load already, or the kind takes none.
    """
    model = model_of(actuator)
    recording = _loaded(model, recording, load)
    doubts, barred = checked(model, recording, actuator)
    warnings = [*recording.provenance.get("warnings", []), *doubts]
    return Prepared(model.averaged(recording), warnings, barred)


def _loaded(model: Model, recording: Recording, load: float | None) -> Recording:
    """The recording with a constant load, where one is given."""
    if load is None:
        return recording
    if isinstance(load, bool) or not isinstance(load, int | float | np.number):
        raise InputError(f"load must be a number in SI units, received {load!r}.")
    if model.load is None:
        raise InputError(f"The kind {model.kind} takes no load; leave it out.")
    if model.load in recording.channels:
        raise InputError(
            f"{recording.name} holds the load already; leave {load:g} out, or drop the channel."
        )
    return recording.changed(**{model.load: np.full(len(recording), float(load))})


def _ends(
    intervals: Mapping[str, Interval], names: Iterable[str]
) -> dict[str, tuple[float, float]]:
    return {name: (intervals[name].low, intervals[name].high) for name in names}


def estimate_of(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    point: np.ndarray,
    spread: np.ndarray,
    misfit: float,
    recording: Recording,
    statistics: Mapping[str, float] | None = None,
) -> Estimate:
    """The estimate that a point of a problem of one recording is."""
    unknowns = problem.unknowns
    return Estimate(
        names=problem.names,
        values=np.array(point, dtype=float),
        covariance=spread,
        units={one.name: one.unit for one in unknowns},
        healthy={one.name: one.healthy for one in unknowns},
        ranges={one.name: one.width for one in unknowns},
        directions={one.name: one.direction_of for one in unknowns if one.direction_of},
        held=dict(problem.held),
        misfit=misfit,
        actuator=actuator.name,
        kind=model.kind,
        fingerprint=actuator.fingerprint,
        labels=recording.labels,
        source=recording.source or str(recording.provenance.get("file", "")),
        when=None if recording.start is None else recording.start.isoformat(),
        statistics=statistics or {},
    )
