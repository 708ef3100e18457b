"""Bias and scatter of estimates on healthy recordings, by fault.

Recordings of one healthy actuator differ; and a twin that lacks a form of an actuator takes part of
it for a fault, in all of them alike. Parameters and sensors, which are free beside the faults,
can hide that from a calibration and not from a verdict: so healthy recordings are judged as
`identify` would. Deviations beyond the standard errors there may occur in any recording.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.along_motion import usual_search
from ematwin.estimation.assess import assess
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.constants import AS_GOOD
from ematwin.estimation.corrected_problem import as_searched, corrected_at
from ematwin.estimation.free_unknowns import lowered
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Search, find
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side
from ematwin.numerics.signals import spread_of

_ODD = 6.0  # standard deviations


def healthy_bias(
    model: Model,
    actuator: ParameterSet,
    baseline: Baseline,
    comparisons: Sequence[Comparison],
    beside: Sequence[Mapping[str, float]],
) -> dict[str, float]:
    """Standard deviation by which a healthy recording may be found off healthy, by fault.

    It is the larger of two. One is the root mean square of what `identify` finds, less the standard
    errors that explain it: the moment estimate of a variance between recordings (DerSimonian and
    Laird 1986, Control. Clin. Trials 7, 177-188). The other is estimated with the faults alone
    free and all else as learnt: there the faults absorb the whole error of the twin.

    ``baseline`` is without this; ``beside`` are load and sensors of each recording, as learnt.
    `RecordError` if one of them is unlike the others.
    """
    faults = [one for one in model.faults(actuator) if one.direction_of is None]
    # recordings of one occasion: nothing has drifted since
    now = replace(baseline, recordings=0)
    compared = [model.compare(one.recording, actuator) for one in comparisons]

    def judged(one: Comparison, search: Search | None = None) -> _Judged:
        """The faults of a recording, all else free as it is known."""
        problem = as_searched(Problem([one], lowered(model.faults(actuator))))
        end = find(problem, search or usual_search(model, actuator, problem))
        seen = assess(model, actuator, problem, end, now)
        chosen = [n for n, one in enumerate(problem.unknowns) if one.direction_of is None]
        values = np.array([seen.values[problem.names[n]] for n in chosen])
        told = seen.joint is not None and seen.joint.peaks[0].problem.is_told
        return _Judged(values, np.sqrt(np.diag(seen.covariance))[chosen], seen.cost, told)

    found = side_by_side(judged, compared)
    settled, left = list(found), set(range(len(found)))
    while odd := _odd(faults, settled):
        n, said = odd
        # a search may end beside a healthy minimum that explains the recording as well
        near = judged(compared[n], LocalDescent()) if n in left else None
        if near is None or near.cost > AS_GOOD**2 * found[n].cost:
            raise RecordError(f"{name_of(comparisons, n)} {said}")
        settled[n] = near
        left.remove(n)
    values, errors = (np.array(each) for each in list(zip(*found, strict=True))[:2])
    healthy = np.array([one.healthy for one in faults])
    beyond = np.maximum(np.mean((values - healthy) ** 2 - errors**2, axis=0), 0.0)
    if all(one.is_told for one in found):  # the closed loop tells nothing of faults
        return {one.name: float(x) for one, x in zip(faults, np.sqrt(beyond), strict=True)}
    alone = [_descended_to(one, faults, held) for one, held in zip(compared, beside, strict=True)]
    off = np.mean((np.array(alone) - healthy) ** 2, axis=0)
    spread = np.sqrt(np.maximum(beyond, off))
    return {one.name: float(x) for one, x in zip(faults, spread, strict=True)}


def _descended_to(
    one: Comparison, faults: Sequence[Unknown], held: Mapping[str, float]
) -> np.ndarray:
    """(d,) faults at the end of a descent from healthy, which may end below it."""
    problem = Problem([one], lowered(faults), held=held)
    problem = corrected_at(problem, problem.healthy) or problem
    return LocalDescent().run(problem, budget=None, seed=1, report=lambda *_: None).point


class _Judged(NamedTuple):
    """Faults of a recording, without directions."""

    values: np.ndarray  # (d,)
    errors: np.ndarray  # (d,), standard
    cost: float  # of the data
    is_told: bool  # as of `Problem`


def _odd(faults: Sequence[Unknown], found: Sequence[_Judged]) -> tuple[int, str] | None:
    """Which of at least three recordings has faults unlike the others, and how it differs.

    None if there is none.
    """
    if len(found) < 3:
        return None
    values, errors = (np.array(each) for each in list(zip(*found, strict=True))[:2])
    width = np.array([one.width + one.slack for one in faults])
    away = np.abs(values - np.median(values, axis=0)) / width
    scatter = np.hypot(spread_of(away, axis=0), errors / width)
    usual = np.maximum(scatter, 0.05 / _ODD)  # so much of a range is never odd
    n, k = (int(x) for x in np.unravel_index(np.argmax(away / usual), away.shape))
    if away[n, k] <= _ODD * usual[n, k]:
        return None
    return n, (
        f"is unlike the other healthy recordings: its {faults[k].name} differs from theirs by "
        f"{values[n, k] - np.median(values[:, k]):+.2g}. If it is faulty or of another actuator, "
        "leave it out."
    )


def name_of(comparisons: Sequence[Comparison], n: int) -> str:
    """The file or labels of a recording, else its place."""
    recording = comparisons[n].recording
    if recording.source or recording.labels:
        return recording.name
    return f"Recording {n + 1} of {len(comparisons)}"
