"""From one recording to the faults, by the values with which the twin answers as it does."""

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.assess import assess, unassessed
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.findings import (
    caveats_of,
    doubts_of,
    fault_cells,
    obstacles_to,
    remarks_on,
    verdict_on,
)
from ematwin.estimation.initial_angle import estimate_initial_angle
from ematwin.estimation.intervals import Interval
from ematwin.estimation.problem import Problem
from ematwin.estimation.rivals import Rival, hints, objections, qualified, rivals_of
from ematwin.estimation.search import Progress, Search, find, named
from ematwin.estimation.significance import probability
from ematwin.estimation.verdict import Verdict
from ematwin.models.base import Model
from ematwin.models.channels_agree import checked
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.models.unknown import PhysicalValue
from ematwin.optimizers.base import ITERATIONS, POPULATION, Optimizer
from ematwin.recordings.read import assumptions
from ematwin.recordings.recording import Recording
from ematwin.showing import markup
from ematwin.showing.bars import told
from ematwin.showing.drawing import drawn, page_written
from ematwin.showing.frames import frame_of_rows

if TYPE_CHECKING:
    from ematwin.estimation.probabilities import Threshold
    from ematwin.estimation.uncertainty import Method, Uncertainty


@dataclass(frozen=True)
class Identification:
    """What a recording says of its actuator.

    Attributes
    ----------
    verdict : Verdict: healthy, changed, the faults by name, or none with the reason
    estimate : Estimate, the values with their covariance
    faults : values with which the twin answers as the recording does: `Faults` for the brushless
        actuator, else a dict
    cost : float, misfit over the whole recording at the end of the search, before parameters and
        sensors are freed; for the brushless actuator eq. 2 of the paper, A s
    evaluations : int, simulations that the search took
    reference_runs : int, answers of the reference model by which these were corrected; 0 where the
        kind has none
    seconds : float, wall time of the search and of the intervals
    history : (B, 2) array, evaluations and best cost so far
    algorithm, seed : what searched, and from which seed
    stopped : why it ended
    searched : names of the searched unknowns; the others were held
    warnings : sentences on what is doubtful
    assumed : sentences on what was assumed in reading the recording
    actuator : its parameters
    provenance : where the recording comes from
    intervals : by name, low and high end of what holds the true value in 95 %
    physical_values : faults in their physical units: value, low and high end by name
    contrasts : combinations of faults, value and interval by name
    nuisances : load and sensors that are clearly not as recorded, value and interval by name
    others : other answers that explain the recording nearly as well, values by name
    fitted : values of parameters, load and sensors with which the twin answers, by name
    calibrated : whether the twin was fitted to healthy recordings of the actuator
    recording : what was identified from, for figures; None where it was not kept
    uncertainty : what is sure of it, where that was asked for; None after an interruption
    certain : probabilities of faults where sets of faults were compared; None where they follow
        from the estimate
    """

    verdict: Verdict
    estimate: Estimate
    faults: Any
    cost: float
    evaluations: int
    seconds: float
    history: np.ndarray
    algorithm: str
    seed: int
    stopped: str
    searched: tuple[str, ...]
    warnings: list[str]
    assumed: list[str]
    actuator: ParameterSet
    provenance: dict[str, Any] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    physical_values: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    contrasts: dict[str, tuple[float, tuple[float, float]]] = field(default_factory=dict)
    nuisances: dict[str, tuple[float, tuple[float, float]]] = field(default_factory=dict)
    others: tuple[dict[str, float], ...] = ()
    fitted: dict[str, float] = field(default_factory=dict)
    calibrated: bool = False
    recording: Recording | None = field(default=None, repr=False, compare=False)
    uncertainty: "Uncertainty | None" = None
    reference_runs: int = 0
    certain: dict[str, float] | None = None

    @property
    def model(self) -> Model:
        """The kind of its actuator."""
        return model_of(self.actuator)

    @property
    def values(self) -> dict[str, float]:
        """All values by name, searched and held."""
        here = {*self.estimate.held, *self.estimate.names}
        own = [one.name for one in self.model.unknowns(self.actuator) if one.name in here]
        return {name: self.estimate[name] for name in (*own, *sorted(here - set(own)))}

    @property
    def standard_error(self) -> dict[str, float]:
        """Name to standard error of each searched unknown; see `ematwin.estimation.assess`."""
        return self.estimate.standard_errors

    @property
    def probabilities(self) -> dict[str, float]:
        """Name of each searched fault to the probability that it is as large as matters."""
        if self.certain is not None:
            return self.certain
        estimate, errors = self.estimate, self.standard_error
        return {
            one.name: float(
                probability(estimate[one.name] - one.healthy, one.width, errors[one.name])
            )
            for one in self.model.faults(self.actuator)
            if one.name in errors and one.direction_of is None
        }

    @property
    def relative_misfit(self) -> float:
        """Root of the cost over that of a twin that does not answer; 0 is perfect."""
        return self.estimate.misfit

    @property
    def present(self) -> tuple[str, ...]:
        """Names of the faults that the verdict names."""
        return self.verdict.faults

    @property
    def physical(self) -> list[PhysicalValue]:
        """What each value means on the actuator, parameters that were searched included."""
        values, actuator = self.values, self.actuator
        rows = [
            row._replace(value=self.physical_values[row.name][0])
            if row.name in self.physical_values
            else row
            for row in self.model.describe(actuator, values)
        ]
        known = {row.name for row in rows}
        places = [name for name in values if name not in known and "." in name]
        return rows + [
            self.model.unknown(actuator, place).physical_value(actuator, values[place])
            for place in places
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as ``ematwin identify --json`` prints them."""
        return {
            "verdict": self.verdict.as_dict(),
            "intervals": {name: list(ends) for name, ends in self.intervals.items()},
            "calibrated": self.calibrated,
            "faults": self.values,
            "standard_error": {
                name: value if math.isfinite(value) else None
                for name, value in self.standard_error.items()
            },
            "probability": self.probabilities,
            "physical": {
                row.name: {
                    "value": row.value,
                    "healthy": row.healthy,
                    "unit": row.unit,
                    **self._physical_ends(row.name),
                }
                for row in self.physical
            },
            "contrasts": {
                name: {"value": value, "low": low, "high": high}
                for name, (value, (low, high)) in self.contrasts.items()
            },
            "nuisances": {
                name: {"value": value, "low": low, "high": high}
                for name, (value, (low, high)) in self.nuisances.items()
            },
            "other_answers": list(self.others),
            "present": list(self.present),
            "cost": self.cost,
            "relative_misfit": self.relative_misfit,
            "evaluations": self.evaluations,
            "reference_runs": self.reference_runs,
            "seconds": self.seconds,
            "algorithm": self.algorithm,
            "seed": self.seed,
            "stopped": self.stopped,
            "searched": list(self.searched),
            "warnings": self.warnings,
            "assumed": self.assumed,
            "actuator": self.actuator.name,
            "kind": self.estimate.kind,
            "estimate": self.estimate.as_dict(),
            "provenance": self.provenance,
            "uncertainty": None if self.uncertainty is None else self.uncertainty.as_dict(),
        }

    def _physical_ends(self, name: str) -> dict[str, float]:
        if name not in self.physical_values:
            return {}
        _, low, high = self.physical_values[name]
        return {"low": low, "high": high}

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each fault, by name; needs pandas."""
        return frame_of_rows(
            (
                {
                    "fault": row.name,
                    "value": row.value,
                    "low": self._physical_ends(row.name).get("low", math.nan),
                    "high": self._physical_ends(row.name).get("high", math.nan),
                    "healthy": row.healthy,
                    "unit": row.unit,
                    "k": row.normalised,
                    "k_low": self.intervals.get(row.name, (math.nan,) * 2)[0],
                    "k_high": self.intervals.get(row.name, (math.nan,) * 2)[1],
                    "present": row.name in self.present,
                    "meaning": row.meaning,
                }
                for row in self.physical
            ),
            "fault",
        )

    to_dataframe = to_frame

    def plot(self, kind: str = "faults") -> Any:
        """A figure of plotly: "faults" (deviations from healthy), "fit" or "convergence"."""
        return drawn(
            self,
            kind,
            {"faults": "plot_faults", "fit": "plot_fit", "convergence": "plot_convergence"},
        )

    def report(self, path: str | Path) -> None:
        """Write its page (.html), which holds all that it shows."""
        page_written(self, path, "identification:identification_page")

    def _repr_html_(self) -> str:
        """The verdict, then the faults, in a notebook."""
        rows = [
            (row.name, row.value, row.interval, row.healthy, row.meaning)
            for row in fault_cells(self)
        ]
        marked = [n for n, row in enumerate(self.physical) if row.name in self.present]
        return "".join(
            [
                markup.verdict(self.verdict.sentence, self.verdict.grade),
                markup.table(("fault", "value", "95 %", "healthy", "meaning"), rows, marked),
                markup.note(
                    f"{self.actuator.name}, misfit {100.0 * self.relative_misfit:.2f} %, "
                    f"{self.evaluations} simulations in {self.seconds:.2f} s with {self.algorithm}"
                ),
                *(markup.note(f"Assumed: {sentence}") for sentence in self.assumed),
                *(markup.note(f"Warning: {warning}") for warning in self.warnings),
            ]
        )

    def __str__(self) -> str:
        lines = [self.verdict.sentence, ""]
        lines += [
            f"{row.name:<19} {row.value:>14}  {row.interval:>20}  {row.meaning}"
            + ("  <" if row.name in self.present else "")
            for row in fault_cells(self)
        ]
        lines.append(
            f"misfit {100.0 * self.relative_misfit:.2f} %, {self.evaluations} simulations in "
            f"{self.seconds:.2f} s with {self.algorithm}; stopped: {self.stopped}"
        )
        lines += [f"Assumed: {sentence}" for sentence in self.assumed]
        lines += [f"Warning: {warning}" for warning in self.warnings]
        if self.uncertainty is not None:
            lines += ["", str(self.uncertainty)]
        return "\n".join(lines)


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
    backend: str = "cpu",
    uncertainty: "str | Method | None" = None,
    thresholds: Mapping[str, float | str] | None = None,
) -> Identification:
    """The values with which the twin answers as a prepared recording.

    Other parameters are those of `ematwin.identify`.
    """
    model, recording = model_of(actuator), ready.recording
    if compares_sets(model, algorithm, budget, uncertainty, thresholds):
        from ematwin.estimation.fault_sets import identified_by_sets

        return identified_by_sets([ready], actuator, baseline, only=only, held=held)
    warnings = list(ready.warnings)
    if thresholds and uncertainty is None:
        uncertainty = "laplace"
    method = None
    if uncertainty is not None:  # imported where it is asked for: most identifications are not
        from ematwin.estimation.uncertainty import named as way_of

        method = way_of(uncertainty)

    def problem_of(one: Recording) -> Problem:
        made = Problem.of(one, actuator, only=only, held=held, threads=threads, backend=backend)
        return made.searched()

    problem = problem_of(recording)
    limits: dict[str, Threshold] = {}
    if thresholds:
        from ematwin.estimation.probabilities import thresholds_of

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
            found = find(problem, search, budget=budget, seed=seed, progress=tell)
        try:
            if found.stopped == "interrupted":
                raise KeyboardInterrupt
            assessed = assess(model, actuator, problem, found, baseline, threads)
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
    verdict = verdict_on(model, actuator, problem, estimate, assessed, baseline, obstacles)
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
            verdict = verdict_on(model, actuator, problem, estimate, assessed, baseline, objected)
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
    )


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
    warnings : sentences on what is doubtful about it
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
