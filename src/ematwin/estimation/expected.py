"""The errors that a command promises, and those that `identify` makes on its recordings.

A recording is simulated with known faults, and the width that its posterior has at the true values
(`ematwin.estimation.laplace`) is what intervals will state: with J the Jacobian of the weighted
residuals there, sigma their noise and P the inverse covariance of what is known beforehand,

    cov = (J J^T/(f sigma)^2 + P)^-1

the bound of Cramer and Rao with priors (Van Trees 1968, eq. 2.4.246). The problem is corrected by
the reference as it is at the end of a search; f is what slopes of the fast model are off by then,
and `Model.model_error` where a kind has no reference.

A command that is to be chosen has to be good for faults that are still unknown: squared errors are
averaged over vectors drawn from the prior of the faults (Chaloner and Verdinelli 1995, Statistical
Science 10, 273-304: "on-average" designs). What no command tells apart (the pivots of
`Model.aliases`) counts as known: its tolerance widens the errors of all commands alike, and would
hide what they differ in.

A width is linear, and knows nothing of other minima: `observe` has recordings of the finest model
identified, each of another actuator.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ematwin.errors import DivergedError, ParameterError, RecordError
from ematwin.estimation.assess import assess
from ematwin.estimation.baseline import Baseline, with_all_free
from ematwin.estimation.command_search import BEYOND, excess
from ematwin.estimation.constants import SMALLEST
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.laplace import Laplace, standard_errors, width_at
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import find, named
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import cores, side_by_side
from ematwin.numerics.sobol import Sobol
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

SEVEREST = 0.5  # share of the way from healthy to a bound: a test is for faults that begin
DRAWS = 6
FRESH = 16  # fault vectors on which the best commands are compared anew


def width_of(
    model: Model,
    actuator: ParameterSet,
    baseline: Baseline,
    recording: Recording,
    values: Mapping[str, float],
    *,
    fast: bool = False,
    threads: int | None = 1,
) -> Laplace:
    """The width that a posterior has at the true values of a simulated recording.

    Parameters
    ----------
    model, actuator, baseline : of the twin, and what is known of it
    recording : of the first of `Model.fidelities`
    values : of the faults, by name; what is not named is healthy
    fast : whether the recording is of the last of them: no correction is needed then
    threads : that share a batch; None takes one for each core
    """
    problem = Problem.of(recording, actuator, threads=threads)
    full = with_all_free(model, actuator, problem, baseline)
    point = np.array([values.get(one.name, one.healthy) for one in full.unknowns])
    near = full.of_fast_model() if fast else full.corrected(point) or full
    return width_at(near, point, aliases=partial(model.aliases, actuator), least_noise=near.noise)


@dataclass(frozen=True)
class Judged:
    """A command, simulated at each fault vector.

    Attributes
    ----------
    scenario : Scenario
    errors : (n,) array, expected error of each magnitude; infinite where nothing is told
    demands, faulty : what the motion demands of a healthy actuator, and of any of those that were
        simulated, by name, SI
    obstacle : why no verdict would be given on such a recording, or ""
    """

    scenario: Scenario
    errors: np.ndarray
    demands: dict[str, float]
    faulty: dict[str, float]
    obstacle: str = ""


def drawn_faults(
    model: Model, actuator: ParameterSet, shares: np.ndarray, given: Mapping[str, float]
) -> list[dict[str, float]]:
    """Fault vectors from shares (M, n) in [0, 1), one column for each fault; ``given`` are held.

    Magnitudes lie between `SMALLEST` of their range and `SEVEREST` of the way to a bound, to either
    side where healthy lies inside; directions anywhere.
    """
    every = model.faults(actuator)
    found = []
    for row in shares:
        values = {one.name: _value(one, u) for one, u in zip(every, row.tolist(), strict=True)}
        found.append(model.values_of(actuator, {**values, **given}))
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


def fault_shares(model: Model, actuator: ParameterSet, count: int, seed: int) -> np.ndarray:
    """Shares (M, n) that cover the prior of the faults evenly."""
    return Sobol(len(model.faults(actuator)), np.random.default_rng(seed)).random(count)


class Judge:
    """Expected standard errors of commands for one actuator, at the same fault vectors.

    Parameters
    ----------
    model, actuator, baseline : of the twin, and what is known of it
    vectors : values by name, at each of which slopes are taken
    noise, sample_rate, seed : of the simulated recordings
    threads : that share the fault vectors; None takes one for each core

    Attributes
    ----------
    magnitudes : faults but directions, (n,)
    held : what counts as known, because no command tells it from something else
    baseline : what is known, with these
    """

    def __init__(
        self,
        model: Model,
        actuator: ParameterSet,
        baseline: Baseline,
        vectors: Sequence[Mapping[str, float]],
        *,
        noise: Noise | None = None,
        sample_rate: float | None = None,
        seed: int = 1,
        threads: int | None = None,
    ) -> None:
        self.model, self.actuator = model, actuator
        self.vectors = [dict(values) for values in vectors]
        self.noise, self.sample_rate, self.seed = noise, sample_rate, seed
        self.threads = threads or cores()
        self.magnitudes = tuple(o for o in model.faults(actuator) if o.direction_of is None)
        held = () if baseline.exact else _blind(model, actuator, baseline)
        self._given = baseline
        self.held = tuple(one.name for one in held)
        self.baseline = baseline.knowing(held)

    def at(self, vectors: Sequence[Mapping[str, float]]) -> "Judge":
        """The same judge at other fault vectors."""
        return Judge(
            self.model, self.actuator, self._given, vectors, noise=self.noise,
            sample_rate=self.sample_rate, seed=self.seed, threads=self.threads,
        )  # fmt: skip

    def judge(
        self,
        scenario: Scenario,
        limits: Mapping[str, float] | None = None,
        *,
        fast: bool = False,
        enough: Callable[[np.ndarray], bool] = lambda errors: False,
    ) -> Judged:
        """What a command promises, or what is in its way; one beyond its limits is not judged.

        Parameters
        ----------
        scenario : the command
        limits : what it may demand of a healthy actuator, by name, SI
        fast : simulate with the fast model alone, for the many commands of a search
        enough : whether errors (n,), of which the true ones can only be larger, are large enough to
            know that the command is worse than another
        """
        nothing = np.full(len(self.magnitudes), np.inf)
        demands: dict[str, float] = {}
        try:
            self.model.check_scenario(scenario, self.actuator)
            record = self._record(scenario, self.model.healthy(self.actuator), fast)
            demands = self.model.demanded(record)
            if excess(demands, limits or {}) > 0.0:
                return Judged(scenario, nothing, demands, {}, BEYOND)
            obstacles = self.model.excitation(record, self.actuator)
            if obstacles:
                return Judged(scenario, nothing, demands, {}, obstacles[0])
            total, faulty = np.zeros(len(self.magnitudes)), demands
            at = partial(self._at, scenario=scenario, fast=fast)
            places = range(len(self.vectors))
            for first in range(0, len(places), self.threads):
                some = places[first : first + self.threads]
                for squares, asked in side_by_side(at, some, self.threads):
                    total += squares
                    faulty = {name: max(x, asked[name]) for name, x in faulty.items()}
                errors = np.sqrt(total / len(places))
                if enough(errors):
                    break
        except (DivergedError, ParameterError, RecordError) as error:
            return Judged(scenario, nothing, demands, {}, str(error))
        return Judged(scenario, errors, demands, faulty)

    def _record(self, scenario: Scenario, values: Mapping[str, float], fast: bool) -> Recording:
        return self.model.simulate(
            self.actuator, scenario, values, fidelity=self.model.fidelities[-1 if fast else 0],
            noise=self.noise, seed=self.seed, sample_rate=self.sample_rate,
        )  # fmt: skip

    def _at(self, n: int, scenario: Scenario, fast: bool) -> tuple[np.ndarray, dict[str, float]]:
        """Squared errors (n,) of the magnitudes at fault vector ``n``, and what was demanded."""
        values = self.vectors[n]
        record = self._record(scenario, values, fast)
        # the vectors share the cores
        peak = width_of(self.model, self.actuator, self.baseline, record, values, fast=fast)
        problem = peak.problem
        errors = standard_errors(problem.chart, peak.z, peak.widened(problem.model_error))
        squares = errors[[problem.names.index(one.name) for one in self.magnitudes]] ** 2
        return np.where(np.isfinite(squares), squares, np.inf), self.model.demanded(record)


def _blind(model: Model, actuator: ParameterSet, baseline: Baseline) -> list[Unknown]:
    """Parameters, load and sensors that no command tells from faults or from one another."""
    pivots = {one.pivot for one in model.aliases(actuator, model.healthy(actuator))}
    every = {one.name: one for one in model.unknowns(actuator)}
    known = [model.unknown(actuator, name) for name in baseline.prior.names if name in pivots]
    more = [
        one
        for name, one in every.items()
        if name in pivots and name not in baseline.prior.names and one.spread is not None
    ]
    return sorted((*known, *more), key=lambda one: one.name)


def observe(
    judge: Judge,
    scenarios: Sequence[Scenario],
    recordings: int,
    *,
    seed: int = 2,
    step: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> np.ndarray:
    """Errors (N, C, n): of N actuators, C commands, n magnitudes.

    Parameters
    ----------
    judge : the actuator, what is known of it, noise and sample rate
    scenarios : the commands, (C,); each actuator answers all of them
    recordings : N
    seed : of faults, parameters and noise
    step : float, s, of the model that is recorded; None takes the actuator's
    progress : called with the share done

    Returns
    -------
    (N, C, n) array; after Ctrl-C of fewer actuators
    """
    model, twin = judge.model, judge.actuator
    rng = np.random.default_rng(seed)
    shares = rng.random((recordings, len(model.faults(twin))))
    vectors = drawn_faults(model, twin, shares, {})
    actuators = [drawn_actuator(judge, rng) for _ in vectors]
    settings: dict[str, Any] = {} if step is None else {"step": step}
    search = named(model.default_search)

    def errors_of(n: int, scenario: Scenario) -> list[float]:
        record = model.simulate(
            actuators[n], scenario, vectors[n], fidelity=model.fidelities[0], noise=judge.noise,
            seed=seed * 10_000 + n, sample_rate=judge.sample_rate, **settings,
        )  # fmt: skip
        # as `identify` does, but for its verdict
        problem = Problem.of(record, twin, threads=1)
        found = find(problem, search)
        values = assess(model, twin, problem, found, judge.baseline).values
        return [values[one.name] - vectors[n][one.name] for one in judge.magnitudes]

    errors = np.full((recordings, len(scenarios), len(judge.magnitudes)), np.nan)
    with noting_interrupts() as interrupts, ThreadPoolExecutor(judge.threads) as pool:
        tasks = {
            pool.submit(errors_of, n, scenario): (n, c)
            for n in range(recordings)
            for c, scenario in enumerate(scenarios)
        }
        try:
            for done, task in enumerate(as_completed(tasks), 1):
                errors[tasks[task]] = task.result()
                interrupts.check()
                if progress is not None:
                    progress(done / len(tasks))
        except KeyboardInterrupt:
            interrupts.pressed = False
        finally:
            pool.shutdown(cancel_futures=True)
    return errors[~np.isnan(errors).any(axis=(1, 2))]


def drawn_actuator(judge: Judge, rng: np.random.Generator) -> ParameterSet:
    """An actuator as it may be: parameters from what is known of them today."""
    model, twin = judge.model, judge.actuator
    prior = judge.baseline.drifted(twin)
    prior = prior.of(name for name in prior.names if "." in name)
    if not prior.names:
        return twin
    drawn = rng.multivariate_normal(prior.mean, prior.covariance)
    values = {}
    for name, x in zip(prior.names, drawn.tolist(), strict=True):
        one = model.unknown(twin, name)
        value = float(np.exp(x)) if one.logarithmic else x
        values[name] = float(np.clip(value, one.lower, one.upper))
    return twin.changed(values)
