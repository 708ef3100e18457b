"""Experiment: an actuator with prior knowledge, and the posterior that a command would give.

A recording is simulated with known faults, and the width that its posterior has at the true values
(`ematwin.estimation.laplace`) is what intervals will state: with J the Jacobian of the weighted
residuals there, sigma their noise and P the inverse covariance of the prior,

    cov = (J J^T/(f sigma)^2 + P)^-1

the bound of Cramer and Rao with priors (Van Trees 1968, eq. 2.4.246). The problem is corrected by
the reference as it is at the end of a search; f is the error of the fast model's slopes, and
`Model.model_error` where a kind has no reference. A width is linear, and knows nothing of other
minima.

`identifiability` shows the expected posterior of one command, `design` looks for the command whose
errors are least, `healthy_tests` for commands after which parameters are known best, and
`discriminate` for the command that tells two explanations apart.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ematwin.errors import DivergedError, InputError, ParameterError, RecordError, whole_number
from ematwin.estimation.aliases import aliases_of
from ematwin.estimation.baseline import (
    Baseline,
    baseline_of,
    frees_parameters,
    later,
    uncertain,
    with_all_free,
)
from ematwin.estimation.corrected_problem import corrected_at, of_fast_model, reference_scatter
from ematwin.estimation.correction import Corrected, with_model_error
from ematwin.estimation.healthy_fit import healthy_nuisances
from ematwin.estimation.laplace import sharp_errors, width_at
from ematwin.estimation.noise import noise_at
from ematwin.estimation.prior import Prior
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown, no_unknown
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

BEYOND = "The command is beyond its limits."


class RefusedError(RecordError):
    """A command exceeds a limit on the healthy actuator, or moves it too little for a verdict."""

    def __init__(self, why: str, demands: dict[str, float], excess: float = 0.0) -> None:
        super().__init__(why)
        self.demands = demands  # of the motion, by name, SI
        self.excess = excess  # shares by which they exceed their limits, added up


UNANSWERED = (DivergedError, ParameterError, RecordError)
"""Errors of a command whose recording would get no verdict."""


@dataclass(frozen=True)
class Expected(Corrected):
    """Expected posterior at the true values of a simulated recording."""

    @property
    def problem(self) -> Problem:
        """With everything free."""
        return self.peak.problem

    @cached_property
    def errors(self) -> dict[str, float]:
        """Standard errors by name, in values; of a direction without meaning infinite."""
        found = self.problem.chart.standard_errors(self.peak.z, self.covariance)
        return dict(zip(self.problem.names, found.tolist(), strict=True))

    @cached_property
    def sharp_errors(self) -> dict[str, float]:
        """Standard errors of the searched unknowns, as if all others were known exactly."""
        unknowns = self.problem.unknowns
        searched = sum(o.role in ("fault", "nuisance") and not o.marginal for o in unknowns)
        found = sharp_errors(self.peak, searched, self.problem.model_error)
        return dict(zip(self.problem.names[:searched], found.tolist(), strict=True))

    def error_of(self, weights: Mapping[str, float]) -> float:
        """Standard error of a combination of unknowns; its weights by name."""
        way = np.zeros(len(self.problem.names))
        for name, weight in weights.items():
            n = self.problem.names.index(name)
            way[n] = weight * self.problem.chart.widths[n]
        return float(np.sqrt(way @ self.covariance @ way))

    @property
    def correlation(self) -> np.ndarray:
        """(d, d) of the coordinates of the problem's chart."""
        spread = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(spread, spread))


@dataclass(frozen=True)
class Experiment:
    """Actuator, prior knowledge of it, and settings of the recording."""

    model: Model  # of the twin, as the actuator
    actuator: ParameterSet
    baseline: Baseline  # prior knowledge of the actuator
    noise: Noise | None = None  # of the sensors; None for that which the kind simulates by itself
    sample_rate: float | None = None  # Hz; None takes the kind's
    seed: int = 1  # of the noise
    threads: int | None = None  # that share a batch; None takes one for each core

    @classmethod
    def of(cls, actuator: Any, *, exact: bool = False, **settings: Any) -> "Experiment":
        """Experiment on an actuator, its name or file; ``exact`` if all of it is known."""
        chosen = load_actuator(actuator)
        baseline = Baseline.of_simulation() if exact else baseline_of(actuator, chosen)
        return cls(model_of(chosen), chosen, baseline, **settings)

    def __post_init__(self) -> None:
        whole_number(self.seed, "seed", 0)

    @property
    def magnitudes(self) -> tuple[Unknown, ...]:
        """Faults but directions."""
        return tuple(o for o in self.model.faults(self.actuator) if o.direction_of is None)

    @property
    def ranges(self) -> dict[str, float]:
        """Ranges of the magnitudes, by name."""
        return {one.name: one.width for one in self.magnitudes}

    def check_magnitude(self, fault: str) -> None:
        """Raise InputError if there is no such fault, or it is a direction."""
        faults = {one.name: one for one in self.model.faults(self.actuator)}
        if fault not in faults:
            raise no_unknown(fault, self.actuator, self.model.unknowns(self.actuator))
        if faults[fault].direction_of is not None:
            raise InputError(
                f"{fault} is the direction of {faults[fault].direction_of}; name that instead."
            )

    def started(self, scenario: Any, duration: float | None) -> Scenario:
        """The command to begin from, checked, in the duration (s) that is asked for."""
        given = self.model.load_scenario(scenario)
        if duration is not None:
            if not (math.isfinite(duration) and duration > 0.0):
                raise InputError(f"duration must be a positive number of s, received {duration}.")
            given = given.lasting(duration)
        self.model.check_scenario(given, self.actuator)
        return given

    def record(
        self, scenario: Scenario, faults: Mapping[str, float] | None = None, *, fast: bool = False
    ) -> Recording:
        """Simulated recording; healthy if no faults are given, ``fast`` by the fast model alone."""
        values = self.model.healthy(self.actuator) if faults is None else faults
        return self.model.simulate(
            self.actuator, scenario, values, fidelity=self.model.fidelities[-1 if fast else 0],
            noise=self.noise, seed=self.seed, sample_rate=self.sample_rate,
        )  # fmt: skip

    def move(
        self, scenario: Scenario, limits: Mapping[str, float], *, fast: bool = True
    ) -> Recording:
        """Recording of the healthy actuator under a command that is worth recording.

        Raises `RefusedError` or another one of `UNANSWERED` under one that is not.
        """
        self.model.check_scenario(scenario, self.actuator)
        recording = self.record(scenario, fast=fast)
        demands = self.model.demanded(recording)
        if (over := excess(demands, limits)) > 0.0:
            raise RefusedError(BEYOND, demands, over)
        if obstacles := self.model.excitation(recording, self.actuator):
            raise RefusedError(obstacles[0], demands)
        return recording

    def demanded(self, scenario: Scenario, *, fast: bool = True) -> dict[str, float]:
        """Demands of a command on the healthy actuator, by name, SI."""
        return self.model.demanded(self.record(scenario, fast=fast))

    def problem(self, recording: Recording) -> Problem:
        """Problem of a recording in which everything is free that is not known exactly."""
        faults = Problem.of(recording, self.actuator, threads=self.threads)
        return with_all_free(self.model, self.actuator, faults, self.baseline)

    def expected(
        self, recording: Recording, faults: Mapping[str, float], *, fast: bool = False
    ) -> Expected:
        """Expected posterior at the true faults of a recording; healthy where none is named.

        ``fast`` says that it was simulated by the fast model: no correction is needed then.
        """
        full = self.problem(recording)
        point = np.array([faults.get(one.name, one.healthy) for one in full.unknowns])
        near = of_fast_model(full) if fast else corrected_at(full, point) or full
        return self._at(near, point, near.noise)

    @cached_property
    def parameters(self) -> tuple[Unknown, ...]:
        """Parameters that a calibration fits, with the spreads of their tolerances."""
        tolerated = {one.name: one for one in uncertain(self.model, self.actuator)}
        fitted = tolerated if frees_parameters(self.model) else self.model.nominal
        names = [n for n in self.baseline.prior.names if n in fitted and n in tolerated]
        if not names:
            raise InputError(
                f"Nothing of {self.actuator.name} is uncertain: no parameter that can be fitted "
                "has a tolerance."
            )
        return tuple(tolerated[name] for name in names)

    def expected_healthy(self, recording: Recording) -> Expected:
        """Expected posterior of `parameters`, load and sensors after a healthy recording.

        Its covariance is that which a calibration states (`ematwin.estimation.correction`). The
        scatter of the reference from one candidate to the next counts as discrepancy.
        """
        misfit = self.baseline.misfit
        comparison = self.model.compare(recording, self.actuator, threads=self.threads)
        comparison = comparison.with_evidence()
        own = healthy_nuisances(self.model, self.actuator, [comparison])
        prior = self.baseline.prior.of(one.name for one in self.parameters)
        problem = Problem(
            [comparison], [*self.parameters, *own], prior=prior.and_(Prior.independent(own))
        )
        point = problem.start
        near = corrected_at(problem, point) or problem
        # what the twin leaves of others
        left = noise_at(near, misfit) if math.isfinite(misfit) else 0.0
        # behind impacts no calibration gets below this
        scatter = problem.model_error * noise_at(near, reference_scatter(problem, point))
        rounds = 0 if near is problem else 1
        end = self._at(near, point, max(near.noise, left, scatter), rounds)
        return Expected(**vars(with_model_error(end, threads=self.threads)))

    def _at(
        self, problem: Problem, point: np.ndarray, least_noise: float, rounds: int = 0
    ) -> Expected:
        """Posterior at a point (d,), which the rounds of correction do not move."""
        aliases = aliases_of(self.model, self.actuator, problem, point)
        peak = width_at(problem, point, aliases=aliases, least_noise=least_noise)
        return Expected(peak, rounds, left=np.zeros((1, len(point))))

    def limits(self, given: Mapping[str, float]) -> dict[str, float]:
        """Given limits, checked, as numbers."""
        known = [one.name for one in self.model.limited]
        for name, value in given.items():
            if name not in known:
                raise InputError(
                    f"There is no limit {name!r} for the kind {self.model.kind}; choose of "
                    f"{', '.join(known)}."
                )
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(
                    f"The limit of {name} must be a positive number, received {value}."
                )
        return {name: float(value) for name, value in given.items()}

    def knowing_aliases(self) -> tuple["Experiment", tuple[str, ...]]:
        """The same where what no command can determine counts as known, and the names of that.

        These are the pivots of `Model.aliases`. Their tolerances widen the errors of all commands
        alike, and would hide their differences.
        """
        model, actuator, prior = self.model, self.actuator, self.baseline.prior
        if self.baseline.exact:
            return self, ()
        pivots = {one.pivot for one in model.aliases(actuator, model.healthy(actuator))}
        known = [model.unknown(actuator, name) for name in prior.names if name in pivots]
        known += [
            one for one in model.unknowns(actuator)
            if one.name in pivots and one.name not in prior.names and one.spread is not None
        ]  # fmt: skip
        known.sort(key=lambda one: one.name)
        knowing = replace(self, baseline=self.baseline.knowing(known))
        return knowing, tuple(one.name for one in known)

    def drawn_actuator(self, rng: np.random.Generator) -> ParameterSet:
        """An actuator whose parameters are drawn from their prior."""
        prior, unknowns = later(self.model, self.actuator, self.baseline)
        unknowns = [one for one in unknowns if "." in one.name]
        if not unknowns:
            return self.actuator
        prior = prior.of(one.name for one in unknowns)
        drawn = rng.multivariate_normal(prior.mean, prior.covariance)
        values = {}
        for one, x in zip(unknowns, drawn.tolist(), strict=True):
            value = float(np.exp(x)) if one.logarithmic else x
            values[one.name] = float(np.clip(value, one.lower, one.upper))
        return self.actuator.changed(values)


def excess(demands: Mapping[str, float], limits: Mapping[str, float]) -> float:
    """Shares by which demands exceed their limits, added up; 0 where all are kept."""
    return sum(
        demands[name] / limit - 1.0
        for name, limit in limits.items()
        # motions that differ by rounding keep a limit alike
        if demands.get(name, 0.0) > 1.001 * limit
    )
