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

A slope knows nothing of the dips that impacts make in the misfit, in one of which a descent ends.
`expected_errors` therefore descends to each answer as `identify` does at its end, and takes for e_m
where that ends. It sets out `_AWAY` first-order errors from the true values, as a search comes from
elsewhere. (Those of the brushless twin make none any more, since they count from when they
happen.)
"""

from collections.abc import Mapping, Sequence

import numpy as np

from ematwin.estimation.aliases import held_by
from ematwin.estimation.baseline import Baseline, with_all_free
from ematwin.estimation.laplace import Laplace, inverse, standard_errors, width_at
from ematwin.estimation.levenberg_marquardt import LONGEST_DIFFERENCE, LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Alias
from ematwin.numerics.side_by_side import side_by_side
from ematwin.recordings.noise import Noise

STEP = LONGEST_DIFFERENCE  # of slopes, share of a range
_ANSWERS = 8  # whose mean square is known to a quarter
_AROUND = 0.01  # of its range, how far each fault lies from the point
_AWAY = 4.0  # first-order errors; set on 160 recordings with seeds from 20000 on
_ITERATIONS = 4
_DAMPING = 1e-2


def pulled(peak: Laplace, residuals: np.ndarray) -> np.ndarray:
    """Covariance (d, d) of the errors that residuals (M, K) at the true values pull to.

    To first order, in the coordinates of the chart of the peak's problem, whose Jacobian and noise
    count.
    """
    pulls = peak.covariance @ peak.jacobian @ residuals.T / peak.problem.noise**2
    return np.asarray(pulls @ pulls.T / len(residuals) + _known(peak))


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
    threads : that share the recordings; None takes one for each core
    """

    def aliases(named: Mapping[str, float]) -> Sequence[Alias]:
        return model.aliases(actuator, named)

    at = np.array([values.get(one.name, one.healthy) for one in problem.unknowns])
    peak = width_at(
        problem,
        at,
        aliases=aliases,
        least_noise=problem.noise,
        steps=np.full(len(at), STEP),
    )
    rng = np.random.default_rng([41, seed])
    faults = model.faults(actuator)
    shifts = rng.uniform(-1.0, 1.0, (_ANSWERS, len(faults)))

    def answer(n: int) -> tuple[Problem, np.ndarray, np.ndarray]:
        """A recording near the point, where the truth lies (d,), and what is left there (K,)."""
        near = {
            one.name: _near(values[one.name], one.lower, one.upper, shift)
            for one, shift in zip(faults, shifts[n].tolist(), strict=True)
        }
        recording = model.simulate(
            actuator, scenario, near, noise=noise, seed=seed + n, sample_rate=sample_rate
        )
        own = Problem.of(recording, actuator, threads=1)  # the answers share the cores
        full = with_all_free(model, actuator, own, baseline).with_noise(peak.problem.noise)
        point = np.array([[near.get(one.name, one.healthy) for one in full.unknowns]])
        return full, full.chart.from_values(point)[0], full.residuals(point)[0]

    def off(n: int) -> np.ndarray:
        """What is found of an answer less its truth (d,), from a start beside it."""
        full, truth, _ = answers[n]
        return _end(full, truth + starts[n], still) - truth

    answers = side_by_side(answer, range(_ANSWERS), threads)
    away = _AWAY * _alone(peak, np.array([left for *_, left in answers]), len(faults))
    still = held_by(problem, at, aliases)
    starts = rng.standard_normal((_ANSWERS, len(away))) * away
    errors = np.array(side_by_side(off, range(_ANSWERS), threads))
    covariance = errors.T @ errors / _ANSWERS + _known(peak)
    return standard_errors(problem.chart, peak.z, covariance)


def _known(peak: Laplace) -> np.ndarray:
    """The share (d, d) of what nobody knows exactly in the covariance of errors."""
    return np.asarray(peak.covariance @ peak.priors @ peak.covariance)


def _alone(peak: Laplace, residuals: np.ndarray, own: int) -> np.ndarray:
    """First-order errors (d,) of the faults, the first ``own``, as if all else were known."""
    kept = slice(own)
    covariance = inverse(peak.data[kept, kept] + peak.priors[kept, kept])
    pulls = covariance @ peak.jacobian[kept] @ residuals.T / peak.problem.noise**2
    errors = np.zeros(len(peak.z))
    errors[kept] = np.sqrt(np.mean(pulls**2, axis=1))
    return errors


def _end(problem: Problem, start: np.ndarray, still: set[str]) -> np.ndarray:
    """Where a descent from ``start`` ends, both (d,) in the chart; some unknowns stay."""
    chart = problem.chart
    z = chart.project(start[None])
    stays = np.array([name in still for name in problem.names])
    lower, upper = np.where(stays, z[0], chart.lower), np.where(stays, z[0], chart.upper)

    def residuals(points: np.ndarray) -> np.ndarray:
        return problem.residuals(chart.to_values(points))

    descent = LevenbergMarquardt.start(z, residuals, _DAMPING)
    for _ in range(_ITERATIONS):
        descent.iterate(residuals, lower, upper, chart.project)
    return np.asarray(chart.project(descent.points)[0])


def _near(value: float, lower: float, upper: float, share: float) -> float:
    """A value near another one, within bounds."""
    return float(np.clip(value + share * _AROUND * (upper - lower), lower, upper))
