"""From a recording to the faults: `identify`."""

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.estimation.covariance import covariance
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Search, named
from ematwin.estimation.significance import present
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.reading import read
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.unknown import PhysicalValue, table_of
from ematwin.optimizers.base import Optimizer
from ematwin.optimizers.minimize import ITERATIONS, POPULATION
from ematwin.recordings.read import assumptions
from ematwin.recordings.recording import Recording

_POOR_FIT = 0.05  # relative misfit above which the answer is doubted aloud
_ABOVE_NOISE = 2.0  # times the misfit that noise alone leaves: poor as well
_HOPELESS = 1.0  # relative misfit of a twin that does not answer at all
_VAGUE = 0.05  # standard error, as a share of the range, above which a fault is not determined

Progress = Callable[[int, float, int], None]


@dataclass(frozen=True)
class Identification:
    """What a recording says of its actuator.

    Attributes
    ----------
    estimate : Estimate, the values with their covariance
    faults : values with which the twin answers as the recording does: `Faults` for the brushless
        actuator, else a dict
    cost : float, misfit over the whole recording; for the brushless actuator eq. 2 of the paper,
        A s
    evaluations : int, simulations that the search took
    seconds : float, wall time of the search
    history : (B, 2) array, evaluations and best cost so far
    algorithm, seed : what searched, and from which seed
    stopped : why it ended
    searched : names of the searched unknowns; the others were held
    warnings : sentences on what is doubtful
    assumed : sentences on what was assumed in reading the recording
    actuator : its parameters
    provenance : where the recording comes from
    """

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
        """Name to standard error of each searched unknown; see `ematwin.estimation.covariance`."""
        return self.estimate.standard_errors

    @property
    def relative_misfit(self) -> float:
        """Root of the cost over that of a twin that does not answer; 0 is perfect."""
        return self.estimate.misfit

    @property
    def present(self) -> tuple[str, ...]:
        """Names of the faults that are present (`ematwin.estimation.significance`)."""
        return present(self.estimate)

    @property
    def physical(self) -> list[PhysicalValue]:
        """What each value means on the actuator, parameters that were searched included."""
        values, actuator = self.values, self.actuator
        rows = self.model.describe(actuator, values)
        known = {row.name for row in rows}
        places = [name for name in values if name not in known and "." in name]
        return rows + [
            self.model.unknown(actuator, place).physical_value(actuator, values[place])
            for place in places
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as ``ematwin identify --json`` prints them."""
        return {
            "faults": self.values,
            "standard_error": {
                name: value if math.isfinite(value) else None
                for name, value in self.standard_error.items()
            },
            "physical": {
                row.name: {"value": row.value, "healthy": row.healthy, "unit": row.unit}
                for row in self.physical
            },
            "present": list(self.present),
            "cost": self.cost,
            "relative_misfit": self.relative_misfit,
            "evaluations": self.evaluations,
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
        }

    def __str__(self) -> str:
        lines = [table_of(self.physical, self.present)]
        lines.append(
            f"misfit {100.0 * self.relative_misfit:.2f} %, {self.evaluations} simulations in "
            f"{self.seconds:.2f} s with {self.algorithm}; stopped: {self.stopped}"
        )
        lines += [f"Assumed: {sentence}" for sentence in self.assumed]
        lines += [f"Warning: {warning}" for warning in self.warnings]
        return "\n".join(lines)


def identify(
    record: Recording | str | Path,
    actuator: Any = None,
    algorithm: str | Search | Optimizer | Any | None = None,
    *,
    budget: int | None = None,
    population: int = POPULATION,
    iterations: int = ITERATIONS,
    seed: int = 1,
    only: Iterable[str] | None = None,
    held: Mapping[str, float] | Any | None = None,
    checkpoint: str | Path | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> Identification:
    """Find the values with which the twin answers as the recorded actuator did.

    Parameters
    ----------
    record : a `Recording`, or a file that `ematwin.read` knows
    actuator : parameters of any kind, a calibration, the name of a shipped set, or a TOML file;
        the default brushless actuator if not given
    algorithm : a name of ``ematwin algorithms``, a `Search`, or an optimiser; the default method
        of the kind if not given
    budget : simulations at most; for a population method exactly, by default
        ``population * iterations``
    population, iterations : of the population methods; 50 and 200 as in the paper
    seed : int
    only : names of the unknowns that are searched: faults, nuisances, or parameters of the actuator
        by their place, such as ``motor.emf_constant``. None searches all faults and nuisances
    held : values of the others; healthy if not given
    checkpoint : file of a population method's state; an interrupted run goes on from it
    progress : called with evaluations, best cost and budget now and then
    threads : threads that share a batch; None takes one for each core

    Returns
    -------
    Identification, also after an interruption (Ctrl-C), with the best found so far

    Raises
    ------
    RecordError
        If the recording cannot be identified from.
    InputError
        If an argument cannot be used.
    """
    chosen = load_actuator(actuator)
    model = model_of(chosen)
    recording = record if isinstance(record, Recording) else read(record, actuator=chosen)
    warnings = [*recording.provenance.get("warnings", []), *model.check(recording, chosen)]
    problem = Problem.of(recording, chosen, only=only, held=held, threads=threads)
    search: Search = named(
        model.default_search if algorithm is None else algorithm,
        population=population, iterations=iterations, checkpoint=checkpoint,
    )  # fmt: skip
    started = time.perf_counter()
    found = find(problem, search, budget=budget, seed=seed, progress=progress)
    seconds = time.perf_counter() - started
    judged = found.problem or problem
    spread = covariance(judged, found.point, model.model_error)
    misfit = problem.relative_misfit(found.cost)
    estimate = estimate_of(
        model, chosen, problem, found.point, spread, misfit, recording,
        dict(problem.comparisons[0].statistics),
    )  # fmt: skip
    warnings += _doubts(estimate, found, problem)
    return Identification(
        estimate=estimate,
        faults=model.as_faults(problem.values(found.point)),
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
        actuator=chosen,
        provenance=recording.provenance,
    )


def find(
    problem: Problem,
    search: Search,
    *,
    budget: int | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> Found:
    """Run a search on a problem: the one way, for `identify` and for studies alike.

    ``progress`` is called with evaluations, best cost and budget after each batch; it may raise to
    end the search.
    """
    total = search.planned if budget is None else budget
    with noting_interrupts() as interrupts:

        def report(evaluations: int, cost: float) -> None:
            interrupts.check()
            if progress is not None:
                progress(evaluations, cost, total)

        found = search.run(problem, budget=budget, seed=seed, report=report)
        interrupts.pressed = False
    return found


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


def _doubts(estimate: Estimate, found: Found, problem: Problem) -> list[str]:
    """Sentences on why the answer may be wrong."""
    doubts = []
    misfit = estimate.misfit
    if found.problem is not None:
        stretch_cost = float(found.problem.costs(found.point[None])[0])
        length = found.problem.comparisons[0].length or math.nan
        doubts.append(
            f"Over the whole record the twin departs from the actuator (misfit "
            f"{100.0 * misfit:.1f} %), as happens near stall. The faults are those that best "
            f"explain stretches of {1e3 * length:g} ms, each from its recorded positions "
            f"(misfit {100.0 * found.problem.relative_misfit(stretch_cost):.2f} %)."
        )
    elif misfit > _HOPELESS:
        doubts.append(
            f"The twin does not explain this record at all (misfit {100.0 * misfit:.0f} %, worse "
            "than no twin at all): these values mean nothing. Check the channels and "
            "their units, and that the actuator's parameters are those of this rig."
        )
    elif misfit > max(_POOR_FIT, _ABOVE_NOISE * problem.expected_misfit):
        doubts.append(
            f"The twin explains this record poorly (misfit {100.0 * misfit:.1f} %): the faults may "
            "be wrong. Check that the actuator's parameters fit this rig, or search longer."
        )
    vague = [
        name
        for name, error in estimate.standard_errors.items()
        if error > _VAGUE * estimate.ranges[name]
    ]
    for name, magnitude in estimate.directions.items():
        if name in vague and magnitude in estimate.names and estimate[magnitude] < 0.02:
            vague.remove(name)  # it has no meaning there
    if vague:
        doubts.append(
            f"This record does not determine {', '.join(vague)}: other values would explain it "
            "nearly as well. Use a command that moves the actuator more."
        )
    return doubts
