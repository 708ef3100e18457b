"""The test command that tells two explanations of a recording apart: `discriminate`.

A recording may leave two explanations that fit alike, such as turns missing from all phases and
warm magnets. T-optimality (Atkinson and Fedorov 1975, Biometrika 62, 57-70) asks for the command
under which the answer of the one is furthest from the best fit of the other:

    T = min_theta [ |r_1 - r_2(theta)|^2 + priors ] / (f sigma)^2,   distance = sqrt(T)

theta : unknowns that only the second explanation names, and uncertain load, sensors and
parameters; r : weighted residuals of the model's answers; sigma : the noise of an independent
residual; f : `Model.model_error`, for impacts make fits rough. Each is fitted to the
other, and the smaller distance counts. It is in standard deviations: below `constants.SIGMAS` the
two cannot be told apart.
"""

import time
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.baseline import with_all_free
from ematwin.estimation.constants import SIGMAS
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.experiments.candidates import Progress, ranked
from ematwin.experiments.experiment import UNANSWERED, Experiment
from ematwin.models.comparison import Comparison, one_candidate
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording
from ematwin.showing.results import plain

_NEAR, _WHOLE = 4, 16  # iterations of a fit: they start near; of one that is followed to its end

Explanation = Mapping[str, float]
"""Values by name: faults, load and sensors, parameters by place; what is not named is healthy."""


@dataclass(frozen=True)
class Discrimination:
    """The command under which two explanations differ most."""

    scenario: Scenario  #: the command
    distance: float  #: standard deviations between the explanations with it
    default: Scenario  #: the given command in the same duration
    default_distance: float  #: the distance with that
    first: dict[str, float]  #: an explanation
    second: dict[str, float]  #: the other one
    actuator: ParameterSet
    limits: dict[str, float]  #: of motions of a healthy actuator, by name, SI
    demands: dict[str, float]  #: of this one
    evaluations: int  #: commands that were compared
    seconds: float
    stopped: str  #: complete, budget, time or interrupted
    seed: int

    @property
    def told(self) -> bool:
        """Whether the command tells them apart."""
        return self.distance >= SIGMAS

    @property
    def sentence(self) -> str:
        """The distances in words."""
        first, second = _in_words(self.first), _in_words(self.second)
        if self.told:
            return (
                f"With this command {first} and {second} lie {self.distance:.2g} standard "
                f"deviations apart; with {self.default.name} they lie {self.default_distance:.2g}."
            )
        return (
            f"No command within the limits tells {first} from {second}: they lie "
            f"{self.distance:.2g} standard deviations apart at best, where {SIGMAS:g} are needed. "
            "Record further channels, or measure one of the two otherwise."
        )

    def save(self, path: str | Path) -> None:
        """Write the command as a scenario file (TOML), whole or not at all."""
        self.scenario.save(path)

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return plain({
            **vars(self), "actuator": self.actuator.name, "default": self.default.name,
            "sentence": self.sentence, "told": self.told,
        })  # fmt: skip


def discriminate(
    first: Explanation,
    second: Explanation,
    actuator: ParameterSet | str | Path | Any | None = None,
    *,
    scenario: Scenario | str | Path | None = None,
    duration: float | None = None,
    noise: Noise | None = None,
    exact: bool = False,
    sample_rate: float | None = None,
    budget: int | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: Progress | None = None,
    **limits: float,
) -> Discrimination:
    """The command under which two explanations of a recording differ most.

    Parameters
    ----------
    first, second : values by name. What only one of the two names is fitted to the other; what
        both name stays as it is
    actuator, scenario, duration, noise, exact, sample_rate : as in `ematwin.design`
    budget, seed, threads, progress, limits : as in `ematwin.design`

    Returns
    -------
    Discrimination, also after Ctrl-C: the best found so far, ``stopped == "interrupted"``

    Raises
    ------
    InputError
        If an argument cannot be used, the explanations are one, or no command keeps the limits.
    """
    started = time.perf_counter()
    experiment = Experiment.of(
        actuator, exact=exact, noise=noise, sample_rate=sample_rate, seed=seed, threads=threads
    )
    given = experiment.started(scenario, duration)
    limits = experiment.limits(limits)
    pair = Pair(experiment, first, second)
    before = experiment.record(given, fast=True)
    within = experiment.model.demanded(before) | limits
    ranking = ranked(
        experiment, given, within, lambda _, healthy, __: -pair.distance(healthy, _NEAR),
        budget=budget, seed=seed,
        progress=lambda n, cost, total: progress and progress(n, -cost, total),
    )  # fmt: skip
    # these fits stop early: the given command and the best few are fitted to the end
    found = []
    for command in [given, *ranking.commands[:3]]:
        with suppress(*UNANSWERED):
            healthy = experiment.move(command, within)
            demands = experiment.model.demanded(healthy)
            found.append((pair.distance(healthy, _WHOLE), command, demands))
    if not found:
        raise ranking.refusal(experiment.actuator.name, limits)
    distance, best, demands = max(found, key=lambda one: one[0])
    return Discrimination(
        best, distance, given, pair.distance(before, _WHOLE), pair.values[0], pair.values[1],
        experiment.actuator, limits=within, demands=demands, evaluations=ranking.evaluations,
        seconds=time.perf_counter() - started, stopped=ranking.stopped, seed=seed,
    )  # fmt: skip


class Pair:
    """Two explanations, and the distance between them under a command."""

    def __init__(self, experiment: Experiment, first: Explanation, second: Explanation) -> None:
        self.experiment = experiment
        model, actuator = experiment.model, experiment.actuator
        self._named = {name: model.unknown(actuator, name) for name in (*first, *second)}
        self.values = tuple(
            {name: self._named[name].check(x) for name, x in one.items()} for one in (first, second)
        )
        healthy = {name: one.healthy for name, one in self._named.items()}
        # with what only the other names at its healthy value
        self._whole = tuple({**healthy, **values} for values in self.values)
        a, b = self._whole
        if all(abs(a[n] - b[n]) <= 1e-12 * one.width for n, one in self._named.items()):
            raise InputError(
                "The two explanations are one and the same; give values in which they differ."
            )

    def distance(self, recording: Recording, iterations: int = _NEAR) -> float:
        """Standard deviations between the two, each fitted to the other; the smaller counts.

        The recording of a healthy actuator weighs the residuals.
        """
        mine = self.experiment
        comparison = mine.model.compare(recording, mine.actuator, threads=mine.threads)
        (first, second), (a, b) = self.values, self._whole
        return min(
            self._distance(comparison, a, b, second.keys() - first.keys(), iterations),
            self._distance(comparison, b, a, first.keys() - second.keys(), iterations),
        )

    def _distance(
        self, comparison: Comparison, truth: Explanation, other: Explanation, own: Collection[str],
        iterations: int,
    ) -> float:  # fmt: skip
        """Standard deviations from ``truth`` to the best fit of ``other``, with ``own`` free."""
        model, actuator = self.experiment.model, self.experiment.actuator
        named = [replace(self._named[name], spread=None) for name in sorted(own)]
        held = {name: x for name, x in other.items() if name not in own}
        problem = with_all_free(
            model, actuator, Problem([comparison], named, held=held), self.experiment.baseline
        ).with_comparisons([comparison])
        start = [other.get(one.name, one.healthy) for one in problem.unknowns]

        def residuals_of(values: Explanation) -> np.ndarray:
            return np.asarray(comparison.residuals(one_candidate(values), 1)[0])

        aim = residuals_of({**dict(zip(problem.names, start, strict=True)), **truth})
        here = residuals_of(model.healthy(actuator))
        noise = max(comparison.noise, float(np.sqrt(here @ here / comparison.independent)))
        noise *= comparison.model_error
        if not problem.unknowns:
            return float(np.linalg.norm(aim - residuals_of(other))) / noise
        problem = problem.with_noise(noise)
        chart = problem.chart

        def residuals(z: np.ndarray) -> np.ndarray:
            found = problem.residuals(chart.to_values(z))
            found[:, : len(aim)] -= aim
            return found

        first = chart.from_values(np.array([start]))
        fit = LevenbergMarquardt.start(first, residuals)
        for _ in range(iterations):
            fit.iterate(residuals, chart.lower, chart.upper, chart.project)
        return float(np.sqrt(fit.best(1).costs[0])) / noise


def _in_words(values: Explanation) -> str:
    return ", ".join(f"{name} {x:.3g}" for name, x in values.items()) or "healthy"
