"""Healthy recordings as their closed loop shows them.

Equations along the motion (`ematwin.estimation.along_motion`) need more than one current. A drive
that was calibrated by them may be judged by that, in the closed loop of its reference, which takes
a form that it lacks for faults. How far it does so shows on healthy recordings.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ematwin.estimation.aliases import aliases_of
from ematwin.estimation.baseline import Baseline, ClosedLoop, with_all_free
from ematwin.estimation.constants import WORST
from ematwin.estimation.correction import corrected, reweighed, with_model_error
from ematwin.estimation.descent import Descent
from ematwin.estimation.free_unknowns import lowered
from ematwin.estimation.healthy_fit import between_recordings
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.numerics.side_by_side import side_by_side


def closed_loop(
    model: Model, actuator: ParameterSet, baseline: Baseline, comparisons: Sequence[Comparison]
) -> ClosedLoop | None:
    """Misfit and scatter of healthy recordings in closed loop; None without a reference's answer.

    From the peak next to healthy of each recording. The misfit is the median one. A recording that
    the closed loop does not explain, as near instability, would get no verdict, and counts only
    where there is no other.
    """
    now = replace(baseline, recordings=0)  # of one occasion: nothing has drifted since
    every = side_by_side(lambda one: _near_healthy(model, actuator, now, one), comparisons)
    found = [one for one in every if one is not None]
    if not found:
        return None
    found = [one for one in found if one.misfit <= WORST] or found
    away, errors = (np.array(each) for each in list(zip(*found, strict=True))[:2])
    scatter = np.sqrt(between_recordings(away, errors)).tolist()
    faults = [one for one in model.faults(actuator) if one.direction_of is None]
    return ClosedLoop(
        float(np.median([one.misfit for one in found])),
        {one.name: x for one, x in zip(faults, scatter, strict=True)},
    )


class _Peak(NamedTuple):
    """Peak of one healthy recording in closed loop."""

    away: np.ndarray  # (d,) faults without directions, from healthy
    errors: np.ndarray  # (d,), standard
    misfit: float  # relative


def _near_healthy(
    model: Model, actuator: ParameterSet, baseline: Baseline, one: Comparison
) -> _Peak | None:
    compared = model.compare(one.recording, actuator)
    alone = Problem([compared], lowered(model.faults(actuator)))
    full = with_all_free(model, actuator, alone, baseline)
    aliases = aliases_of(model, actuator, full, full.start)
    descent = Descent(aliases, least_noise=full.least_noise, settled=np.inf)
    end = with_model_error(reweighed(corrected(full, full.start, descent), descent))
    if not end.rounds:
        return None
    peak = end.peak
    problem, chart = peak.problem, peak.problem.chart
    values = chart.to_values(peak.unbounded(problem.model_error)[None])[0]
    errors = chart.standard_errors(peak.z, end.covariance)
    faults = [
        n
        for n, each in enumerate(problem.unknowns)
        if each.role == "fault" and each.direction_of is None
    ]
    healthy = np.array([problem.unknowns[n].healthy for n in faults])
    return _Peak(values[faults] - healthy, errors[faults], problem.relative_misfit(peak.cost))
