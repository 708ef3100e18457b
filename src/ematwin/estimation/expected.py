"""The error that is to be expected of a command, fault by fault.

The standard error of an estimate is widened by one factor for all that a twin gets wrong
(`Model.model_error`). How far an actual error will be off differs from fault to fault: what a twin
misses pulls at the gap and the gain, and hardly at a short. The kind's finest model shows it. With
r its answer less that of the twin at the same values, noise included, J the Jacobian and sigma the
noise of an independent residual, and P what is known beforehand,

    e = -C J r/sigma^2,   C = (J J^T/sigma^2 + P)^-1,   cov = 1/M sum_m e_m e_m^T + C P C

the first-order bias of a least squares estimate (Box and Draper 1959, J. Am. Stat. Assoc. 54,
622-654) over M answers, for what is missed changes from one impact to the next; C P C is the share
of what nobody knows exactly. Slopes are taken over the steps with which a descent looks; over
shorter ones the roughness that impacts make counts as information, and errors of gap and gain come
out half as large. Where a kind has no finer model than its twin, r is noise alone.
"""

from collections.abc import Mapping

import numpy as np

from ematwin.estimation.baseline import Baseline, with_all_free
from ematwin.estimation.laplace import Laplace, standard_errors, width_at
from ematwin.estimation.levenberg_marquardt import LONGEST_DIFFERENCE
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario
from ematwin.recordings.noise import Noise

STEP = LONGEST_DIFFERENCE  # of slopes, share of a range
_ANSWERS = 8  # whose mean square is known to a quarter
_AROUND = 0.01  # of its range, how far each fault lies from the point


def pulled(peak: Laplace, residuals: np.ndarray) -> np.ndarray:
    """Covariance (d, d) of the errors that residuals (M, K) at the true values pull to.

    In the coordinates of the chart of the peak's problem, whose Jacobian and noise count.
    """
    pulls = peak.covariance @ peak.jacobian @ residuals.T / peak.problem.noise**2
    known = peak.covariance @ peak.priors @ peak.covariance
    return np.asarray(pulls @ pulls.T / len(residuals) + known)


def expected_errors(
    model: Model,
    actuator: ParameterSet,
    scenario: Scenario,
    values: Mapping[str, float],
    baseline: Baseline,
    problem: Problem,
    *,
    noise: Noise | None,
    sample_rate: float | None,
    seed: int,
    threads: int | None = None,
) -> np.ndarray:
    """Root mean square errors (d,) of all that is free, in values.

    Parameters
    ----------
    model, actuator, baseline : of the twin, and what is known of it
    scenario, noise, sample_rate : of the recordings
    values : of the faults, by name
    problem : a recording there, with all that is unknown, and its noise
    seed : of the first recording; the others follow
    threads : that share a batch
    """
    at = np.array([values.get(one.name, one.healthy) for one in problem.unknowns])
    peak = width_at(
        problem,
        at,
        aliases=lambda named: model.aliases(actuator, named),
        least_noise=problem.noise,
        steps=np.full(len(at), STEP),
    )
    rng = np.random.default_rng([41, seed])
    errors = []
    for n in range(_ANSWERS):
        near = {
            one.name: _near(values[one.name], one.lower, one.upper, rng.uniform(-1.0, 1.0))
            for one in model.faults(actuator)
        }
        recording = model.simulate(
            actuator, scenario, near, noise=noise, seed=seed + n, sample_rate=sample_rate
        )
        own = Problem.of(recording, actuator, threads=threads)
        full = with_all_free(model, actuator, own, baseline).with_noise(peak.problem.noise)
        point = np.array([near.get(one.name, one.healthy) for one in full.unknowns])
        errors.append(full.residuals(point[None])[0])
    return standard_errors(problem.chart, peak.z, pulled(peak, np.array(errors)))


def _near(value: float, lower: float, upper: float, share: float) -> float:
    """A value near another one, within bounds."""
    return float(np.clip(value + share * _AROUND * (upper - lower), lower, upper))
