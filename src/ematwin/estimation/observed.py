"""The errors that `identify` makes on simulated recordings: what a promise is set beside.

Each recording is one of another actuator: faults from their prior, and parameters from what is
known of them and how far they may have drifted since, so that an actuator that is only known by its
data sheet is as uncertain here as it is on a bench. The finest model answers, with ideal sensors
but for their noise, and `identify` sees nothing but its recording. What counts as known in the
promise (`Judge.held`) is known here as well.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

import numpy as np

from ematwin.estimation.assess import assess
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.problem import Problem
from ematwin.estimation.promise import Judge, drawn_faults
from ematwin.estimation.search import find, named
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario


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
