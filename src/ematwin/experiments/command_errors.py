"""Errors of a command over faults that are still unknown: expected ones, and errors of `identify`.

A command that is to be chosen has to be good for faults that are still unknown: squared errors are
averaged over vectors drawn from the prior of the faults (Chaloner and Verdinelli 1995, Statistical
Science 10, 273-304: "on-average" designs).
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.assess import assess
from ematwin.estimation.constants import ANYTHING, SMALLEST
from ematwin.estimation.interrupt import until_interrupted
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import find, named
from ematwin.experiments.experiment import UNANSWERED, Experiment
from ematwin.experiments.identifiability import Identifiability
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import cores, side_by_side
from ematwin.numerics.sobol import Sobol
from ematwin.showing.results import plain

SEVEREST = 0.5  # share of the way from healthy to a bound: a test is for faults that begin

Faults = Mapping[str, float]


@dataclass(frozen=True)
class CommandErrors:
    """Errors of a command."""

    scenario: Scenario
    # expected standard error of each magnitude, by name; infinite where ``obstacle`` says why
    # nothing is known
    errors: dict[str, float]
    ranges: dict[str, float]  # of the magnitudes, by name
    demands: dict[str, float]  # its demands on a healthy actuator, by name, SI
    # the most that it demanded of one with faults
    faulty: dict[str, float] = field(default_factory=dict)
    obstacle: str = ""  # why no verdict would be given on such a recording, or ""
    # at faults that are only just ones; None where it was not asked for
    told: Identifiability | None = None
    # root mean square of the errors that `identify` made on ``checks`` simulated recordings, by
    # name; empty if none were made
    observed: dict[str, float] = field(default_factory=dict)
    checks: int = 0  # how many

    @property
    def shares(self) -> dict[str, float]:
        """Expected errors over the ranges of the faults, by name."""
        return {name: error / self.ranges[name] for name, error in self.errors.items()}

    @property
    def weakest(self) -> str:
        """The fault whose expected error is the largest share of its range."""
        return max(self.shares, key=lambda name: self.shares[name])

    def worst(self, fault: str | None, *, observed: bool = False) -> float:
        """The error of a fault, or the largest, as a share of the range; expected or observed."""
        errors = self.observed if observed else self.errors
        return max(x / self.ranges[n] for n, x in errors.items() if fault in (None, n))

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; infinite ones are null."""
        return plain({
            "scenario": self.scenario,
            "errors": self.errors,
            "weakest": self.weakest,
            "demands": self.demands,
            "demands_with_faults": self.faulty,
            "identifiability": None if self.told is None else self.told.as_dict(),
            "observed": self.observed or None,
            "checks": self.checks,
        })  # fmt: skip


def observed(commands: Sequence[CommandErrors], errors: np.ndarray) -> list[CommandErrors]:
    """C commands with their `identified_errors` (N, C, n) on the actuators that none refuses.

    As they are if there are no such actuators.
    """
    sound = errors[np.isfinite(errors).all(axis=(1, 2))]
    if not len(sound):
        return list(commands)
    rms = np.sqrt((sound**2).mean(axis=0)).tolist()
    return [
        replace(one, observed=dict(zip(one.errors, own, strict=True)), checks=len(sound))
        for one, own in zip(commands, rms, strict=True)
    ]


def fault_vectors(
    experiment: Experiment, count: int, rng: np.random.Generator, given: Faults, *, even: bool
) -> list[dict[str, float]]:
    """Fault vectors from the prior of the faults; ``given`` are held.

    Magnitudes lie between `SMALLEST` of their range and `SEVEREST` of the way to a bound, to either
    side where healthy lies inside; directions anywhere. ``even`` covers the prior evenly (Sobol).
    """
    faults = experiment.model.faults(experiment.actuator)
    shares = Sobol(len(faults), rng).random(count) if even else rng.random((count, len(faults)))
    found = []
    for row in shares.tolist():
        values = {one.name: _value(one, u) for one, u in zip(faults, row, strict=True)}
        found.append(experiment.model.values_of(experiment.actuator, {**values, **given}))
    return found


def _value(one: Unknown, share: float) -> float:
    if one.direction_of is not None:
        return one.lower + share * one.width
    up, down = one.upper - one.healthy, one.healthy - one.lower
    if min(up, down) > 2.0 * SMALLEST * one.width:
        sign, share = (1.0, 2.0 * share) if share < 0.5 else (-1.0, 2.0 * share - 1.0)
    else:
        sign = 1.0 if up >= down else -1.0
    reach = SEVEREST * (up if sign > 0.0 else down)
    least = min(SMALLEST * one.width, reach)
    return one.healthy + sign * (least + share * (reach - least))


def expected_errors(
    experiment: Experiment,
    scenario: Scenario,
    vectors: Sequence[Faults],
    demands: Mapping[str, float],
    *,
    fast: bool = False,
    fault: str | None = None,
    enough: float = math.inf,
) -> CommandErrors:
    """Expected errors of a command; raises `UNANSWERED` where it would get no verdict.

    Parameters
    ----------
    vectors : of the faults; slopes are taken at each
    demands : of the command on a healthy actuator, by name, SI
    fast : simulate with the fast model alone, for the many commands of a search
    fault, enough : the error of that fault, or the largest, as a share of the range, above which
        the command is worse than another: further vectors only add to it
    """
    ranges, threads = experiment.ranges, experiment.threads or cores()
    alone = replace(experiment, threads=1)  # the vectors share the cores

    def at(faults: Faults) -> tuple[np.ndarray, dict[str, float]]:
        recording = alone.record(scenario, faults, fast=fast)
        errors = alone.expected(recording, faults, fast=fast).errors
        squares = np.array([errors[name] for name in ranges]) ** 2
        squares = np.where(np.isfinite(squares), squares, np.inf)
        return squares, alone.model.demanded(recording)

    total, faulty = np.zeros(len(ranges)), dict(demands)
    for first in range(0, len(vectors), threads):
        for squares, more in side_by_side(at, vectors[first : first + threads], threads):
            total += squares
            faulty = {name: max(x, more[name]) for name, x in faulty.items()}
        errors = dict(zip(ranges, np.sqrt(total / len(vectors)).tolist(), strict=True))
        found = CommandErrors(scenario, errors, ranges, dict(demands), faulty)
        if found.worst(fault) > enough:
            break
    return found


def judged(
    experiment: Experiment, command: Scenario, limits: Mapping[str, float],
    vectors: Sequence[Faults],
) -> CommandErrors:  # fmt: skip
    """Expected errors of a command by the reference; infinite ones if it would get no verdict."""
    demands: dict[str, float] = {}
    try:
        demands = experiment.model.demanded(experiment.move(command, limits, fast=False))
        return expected_errors(experiment, command, vectors, demands)
    except UNANSWERED as error:
        ranges, demands = experiment.ranges, getattr(error, "demands", demands)
        unknown = dict.fromkeys(ranges, math.inf)
        return CommandErrors(command, unknown, ranges, demands, obstacle=str(error))


def shown_by(
    experiment: Experiment, scenario: Scenario, vectors: Sequence[Faults], fault: str | None
) -> list[Faults]:
    """Fault vectors at which a command determines the same faults as at the others.

    Where friction has become so large that nothing moves, no error is known of any command that
    is as strong; one such vector would outweigh all others in a mean. All are kept where none is
    left: then it is the command that shows nothing.
    """
    alone = replace(experiment, threads=1)
    asked = {name: x for name, x in experiment.ranges.items() if fault in (None, name)}

    def hidden(faults: Faults) -> set[str]:
        try:
            recording = alone.record(scenario, faults, fast=True)
            errors = alone.expected(recording, faults, fast=True).sharp_errors
        except UNANSWERED:
            return set(asked)
        return {name for name, width in asked.items() if not errors[name] <= ANYTHING * width}

    found = side_by_side(hidden, vectors, experiment.threads or cores())
    never = set.intersection(*found)
    return [one for one, names in zip(vectors, found, strict=True) if names <= never] or [*vectors]


def identified_errors(
    experiment: Experiment,
    scenarios: Sequence[Scenario],
    recordings: int,
    *,
    seed: int = 2,
    step: float | None = None,
    seconds: float = math.inf,
    progress: Callable[[float], object] | None = None,
) -> np.ndarray:
    """Errors that `identify` makes on simulated recordings of the reference model.

    Parameters
    ----------
    scenarios : the commands, (C,); each actuator answers all of them
    recordings : N of each, every one of another actuator
    seed : of faults, parameters and noise
    step : s, of the model that is recorded; None takes the actuator's
    seconds : after which no further recording is begun
    progress : called with the share done

    Returns
    -------
    (N, C, n) array of the n magnitudes, infinite where a recording is refused, as one in which
    nothing moves, or was not begun in time; after Ctrl-C of fewer actuators
    """
    model, rng = experiment.model, np.random.default_rng(seed)
    vectors = fault_vectors(experiment, recordings, rng, {}, even=False)
    actuators = [experiment.drawn_actuator(rng) for _ in vectors]
    settings: dict[str, Any] = {} if step is None else {"step": step}
    search, magnitudes = named(model.default_search), experiment.magnitudes

    def error_of(n: int, scenario: Scenario) -> list[float]:
        record = model.simulate(
            actuators[n], scenario, vectors[n], fidelity=model.fidelities[0],
            noise=experiment.noise, seed=seed * 10_000 + n, sample_rate=experiment.sample_rate,
            **settings,
        )  # fmt: skip
        # as `identify` does, but for its verdict
        try:
            problem = Problem.of(record, experiment.actuator, threads=1)
        except RecordError:
            return [math.inf] * len(magnitudes)
        found = find(problem, search)
        values = assess(model, experiment.actuator, problem, found, experiment.baseline).values
        return [values[one.name] - vectors[n][one.name] for one in magnitudes]

    ends, threads = time.perf_counter() + seconds, experiment.threads or cores()
    errors: list[list[float]] = []  # of all commands of an actuator, then of the next
    done, together = 0, max(1, threads // len(scenarios))
    with until_interrupted() as interrupts:
        while done < recordings and time.perf_counter() <= ends:
            some = range(recordings)[done : done + together]
            pairs = [(n, scenario) for n in some for scenario in scenarios]
            errors += side_by_side(lambda pair: error_of(*pair), pairs, threads)
            done += len(some)
            interrupts.check()
            if progress is not None:
                progress(done / recordings)
    if interrupts.ended:
        recordings = done
    found = np.full((recordings, len(scenarios), len(magnitudes)), math.inf)
    found[:done] = np.reshape(errors, (-1, *found.shape[1:]))
    return found
