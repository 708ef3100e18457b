"""Random effects: parameters that differ from one recording of an actuator to the next.

Friction follows temperature and grease, a delay the bus: recordings of a healthy actuator differ by
more than their noise. Parameters of each recording come from a normal distribution around the
parameters of the actuator (Laird and Ware 1982, Biometrics 38, 963-974). Expectation and
maximisation estimates its mean and spread from healthy recordings. Unknowns shared by all
recordings, such as faults, are fitted beside them.

Healthy value and spread of an unknown are mean and standard deviation of this distribution, by the
value or its logarithm.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ematwin.estimation.baseline import Baseline, NominalParameter, nominal_parameters, uncertain
from ematwin.estimation.constants import TWO_SIGMA
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.prior import Prior, coordinate
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side

_SHARE, _DIFFERENCE = 0.3, 0.02  # of a spread, and of a logarithm: differences for slopes
_DRAWS = 300  # points of the first search
_ROUNDS = 12  # of expectation and maximisation
_STATED = 4.0  # recordings that the stated drift counts for


class Peak(NamedTuple):
    """The most probable point of some recordings."""

    problem: Problem  # each recording weighed by the noise that it shows
    point: np.ndarray  # (d,), values of shared unknowns, then of each recording's own
    misfits: np.ndarray  # (n,), root mean squares of residuals in the unit of the stated noise
    evaluations: int  # simulations

    @property
    def values(self) -> dict[str, float]:
        """Values of all unknowns by name."""
        return self.problem.values(self.point)

    def each(self, own: Sequence[Unknown]) -> np.ndarray:
        """(n, p) coordinates of what each recording has for itself."""
        count = len(self.problem.comparisons)
        pairs = zip(self.problem.unknowns, self.point.tolist(), strict=True)
        every = np.array([coordinate(one, value) for one, value in pairs], dtype=float)
        return every[every.size - count * len(own) :].reshape(count, len(own))

    def approximated(self) -> tuple[float, np.ndarray]:
        """Logarithm of the evidence, but for a constant, and covariance (d, d) of the coordinates.

        Laplace's approximation (MacKay 1992, Neural Computation 4, 415-447).
        """
        problem, chart, d = self.problem, self.problem.chart, len(self.point)
        spreads = np.sqrt(np.diag(problem.prior.covariance))
        log = np.array([one.logarithmic for one in problem.unknowns], dtype=bool)
        steps = np.where(log, _DIFFERENCE, _SHARE * spreads) / chart.widths
        z = chart.from_values(self.point[None])
        up, down = np.minimum(steps, chart.upper - z), np.minimum(steps, z - chart.lower)
        beside = np.vstack([z, z + np.eye(d) * up, z - np.eye(d) * down])
        left = problem.residuals(chart.to_values(beside)) / problem.noise
        slopes = (left[1 : d + 1] - left[d + 1 :]) / ((up + down)[0] * chart.widths)[:, None]
        precision = slopes @ slopes.T
        curvature = float(np.linalg.slogdet(precision)[1] + 2.0 * np.log(spreads).sum())
        return -0.5 * (float(left[0] @ left[0]) + curvature), np.linalg.inv(precision)


def fit(
    comparisons: Sequence[Comparison],
    shared: Sequence[Unknown],
    own: Sequence[Unknown],
    *,
    start: Mapping[str, float] | None = None,
    held: Mapping[str, float] | None = None,
) -> Peak:
    """Descend to the most probable point.

    Each recording has the noise that its residuals show. Those of a start count until the descent
    explains them: no jump to far minima. An error of the twin that leaves no residual pulls the
    parameters of each recording in another direction: it is part of their learnt spread.
    ``shared`` is what all recordings have in common, ``own`` what each has for itself; a ``start``
    is by name, ``name@n`` of the nth of several, healthy if not given.
    """
    problem = Problem(
        comparisons, [*shared, *own], held=held, own=[one.name for one in own], start=start
    )
    chart, spent = problem.chart, len(comparisons)
    z = chart.project(chart.from_values(problem.start[None]))
    left = [problem.residuals_of(n, chart.to_values(z))[0] for n in range(len(comparisons))]
    ends = np.cumsum([one.size for one in left])
    found = np.r_[*left, problem.prior_distances(chart.to_values(z))[0]]
    weights = np.ones(found.size)
    for _ in range(20 if problem.names else 0):  # at most, of noise and point in turn
        before, weights = weights, weights.copy()
        weights[: ends[-1]] = np.concatenate(
            [one.noise_weights(part) for one, part in zip(comparisons, left, strict=True)]
        )

        def residuals(z: np.ndarray, weights: np.ndarray = weights) -> np.ndarray:
            nonlocal spent
            spent += len(z) * len(comparisons)
            return weights * problem.residuals(chart.to_values(z))

        descent = LevenbergMarquardt.start(z, residuals, known=(weights * found)[None])
        cost = float(descent.costs[0])
        descent.iterate(residuals, chart.lower, chart.upper, chart.project)
        z, found = descent.points, descent.residuals[0] / weights
        left = np.split(found, ends)[:-1]
        gained = (cost - float(descent.costs[0])) / problem.noise**2
        if gained < 0.02 and np.all(np.abs(weights - before) < 0.1 * before):
            break
    parts = [one.reweighed(part) for one, part in zip(comparisons, left, strict=True)]
    misfits = np.array([math.sqrt(float(np.mean(one**2))) for one in left])
    return Peak(problem.with_comparisons(parts), chart.to_values(z)[0], misfits, spent)


def effects_of(model: Model, actuator: ParameterSet, baseline: Baseline) -> list[Unknown]:
    """Own parameters of a healthy actuator's recordings, with their distribution.

    Calibration learnt it; without calibration, tolerances and stated drifts give it.
    """
    if baseline.exact:
        return []
    if baseline.recordings:
        prior = baseline.prior
        unknowns = [model.unknown(actuator, name) for name in prior.names]
        return _distributed(unknowns, prior.mean, np.sqrt(np.diag(prior.covariance)))
    known = [*uncertain(model, actuator), *_nuisances(model, actuator)]
    return [replace(one, spread=math.hypot(one.spread or 0.0, _drift(actuator, one)))
            for one in known]  # fmt: skip


def _distributed(
    unknowns: Sequence[Unknown], mean: np.ndarray, spread: np.ndarray
) -> list[Unknown]:
    """Unknowns whose coordinates have this mean (d,) and spread (d,)."""
    values = [
        math.exp(x) if one.logarithmic else x
        for one, x in zip(unknowns, mean.tolist(), strict=True)
    ]
    return [
        replace(one, healthy=min(max(x, one.lower), one.upper), spread=s)
        for one, x, s in zip(unknowns, values, spread.tolist(), strict=True)
    ]


def learn_effects(
    model: Model,
    template: ParameterSet,
    comparisons: Sequence[Comparison],
    tell: Callable[[float], None] = lambda share: None,
) -> tuple[ParameterSet, Baseline, list[NominalParameter]]:
    """Mean and spread of the parameters of healthy recordings, as actuator and baseline."""
    nuisances, known = _nuisances(model, template), uncertain(model, template)
    unknowns = [*known, *nuisances]
    first = _first(comparisons, known, nuisances, tell)
    before = Prior.independent(unknowns)
    error = np.sqrt(np.diag(before.covariance))
    stated = np.array([_drift(template, one) for one in unknowns])
    # from above: a spread that begins too small stays so where recordings tell little of it
    spread = np.minimum(2.0 * stated, error)
    mean, count = np.r_[first, before.mean[len(known) :]], len(comparisons)
    starts: list[Mapping[str, float]] = [{}] * count
    for n in range(_ROUNDS):
        effects = _distributed(unknowns, mean, spread)
        each = side_by_side(partial(_alone, effects), list(zip(comparisons, starts, strict=True)))
        starts = [peak.values for peak, _ in each]
        points = np.array([peak.each(effects)[0] for peak, _ in each])
        unsure = np.array([covariance for _, covariance in each])
        variance = spread**2
        weight = count / variance
        mean = (weight * points.mean(axis=0) + before.mean / error**2) / (weight + error**-2.0)
        squares = np.sum((points - mean) ** 2 + np.diagonal(unsure, axis1=1, axis2=2), axis=0)
        spread = np.sqrt((squares + _STATED * stated**2) / (count + _STATED))
        tell(0.3 + 0.7 * (n + 1) / _ROUNDS)
    error = errors_of_mean(unsure, variance, error)
    values = {one.name: math.exp(x) for one, x in zip(known, mean.tolist(), strict=False)}
    expected = np.array([one.expected_misfit for one in comparisons])
    misfits = expected * [peak.misfits[0] for peak, _ in each]
    baseline = Baseline(
        Prior(before.names, mean, np.diag(spread**2 + error**2)),
        misfit=float(misfits.max()), expected_misfit=float(expected.max()), recordings=count,
    )  # fmt: skip
    parameters = nominal_parameters(template, known, Prior(before.names, mean, np.diag(error**2)))
    return template.changed(values), baseline, parameters


def errors_of_mean(unsure: np.ndarray, variance: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Standard errors (d,) of the mean of parameters that differ between recordings.

    A recording tells the mean with the precision ``(C + V)^-1`` (Laird and Ware 1982), where C is
    the covariance of its estimate and V, with the diagonal ``variance`` (d,), that between
    recordings; parameters that only their combination determines stay unknown. ``unsure`` (n, d, d)
    are ``(C^-1 + V^-1)^-1``, ``prior`` (d,) standard deviations of the mean before.
    """
    told = np.sum(np.diag(1.0 / variance) - unsure / np.outer(variance, variance), axis=0)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(told + np.diag(prior**-2.0)))))


def _alone(
    effects: Sequence[Unknown], one: tuple[Comparison, Mapping[str, float]]
) -> tuple[Peak, np.ndarray]:
    """The peak of a single recording next to a start, and the covariance (d, d) there."""
    peak = fit([one[0]], [], effects, start=one[1])
    return peak, peak.approximated()[1]


def _first(
    comparisons: Sequence[Comparison],
    known: Sequence[Unknown],
    nuisances: Sequence[Unknown],
    tell: Callable[[float], None],
) -> np.ndarray:
    """Coordinates (d,) at which one set of parameters explains all recordings best."""
    chosen = np.unique(np.linspace(0, len(comparisons) - 1, 6).astype(int))
    some = [comparisons[n] for n in chosen]
    rng = np.random.default_rng(1)
    prior = Prior.independent(known)
    draws = rng.standard_normal((_DRAWS, len(known))) @ np.sqrt(prior.covariance) + prior.mean
    draws[0] = prior.mean
    points = {
        one.name: np.clip(np.exp(x), one.lower, one.upper)
        for one, x in zip(known, draws.T, strict=True)
    }
    costs = np.sum([one.costs(points, _DRAWS) for one in some], axis=0)
    starts = [
        {name: float(x[n]) for name, x in points.items()}
        for n in np.unique(np.r_[0, np.argsort(costs)[:3]])
    ]
    peaks = side_by_side(lambda start: fit(some, known, nuisances, start=start), starts)
    tell(0.2)
    best = min(peaks, key=lambda one: float(np.sum(one.misfits**2))).values
    best = {one.name: best[one.name] for one in known}
    found = fit(comparisons, known, nuisances, start=best).values
    return np.array([math.log(found[one.name]) for one in known])


def _nuisances(model: Model, actuator: ParameterSet) -> list[Unknown]:
    every = model.unknowns(actuator)
    return [one for one in every if one.role == "nuisance" and one.spread is not None]


def _drift(actuator: ParameterSet, one: Unknown) -> float:
    """How far an unknown is stated to differ between recordings, a standard deviation."""
    if "." not in one.name:
        assert one.spread is not None
        return one.spread
    stated = actuator.drift(one.name)
    return 0.002 if stated is None else math.log1p(stated) / TWO_SIGMA
