"""From one recording to the faults, by the values with which the twin answers as it does."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.along_motion import NO_SEARCH, shown_along, usual_search
from ematwin.estimation.assess import Assessment, assess, unassessed
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.corrected_problem import as_searched
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.findings import (
    doubts_of,
    obstacles_to,
    remarks_on,
    verdict_on,
)
from ematwin.estimation.identification import Identification
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.multistart import Multistart, good_fit
from ematwin.estimation.problem import Problem
from ematwin.estimation.rivals import rivals_of, weighed
from ematwin.estimation.search import Found, Progress, Search, find, named
from ematwin.estimation.thresholds import thresholds_of
from ematwin.estimation.uncertainty import Method, Question, Uncertainty
from ematwin.estimation.uncertainty import named as way_of
from ematwin.estimation.verdict import Verdict
from ematwin.models.base import Model
from ematwin.models.channels_agree import checked
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.recordings.read import assumptions
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told


@noting_interrupts()
def identified(
    ready: "Prepared",
    actuator: ParameterSet,
    baseline: Baseline,
    search: Search | None = None,
    *,
    budget: int | None = None,
    seed: int = 1,
    only: Iterable[str] | None = None,
    held: Mapping[str, float] | Any | None = None,
    progress: Progress | bool | None = None,
    threads: int | None = None,
    uncertainty: str | Method | None = None,
    thresholds: Mapping[str, float | str] | None = None,
) -> Identification:
    """The values with which the twin answers as a prepared recording.

    ``search`` is the usual one if not given; other parameters are as in `ematwin.identify`.
    """
    model, recording = model_of(actuator), ready.recording
    if compares_sets(model, search, budget, uncertainty, thresholds):
        from ematwin.estimation.mixed_effects import identified_by_sets

        return identified_by_sets([ready], actuator, baseline, only=only, held=held)
    if thresholds and uncertainty is None:
        uncertainty = "laplace"
    method = None if uncertainty is None else way_of(uncertainty)

    def problem_of(one: Recording) -> Problem:
        return as_searched(Problem.of(one, actuator, only=only, held=held, threads=threads))

    problem = problem_of(recording)
    limits = thresholds_of(thresholds or {}, problem.unknowns, actuator)
    quick, usual = named(model.default_search), search is None and budget is None
    started = time.perf_counter()

    def shown(done: int, cost: float, budget: int) -> tuple[float, str]:
        return done / budget, f"{done}/{budget} simulations, best misfit {cost:.4g}"

    with told(progress, "searching", shown) as tell:
        where = estimate_initial_angle(
            recording, problem, problem_of, quick, seed=seed, progress=tell
        )
        recording, problem = where.recording, where.problem
        loop = baseline.closed_loop
        along = shown_along(model, actuator, problem) if usual or loop is not None else ""
        if loop is not None and not along:
            baseline = replace(baseline, misfit=loop.misfit, scatter=loop.scatter)
        found = where.found
        if found is None or not (usual or found.stopped == "interrupted"):
            if usual:
                search = usual_search(model, along)
            found = find(problem, search or quick, budget=budget, seed=seed, progress=tell)
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
            question = Question(problem, actuator, assessed, assessed.joint, limits)
            best = found.cost

            def tell_more(spent: int, most: int) -> None:
                if tell is not None:
                    tell(spent, best, most)

            sure = method.run(question, seed=seed, report=tell_more)
    cost = found.cost if found.problem is not None else assessed.cost
    point = np.array([assessed.values[name] for name in problem.names])
    estimate = estimate_of(
        actuator, problem, point, assessed.covariance, problem.relative_misfit(cost), recording
    )
    obstacles = [
        *ready.barred,
        *model.excitation(recording, actuator),
        *obstacles_to(model.load, recording, problem, found, estimate.misfit, assessed, baseline),
        *where.obstacles,
    ]
    verdict = verdict_on(model, actuator, problem, assessed, baseline, obstacles)
    hints: list[str] = []
    if found.problem is None:
        try:
            rivals = rivals_of(model, actuator, problem, assessed, baseline, verdict, threads)
            verdict, hints = weighed(rivals, verdict)
        except KeyboardInterrupt:
            found = replace(found, stopped="interrupted")
            verdict = Verdict.none("Interrupted before other forms of the faults were tried.")
    warnings = [
        *ready.warnings,
        *where.said,
        *doubts_of(estimate, found, problem, assessed.sharp_errors),
        *remarks_on(model, actuator, assessed),
        *hints,
        *dict.fromkeys(o.caveat for o in problem.unknowns if o.caveat and o.name in verdict.faults),
    ]
    return concluded(
        actuator, recording, problem, estimate, found, assessed, verdict, warnings, baseline,
        started, sure,
    )  # fmt: skip


def concluded(
    actuator: ParameterSet,
    recording: Recording,
    problem: Problem,
    estimate: Estimate,
    found: Found,
    assessed: Assessment,
    verdict: Verdict,
    warnings: list[str],
    baseline: Baseline,
    started: float,
    uncertainty: Uncertainty | None = None,
) -> Identification:
    """Collect the result of a search, its assessment and the verdict for a user."""
    values = dict(zip(problem.names, estimate.values.tolist(), strict=True))
    return Identification(
        verdict=verdict,
        estimate=estimate,
        faults=model_of(actuator).as_faults({**problem.held, **values}),
        cost=found.cost,
        evaluations=found.evaluations,
        seconds=time.perf_counter() - started,
        history=found.history,
        algorithm=found.method,
        seed=found.seed,
        stopped=found.stopped,
        searched=problem.names,
        warnings=warnings,
        assumed=assumptions(recording),
        actuator=actuator,
        provenance=recording.provenance,
        intervals={name: assessed.intervals[name] for name in problem.names},
        physical_values={name: (x, *ends) for name, (x, ends) in assessed.physical.items()},
        contrasts=assessed.contrasts,
        nuisances=assessed.nuisances,
        others=assessed.others,
        fitted={n: x for n, x in assessed.values.items() if n not in problem.names},
        calibrated=baseline.calibrated,
        recording=recording,
        uncertainty=uncertainty,
        reference_runs=assessed.reference_runs,
        probabilities={} if assessed.sets is None else assessed.sets.probabilities,
    )


@dataclass(frozen=True)
class InitialAngle:
    """A recording that is counted as its twin counts."""

    recording: Recording
    problem: Problem  # of it
    found: Found | None = None  # by the default search there; None where none was needed
    said: tuple[str, ...] = ()  # sentences on the turns applied
    obstacles: tuple[str, ...] = ()  # sentences on why it cannot be placed


def estimate_initial_angle(
    recording: Recording,
    problem: Problem,
    problem_of: Callable[[Recording], Problem],
    search: Search,
    *,
    seed: int,
    progress: Progress | None,
) -> InitialAngle:
    """Estimate the initial rotor angle of a recording that does not state it.

    A short in one phase looks like a short in another where the twin's rotor stands a third of a
    turn off, and the conducting phases show where it stands only beside a twin that moves as
    recorded. So a quick search is run, the recording is counted from the rotor angle that its
    answer shows, and again, until nothing is left to turn (`Comparison.placed`).
    """
    if not problem.comparisons[0].unplaced:
        return InitialAngle(recording, problem)
    said: tuple[str, ...] = ()
    for _ in range(4):  # at most; one or two are usual
        found = find(problem, search, seed=seed, progress=progress)
        if found.stopped == "interrupted":
            break
        placed = problem.comparisons[0].placed(problem.values(found.point))
        if placed is None:
            break
        if placed.recording is None:
            return InitialAngle(recording, problem, found, said, (placed.said,))
        recording, said = placed.recording, (placed.said,)
        problem = problem_of(recording)
    else:
        unsettled = (
            "Where the rotor stands could not be told from the phases that conduct, so no fault "
            "can be put to a phase: record motor_position."
        )
        return InitialAngle(recording, problem, None, said, (unsettled,))
    return InitialAngle(recording, problem, found, said)


def searched_further(problem: Problem, near: Found, seed: int, tell: Progress | None) -> Found:
    """The result of a search from samples all over, where a descent ended in a local minimum.

    A reference corrects what the twin of a calibrated actuator misses, so that a poor fit is one.
    """
    descended = near.method == LocalDescent.name and near.stopped == "converged"
    poor = problem.relative_misfit(near.cost) > good_fit(problem)
    if not (descended and poor and problem.comparisons[0].has_reference):
        return near
    far = find(problem, Multistart(), seed=seed, progress=tell)
    best = min(near, far, key=lambda one: one.cost)
    return replace(best, evaluations=near.evaluations + far.evaluations)


def compares_sets(model: Model, *asked: Any) -> bool:
    """Whether sets of faults are compared: of kinds that need it, if nothing else is asked for."""
    return model.recordings_differ and not any(asked)


class Prepared(NamedTuple):
    """A recording as it is compared."""

    recording: Recording  # at the rate at which it is compared
    warnings: list[str]  # sentences on doubts about it
    barred: list[str]  # sentences on channels that forbid a verdict


def prepared(recording: Recording, actuator: ParameterSet, load: float | None = None) -> Prepared:
    """A recording that is checked, with the load that is given, at the rate it is compared at.

    `RecordError` if it cannot be identified from, `InputError` if it has a load already, or the
    kind takes none.
    """
    model = model_of(actuator)
    if load is not None:
        if isinstance(load, bool) or not isinstance(load, int | float | np.number):
            raise InputError(f"load must be a number in SI units, received {load!r}.")
        if model.load is None:
            raise InputError(f"The kind {model.kind} takes no load; leave it out.")
        if model.load in recording.channels:
            raise InputError(
                f"{recording.name} holds the load already; leave {load:g} out, or drop the channel."
            )
        recording = recording.changed(**{model.load: np.full(len(recording), float(load))})
    doubts, barred = checked(model, recording, actuator)
    warnings = [*recording.provenance.get("warnings", []), *doubts]
    return Prepared(model.averaged(recording), warnings, barred)


def estimate_of(
    actuator: ParameterSet,
    problem: Problem,
    point: np.ndarray,
    spread: np.ndarray,
    misfit: float,
    recording: Recording,
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
        kind=model_of(actuator).kind,
        fingerprint=actuator.fingerprint,
        labels=recording.labels,
        source=recording.source or str(recording.provenance.get("file", "")),
        when=None if recording.start is None else recording.start.isoformat(),
        statistics=dict(problem.comparisons[0].statistics),
    )
