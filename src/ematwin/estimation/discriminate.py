"""The command that tells two explanations apart: `discriminate`.

A recording may leave two explanations that fit alike, such as turns missing from all phases and
warm magnets. T-optimality (Atkinson and Fedorov 1975, Biometrika 62, 57-70) asks for the command
under which the answer of the one is furthest from the best fit of the other:

    T = min_theta [ |r_1 - r_2(theta)|^2 + priors ] / (f sigma)^2,   distance = sqrt(T)

theta : what only the second explanation names, and load, sensors and parameters as far as they are
uncertain; r : weighted residuals of the twin's answers; sigma : the noise of an independent
residual; f : `Model.model_error`, for fits end in the roughness of impacts. Each is fitted to the
other, and the smaller distance counts. It is in standard deviations: below `significance.SIGMAS`
the two cannot be told apart.
"""

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import DivergedError, InputError, ParameterError, RecordError
from ematwin.estimation.baseline import (
    Baseline,
    baseline_of,
    effective,
    with_nuisances,
)
from ematwin.estimation.command_search import (
    BEYOND,
    CommandSearch,
    Looked,
    Progress,
    begun,
    excess,
    limits_of,
)
from ematwin.estimation.constants import SIGMAS
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.designed import DesignSpace
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

BUDGET = 200
_ITERATIONS = 4  # of the fit of an explanation to the other: they start near
_WHOLE = 16  # of a fit that is followed to its end
_FINALISTS = 3
_DIFFERENT = 1e-12  # share of a range

Explanation = Mapping[str, float]
"""Values by name: faults, load and sensors, parameters by place; what is not named is healthy."""


@dataclass(frozen=True)
class Discrimination:
    """The command that tells two explanations apart best.

    Attributes
    ----------
    scenario : Scenario
    distance, default_distance : standard deviations between the explanations, with this command and
        with the given one in the same duration
    default : the given command
    first, second : the explanations
    actuator : ParameterSet
    limits, demands : what a motion may demand of a healthy actuator, and what this one does
    evaluations, seconds, stopped, seed : of the search
    """

    scenario: Scenario
    distance: float
    default: Scenario
    default_distance: float
    first: dict[str, float]
    second: dict[str, float]
    actuator: ParameterSet
    limits: dict[str, float]
    demands: dict[str, float]
    evaluations: int
    seconds: float
    stopped: str
    seed: int

    @property
    def told(self) -> bool:
        """Whether the command tells them apart."""
        return self.distance >= SIGMAS

    @property
    def sentence(self) -> str:
        """What the command can do, in words."""
        first, second = _named(self.first), _named(self.second)
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
        return {
            "actuator": self.actuator.name,
            "sentence": self.sentence,
            "told": self.told,
            "distance": self.distance,
            "default_distance": self.default_distance,
            "first": self.first,
            "second": self.second,
            "scenario": self.scenario.model_dump(mode="json", exclude_none=True),
            "limits": self.limits,
            "demands": self.demands,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "stopped": self.stopped,
            "seed": self.seed,
        }


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
    budget: int = BUDGET,
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
    chosen = load_actuator(actuator)
    model = model_of(chosen)
    given = begun(model, scenario, duration)
    baseline = Baseline.of_simulation() if exact else baseline_of(actuator, chosen)
    pair = _Pair(model, chosen, baseline, first, second, noise, sample_rate, seed, threads)
    record = pair.record(given)
    default = pair.distance(record, _WHOLE)
    within = limits_of(model, model.demanded(record), limits)

    def look(command: Scenario, limit: float) -> Looked:
        return pair.look(command, within)

    search = CommandSearch(DesignSpace(model, given, within), within, look)
    search.run(budget, seed, lambda n, cost, total: progress and progress(n, -cost, total))
    # fits of a search stop early: the best few are fitted to the end, beside the given command
    whole = {}
    for one in [*search.best(_FINALISTS), given]:
        if math.isfinite(pair.look(one, within).cost):
            record = pair.record(one)
            distance = pair.distance(record, _WHOLE)
            whole[distance] = (one, model.demanded(record))
    if not whole:
        raise search.refusal(chosen.name, limits)
    distance = max(whole)
    command, demands = whole[distance]
    return Discrimination(
        scenario=command,
        distance=distance,
        default=given,
        default_distance=default,
        first=pair.values[0],
        second=pair.values[1],
        actuator=chosen,
        limits=within,
        demands=demands,
        evaluations=search.evaluations,
        seconds=time.perf_counter() - started,
        stopped=search.stopped,
        seed=seed,
    )


class _Pair:
    """Two explanations, and how far apart they lie on a recording's command."""

    def __init__(
        self,
        model: Model,
        actuator: ParameterSet,
        baseline: Baseline,
        first: Explanation,
        second: Explanation,
        noise: Noise | None,
        sample_rate: float | None,
        seed: int,
        threads: int | None,
    ) -> None:
        self.model, self.actuator, self.baseline = model, actuator, baseline
        self._noise, self._rate, self._seed, self._threads = noise, sample_rate, seed, threads
        self.values = tuple(
            {name: model.unknown(actuator, name).check(x) for name, x in one.items()}
            for one in (first, second)
        )
        self._known = {name: model.unknown(actuator, name) for one in self.values for name in one}
        a, b = self._whole()
        if all(abs(a[n] - b[n]) <= _DIFFERENT * one.width for n, one in self._known.items()):
            raise InputError(
                "The two explanations are one and the same; give values in which they differ."
            )

    def _whole(self) -> tuple[dict[str, float], dict[str, float]]:
        """Both explanations with what only the other names at its healthy value."""
        healthy = {name: one.healthy for name, one in self._known.items()}
        a, b = ({**healthy, **values} for values in self.values)
        return a, b

    def record(self, scenario: Scenario) -> Recording:
        """What a healthy actuator answers, which weighs the residuals."""
        self.model.check_scenario(scenario, self.actuator)
        return self.model.simulate(
            self.actuator, scenario, self.model.healthy(self.actuator),
            fidelity=self.model.fidelities[-1], noise=self._noise, seed=self._seed,
            sample_rate=self._rate,
        )  # fmt: skip

    def look(self, scenario: Scenario, limits: Mapping[str, float]) -> Looked:
        """The distance, negative, or what is in the way of it."""
        demands: dict[str, float] = {}
        try:
            record = self.record(scenario)
            demands = self.model.demanded(record)
            if excess(demands, limits) > 0.0:
                return Looked(math.inf, demands, BEYOND)
            obstacles = self.model.excitation(record, self.actuator)
            if obstacles:
                return Looked(math.inf, demands, obstacles[0])
            return Looked(-self.distance(record), demands)
        except (DivergedError, ParameterError, RecordError) as error:
            return Looked(math.inf, demands, str(error))

    def distance(self, record: Recording, iterations: int = _ITERATIONS) -> float:
        """Standard deviations between the two, each fitted to the other; the smaller counts."""
        a, b = self._whole()
        own_a, own_b = (
            [name for name in one if name not in other]
            for one, other in (self.values, self.values[::-1])
        )
        return min(
            self._distance(record, a, b, own_b, iterations),
            self._distance(record, b, a, own_a, iterations),
        )

    def _distance(
        self,
        record: Recording,
        truth: Mapping[str, float],
        other: Mapping[str, float],
        own: Iterable[str],
        iterations: int,
    ) -> float:
        """Standard deviations from ``truth`` to the best fit of ``other``, with ``own`` free."""
        comparison = self.model.compare(record, self.actuator, threads=self._threads)
        free: list[Unknown] = [replace(self._known[name], spread=None) for name in own]
        prior = Baseline.of_simulation().prior
        if not self.baseline.exact:
            prior = self.baseline.drifted(self.actuator)
            prior = prior.of(name for name in prior.names if name not in self._known)
            free += [
                replace(self.model.unknown(self.actuator, n), spread=None) for n in prior.names
            ]
            more = [
                one
                for one in effective(self.model.unknowns(self.actuator), [comparison])
                if one.name not in self._known and one.name not in prior.names
            ]
            prior = with_nuisances(prior, more)
            free += more
        names = [one.name for one in free]
        held = {name: x for name, x in other.items() if name not in names}
        nominal = {one.name: other.get(one.name, one.healthy) for one in free}
        aim = self._residuals(comparison, {**nominal, **truth})
        here = self._residuals(comparison, self.model.healthy(self.actuator))
        noise = max(comparison.noise, float(np.sqrt(here @ here / comparison.independent)))
        noise *= comparison.model_error
        if not free:
            gap = aim - self._residuals(comparison, other)
            return float(np.sqrt(gap @ gap)) / noise
        problem = Problem([comparison], free, held=held, prior=prior).with_noise(noise)
        chart = problem.chart

        def residuals(z: np.ndarray) -> np.ndarray:
            found = problem.residuals(chart.to_values(z))
            found[:, : len(aim)] -= aim
            return found

        start = np.array([[nominal[name] for name in names]])
        fit = LevenbergMarquardt.start(chart.from_values(start), residuals, damping=1e-2)
        for _ in range(iterations):
            fit.iterate(residuals, chart.lower, chart.upper, chart.project)
        return float(np.sqrt(fit.best(1).costs[0])) / noise

    @staticmethod
    def _residuals(comparison: Any, values: Mapping[str, float]) -> np.ndarray:
        """Weighted residuals (K,) of one vector of values."""
        candidates = {name: np.array([x]) for name, x in values.items()}
        return np.asarray(comparison.residuals(candidates, 1)[0])


def _named(values: Mapping[str, float]) -> str:
    shown = [f"{name} {x:.3g}" for name, x in values.items()]
    return ", ".join(shown) if shown else "healthy"
