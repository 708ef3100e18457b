"""Runs of a study that nobody searched: made from a formula and a seed."""

import math
from typing import Any

import numpy as np

from ematwin.benchmarking.plan import SHARED, Plan, Run, RunSpec, pack
from ematwin.benchmarking.store import Store
from ematwin.benchmarking.subject import Subject
from ematwin.models.bldc.faults import (
    FAULTS,
    PAPER_CASES,
    Faults,
    error_percent,
    error_percent_wrapped,
)

ACTUATOR = Subject.of("servo48").plain()

# Typical size of the error of each algorithm.
SIZES = {"ga": 0.05, "pso": 0.004, "de": 0.003, "gwo": 0.005, "da": 0.03, "woa": 0.1}
_SECONDS = {"ga": 1.2, "pso": 1.0, "de": 0.8, "gwo": 0.8, "da": 1.2, "woa": 1.1}


def spec(case="Low F", algorithm="de", run=0, **changed):
    """The inputs of a run."""
    values: dict[str, Any] = {
        "case": case,
        "faults": tuple(Faults(**PAPER_CASES.get(case, {})).vector.tolist()),
        "algorithm": algorithm,
        "run": run,
        "seed": run + 1,
        "population": 50,
        "iterations": 200,
        "noise": None,
        "record_seed": run,
        "actuator": ACTUATOR,
        "scenario": {"name": "chirp"},
    }
    return RunSpec(**{**values, **changed})


def settings_of(of):
    """What a run shares with the others of its study."""
    return {name: getattr(of, name) for name in SHARED}


def done(of, found, **changed):
    """A run that ended well with a fault vector."""
    injected = np.array(of.faults)
    values: dict[str, Any] = {
        "faults": tuple(found.tolist()),
        "cost": 1.0,
        "relative_misfit": 0.01,
        "err": float(error_percent(found, injected)),
        "err_wrapped": float(error_percent_wrapped(found, injected)),
        "evaluations": 10_000,
        "seconds": 1.0,
        "cpu_seconds": 0.9,
        "stopped": "iterations",
        "provenance": {"ematwin": "0.1.0", "machine": "bench", "engine": "local"},
    }
    return Run(of, "done", **{**values, **changed})


def failed(of, status="failed", message="it broke"):
    """A run that did not end well."""
    return Run(of, status, stopped=message)


def study(runs=4, algorithms=tuple(SIZES), cases=tuple(PAPER_CASES), seed=1, history_points=200):
    """Every case, algorithm and repetition."""
    rng = np.random.default_rng(seed)
    evaluations = (np.arange(history_points) + 1) * (10_000 // history_points)
    for case in cases:
        for algorithm in algorithms:
            size = SIZES.get(algorithm, 0.01)
            for run in range(runs):
                of = spec(case, algorithm, run)
                found = np.clip(np.array(of.faults) + size * rng.standard_normal(8), 0.0, 1.0)
                rate = 3.0 * rng.uniform(0.7, 1.3) / (size * 200.0 + 1.0)
                cost = 1.0 + 500.0 * np.exp(-rate * np.arange(history_points) / 20.0) + 30.0 * size
                yield done(
                    of,
                    found,
                    cost=float(cost[-1]),
                    seconds=_SECONDS.get(algorithm, 1.0) * rng.uniform(0.9, 1.1),
                    history=pack(evaluations, cost),
                )


def vector(**faults):
    """A fault vector by names."""
    return np.array([getattr(Faults(**faults), name) for name in FAULTS])


def stored(where, runs, settings=None):
    """The path of a store with some runs of one study."""
    with Store(where) as store:
        store.begin(settings or settings_of(runs[0].spec))
        store.save(runs)
    return where


def small_plan(**changes):
    """A plan with one case, two algorithms and three runs."""
    values = {
        "cases": {"Low F": (0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5)},
        "algorithms": ("ga", "pso"),
        "runs": 3,
        **changes,
    }
    return Plan(**values)  # type: ignore[arg-type]


def some_run(spec, status="done"):
    """A run that was not done, with numbers that are awkward to keep."""
    history = pack([10, *range(50, 400, 50)], [math.inf, *(1.0 / 3.0 / n for n in range(1, 8))])
    return Run(
        spec, status, tuple(0.1 * n for n in range(8)), math.pi * 1e-300, 0.1, 1e17 / 3.0, 0.3,
        350, 1.25, 1.125, history, "budget", {"ematwin": "0", "engine": "none"},
    )  # fmt: skip
