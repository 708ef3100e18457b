"""Bias and scatter of estimates on healthy recordings, by fault.

Recordings of one healthy actuator differ; and a twin that lacks a form of an actuator takes part of
it for a fault, in all of them alike. Parameters and sensors, which are free beside the faults,
can hide that from a calibration and not from a verdict: so healthy recordings are judged as
`identify` would. What it finds then beyond its standard errors, it may find in any recording.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.assess import assess
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import find, named
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown

_LEAST_ODD = 0.05  # share of a range by which a healthy recording may differ from the others
_ODD = 6.0  # robust standard deviations
_JUDGED = 5  # recordings, evenly chosen, which take a second or more each


def healthy_bias(
    model: Model, actuator: ParameterSet, baseline: Baseline, comparisons: Sequence[Comparison]
) -> dict[str, float]:
    """Standard deviation by which a healthy recording may be found off healthy, by fault.

    Parameters
    ----------
    model, actuator : as learnt
    baseline : what is known of it, without this
    comparisons : the healthy recordings

    Raises
    ------
    RecordError
        If one of them is unlike the others.
    """
    beside = [model.compare(one.recording, actuator) for one in comparisons]
    faults = [one for one in model.faults(actuator) if one.direction_of is None]
    healthy = np.array([one.healthy for one in faults])
    near = _descended_to(beside, faults)
    if len(near) > 2:
        _refuse_odd(comparisons, faults, near)
    off = np.abs(near.mean(axis=0) - healthy)
    scatter = near.std(axis=0, ddof=1) if len(near) > 1 else np.zeros(len(faults))
    chosen = [beside[n] for n in np.unique(np.linspace(0, len(beside) - 1, _JUDGED).astype(int))]
    judged, errors = _judged(model, actuator, baseline, chosen, faults)
    beyond = np.mean((judged - healthy) ** 2 - errors**2, axis=0)
    found = np.hypot(np.maximum(off, np.sqrt(np.maximum(beyond, 0.0))), scatter)
    return {one.name: float(x) for one, x in zip(faults, found, strict=True)}


def _descended_to(beside: Sequence[Comparison], faults: Sequence[Unknown]) -> np.ndarray:
    """(R, d) faults at the end of descents from healthy, which may end below it."""
    free = [replace(one, lower=one.lower - one.slack) if one.slack else one for one in faults]
    ends = []
    for one in beside:
        problem = Problem([one], free)
        problem = problem.corrected(problem.healthy) or problem
        ends.append(LocalDescent().run(problem, budget=None, seed=1, report=lambda *_: None).point)
    return np.array(ends)


def _judged(
    model: Model,
    actuator: ParameterSet,
    baseline: Baseline,
    beside: Sequence[Comparison],
    faults: Sequence[Unknown],
) -> tuple[np.ndarray, np.ndarray]:
    """(R, d) faults, and their standard errors, with parameters, load and sensors free."""
    values, errors = [], []
    for one in beside:
        problem = Problem([one], model.faults(actuator)).searched()
        found = find(problem, named(model.default_search))
        seen = assess(model, actuator, problem, found, baseline)
        spread = dict(zip(problem.names, np.sqrt(np.diag(seen.covariance)), strict=True))
        values.append([seen.values[fault.name] for fault in faults])
        errors.append([spread[fault.name] for fault in faults])
    return np.array(values), np.array(errors)


def _refuse_odd(
    comparisons: Sequence[Comparison], faults: Sequence[Unknown], values: np.ndarray
) -> None:
    """Refuse a recording that is unlike the others."""
    width = np.array([one.width + one.slack for one in faults])
    away = np.abs(values - np.median(values, axis=0)) / width
    usual = np.maximum(1.4826 * np.median(away, axis=0), _LEAST_ODD / _ODD)
    n, k = (int(x) for x in np.unravel_index(np.argmax(away / usual), away.shape))
    if away[n, k] <= _ODD * usual[k]:
        return
    raise RecordError(
        f"{name_of(comparisons, n)} is unlike the other healthy recordings: its {faults[k].name} "
        f"differs from theirs by {values[n, k] - np.median(values[:, k]):+.2g}. If it is faulty or "
        "of another actuator, leave it out."
    )


def name_of(comparisons: Sequence[Comparison], n: int) -> str:
    """The file or labels of a recording, else its place."""
    recording = comparisons[n].recording
    if recording.source or recording.labels:
        return recording.name
    return f"Recording {n + 1} of {len(comparisons)}"
