"""A healthy recording as its closed loop shows it.

Equations along the motion (`ematwin.estimation.along_motion`) need currents with their sign. A
drive that was calibrated by them may be judged by less, in the closed loop of its reference, which
takes a form that it lacks for faults. How far it does so shows on a healthy recording.
"""

from dataclasses import replace

import numpy as np

from ematwin.estimation.aliases import aliases_of
from ematwin.estimation.baseline import Baseline, ClosedLoop, with_all_free
from ematwin.estimation.correction import corrected, reweighed, with_model_error
from ematwin.estimation.descent import Descent
from ematwin.estimation.healthy_fit import between_recordings
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet


def closed_loop(
    model: Model, actuator: ParameterSet, baseline: Baseline, one: Comparison
) -> ClosedLoop | None:
    """Misfit and scatter of a healthy recording in closed loop; None without a reference's answer.

    From the peak next to healthy.
    """
    now = replace(baseline, recordings=0)  # of one occasion: nothing has drifted since
    compared = model.compare(one.recording, actuator)
    alone = Problem([compared], model.faults(actuator))
    full = with_all_free(model, actuator, alone, now)
    aliases = aliases_of(model, actuator, full, full.start)
    descent = Descent(aliases, least_noise=full.least_noise, settled=np.inf)
    end = with_model_error(reweighed(corrected(full, full.start, descent), descent))
    if not end.rounds:
        return None
    peak = end.peak
    problem, chart = peak.problem, peak.problem.chart
    values = chart.to_values(peak.unbounded(problem.model_error)[None])[0]
    errors = chart.standard_errors(peak.z, end.covariance)
    away = values - [each.healthy for each in problem.unknowns]
    spread = np.sqrt(between_recordings(away[None], errors[None])).tolist()
    scatter = {
        each.name: x
        for each, x in zip(problem.unknowns, spread, strict=True)
        if each.role == "fault" and each.direction_of is None
    }
    return ClosedLoop(problem.relative_misfit(peak.cost), scatter)
