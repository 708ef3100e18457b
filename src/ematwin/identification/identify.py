"""From a recording to the faults: `identify`."""

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.faults import FAULTS, Faults
from ematwin.identification.multistart import DEFAULT_BUDGET, MultistartDescent
from ematwin.identification.objective import Objective
from ematwin.identification.precision import standard_errors
from ematwin.identification.space import FaultSpace
from ematwin.identification.stretches import Stretches
from ematwin.optimizers.base import Optimizer
from ematwin.optimizers.minimize import ITERATIONS, POPULATION, minimize
from ematwin.plant.parameters import DEFAULT_ACTUATOR, Actuator
from ematwin.readers.plausibility import check_plausible
from ematwin.readers.records import read
from ematwin.signals.record import Record

DEFAULT_ALGORITHM = "multistart"

_POOR_FIT = 0.05  # relative misfit above which the answer is doubted aloud
_VAGUE = 0.05  # standard error of a normalised fault above which it counts as not determined

Progress = Callable[[int, float, int], None]


@dataclass(frozen=True)
class Identification:
    """What a record says about its actuator.

    Attributes
    ----------
    faults : Faults, the vector with which the twin answers as the record does
    standard_error : name to standard error of each searched fault, normalised; see
        `ematwin.identification.precision` for what it does and does not cover
    cost : float, A s, misfit (paper, eq. 2) over the whole record
    relative_misfit : float, root of the cost over that of a twin without current; 0 is perfect
    evaluations : int, simulations that the search took
    seconds : float, wall time of the search
    history : (B, 2) array, evaluations and best cost so far
    algorithm, seed : what searched, and from which seed
    stopped : why it ended
    searched : names of the searched faults; the others were held
    warnings : sentences on what is doubtful
    actuator : Actuator
    provenance : where the record comes from
    """

    faults: Faults
    standard_error: dict[str, float]
    cost: float
    relative_misfit: float
    evaluations: int
    seconds: float
    history: np.ndarray
    algorithm: str
    seed: int
    stopped: str
    searched: tuple[str, ...]
    warnings: list[str]
    actuator: Actuator
    provenance: dict[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as ``ematwin identify --json`` prints them."""
        return {
            "faults": self.faults.as_dict(),
            "standard_error": {
                name: value if math.isfinite(value) else None
                for name, value in self.standard_error.items()
            },
            "physical": {
                row.name: {"value": row.value, "healthy": row.healthy, "unit": row.unit}
                for row in self.faults.physical(self.actuator)
            },
            "cost": self.cost,
            "relative_misfit": self.relative_misfit,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "algorithm": self.algorithm,
            "seed": self.seed,
            "stopped": self.stopped,
            "searched": list(self.searched),
            "warnings": self.warnings,
            "actuator": self.actuator.name,
            "provenance": self.provenance,
        }

    def __str__(self) -> str:
        text = [
            self.faults.describe(self.actuator),
            f"misfit {100.0 * self.relative_misfit:.2f} %, {self.evaluations} simulations in "
            f"{self.seconds:.2f} s with {self.algorithm}; stopped: {self.stopped}",
        ]
        return "\n".join([*text, *(f"Warning: {warning}" for warning in self.warnings)])


def identify(
    record: Record | str | Path,
    actuator: Actuator | str | Path = DEFAULT_ACTUATOR,
    algorithm: str | Optimizer | Any = DEFAULT_ALGORITHM,
    *,
    budget: int | None = None,
    population: int = POPULATION,
    iterations: int = ITERATIONS,
    seed: int = 1,
    only: Iterable[str] | None = None,
    held: Faults | Mapping[str, float] | None = None,
    checkpoint: str | Path | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> Identification:
    """Find the fault magnitudes with which the twin answers as the recorded actuator did.

    Parameters
    ----------
    record : a `Record`, or a file that `ematwin.read` knows
    actuator : an `Actuator`, the name of a shipped one, or a TOML file
    algorithm : "multistart" (the default method), a name of ``ematwin algorithms``, or an
        optimiser; the population methods minimise the misfit over the free components
    budget : simulations at most; for a population method exactly, by default
        ``population * iterations``
    population, iterations : of the population methods; 50 and 200 as in the paper
    seed : int
    only : names of the faults that are searched; None searches all eight
    held : values of the others; healthy if not given
    checkpoint : file of a population method's state; an interrupted run goes on from it
    progress : called with evaluations, best cost and budget now and then
    threads : threads that share a batch; None takes one for each core

    Returns
    -------
    Identification
        Also after an interruption (Ctrl-C), with the best found so far.

    Raises
    ------
    RecordError
        If the record cannot be identified from.
    InputError
        If an argument cannot be used.
    """
    if not isinstance(record, Record):
        record = read(record)
    actuator = Actuator.load(actuator)
    space = FaultSpace(only, Faults.of(held))
    warnings = [*record.provenance.get("warnings", []), *check_plausible(record, actuator)]
    objective = Objective(record, actuator, threads=threads)
    report = _reporter(progress, budget, population * iterations)
    started = time.perf_counter()
    if algorithm == DEFAULT_ALGORITHM:
        if checkpoint is not None:
            raise InputError(
                "The default method takes about a second and keeps no checkpoint; leave it out, "
                "or choose a population method such as de."
            )
        found = _descend(objective, space, budget or DEFAULT_BUDGET, budget, seed, report)
    else:
        result = minimize(
            lambda x: objective(space.full(x)),
            np.zeros(len(space.names)),
            np.ones(len(space.names)),
            algorithm,
            population,
            iterations,
            seed,
            budget=budget,
            checkpoint=checkpoint,
            callback=lambda now: report(now.evaluations, now.cost),
        )
        history = np.column_stack([result.history.evaluations, result.history.cost])
        found = _Found(
            space.full(result.x[None])[0], result.cost, result.evaluations, history,
            result.stopped, result.algorithm, result.seed,
        )  # fmt: skip
    seconds = time.perf_counter() - started
    errors = standard_errors(found.stretches or objective, space, found.k)
    misfit = objective.relative_misfit(found.cost)
    return Identification(
        faults=Faults.of(found.k),
        standard_error=errors,
        cost=found.cost,
        relative_misfit=misfit,
        evaluations=found.evaluations,
        seconds=seconds,
        history=found.history,
        algorithm=found.algorithm,
        seed=found.seed,
        stopped=found.stopped,
        searched=space.names,
        warnings=warnings + _doubts(misfit, errors, found),
        actuator=actuator,
        provenance=record.provenance,
    )


@dataclass(frozen=True)
class _Found:
    k: np.ndarray
    cost: float
    evaluations: int
    history: np.ndarray
    stopped: str
    algorithm: str
    seed: int
    stretches: Stretches | None = None


def _descend(
    objective: Objective,
    space: FaultSpace,
    limit: int,
    budget: int | None,
    seed: int,
    report: Callable[[int, float], None],
) -> _Found:
    if budget is not None and budget < 1:
        raise InputError(f"The budget must be at least 1 evaluation, received {budget}.")
    search = MultistartDescent(objective, space, budget=limit, seed=seed, report=report)
    try:
        state = search.run()
    except KeyboardInterrupt:
        state = search.state
        if not math.isfinite(state.cost):
            raise
    if not math.isfinite(state.cost):
        raise RecordError(
            f"The twin diverged for each of {state.evaluations} fault vectors. Check the "
            "parameters of the actuator and the first position and speed of the record."
        )
    return _Found(
        state.best, state.cost, state.evaluations, np.array(state.history, dtype=float),
        state.stopped, DEFAULT_ALGORITHM, seed, state.stretches,
    )  # fmt: skip


def _reporter(
    progress: Progress | None, budget: int | None, planned: int
) -> Callable[[int, float], None]:
    if progress is None:
        return lambda evaluations, cost: None
    return lambda evaluations, cost: progress(evaluations, cost, budget or planned)


def _doubts(misfit: float, errors: dict[str, float], found: _Found) -> list[str]:
    """Sentences on why the answer may be wrong."""
    doubts = []
    if found.stretches is not None:
        stretch_cost = float(found.stretches(found.k[None])[0])
        doubts.append(
            f"Over the whole record the twin goes another way than the actuator (misfit "
            f"{100.0 * misfit:.1f} %), as happens near stall. The faults are those that explain "
            f"stretches of {1e3 * found.stretches.length:g} ms, each from its recorded positions "
            f"(misfit {100.0 * found.stretches.relative_misfit(stretch_cost):.2f} %)."
        )
    elif misfit > _POOR_FIT:
        doubts.append(
            f"The twin explains this record poorly (misfit {100.0 * misfit:.1f} %): the faults may "
            "be wrong. Check that the actuator's parameters fit this rig, or search longer."
        )
    vague = [name for name in FAULTS if errors.get(name, 0.0) > _VAGUE]
    if found.k[FAULTS.index("eccentricity")] < 0.02 and "eccentricity_phase" in vague:
        vague.remove("eccentricity_phase")  # it has no meaning there
    if vague:
        doubts.append(
            f"This record does not determine {', '.join(vague)}: other values would explain it "
            "nearly as well. Use a command that moves the actuator more."
        )
    return doubts
