"""Random effects: parameters that differ from one recording of an actuator to the next.

Friction follows temperature and grease, a delay the bus: recordings of a healthy actuator differ by
more than their noise. Parameters of each recording come from a normal distribution around the
parameters of the actuator (Laird and Ware 1982, Biometrics 38, 963-974). Expectation and
maximisation estimates its mean and spread from healthy recordings. Unknowns shared by all
recordings, such as faults, are fitted beside them; the recordings' own parameters are eliminated
block by block.

All is normal in coordinates: the value of an unknown, or its logarithm.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Self

import numpy as np

from ematwin.estimation.baseline import Baseline, NominalParameter, uncertain
from ematwin.estimation.constants import DETERMINED, TWO_SIGMA
from ematwin.estimation.prior import Prior, coordinate
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison, correlation_time
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side

_ITERATIONS = 20
_GAIN = 0.02  # squared standard deviations: a step that gains less ends a descent
_SETTLED = 0.1  # share by which the noise of a recording may change at the end
_LONGEST = 0.7  # of a step in a logarithm
_SHARE, _DIFFERENCE = 0.3, 0.02  # of a spread, and of a logarithm: differences for slopes
_DAMPINGS = (0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0)
_DRAWS, _SEARCHED, _STARTS = 300, 6, 3  # points, recordings and best points of the first search
_ROUNDS = 12  # of expectation and maximisation
_STATED = 4.0  # recordings that the stated drift counts for
_LITTLE = 0.002  # in a logarithm, of what is stated not to drift
_SEED = 1


@dataclass(frozen=True)
class Normals:
    """Unknowns with independent normal distributions of their coordinates.

    Parameters
    ----------
    unknowns : (d,)
    mean, spread : (d,) arrays
    """

    unknowns: tuple[Unknown, ...]
    mean: np.ndarray
    spread: np.ndarray

    @classmethod
    def of(cls, unknowns: Sequence[Unknown]) -> Self:
        """From healthy values and spreads."""
        healthy = np.array([one.healthy for one in unknowns], dtype=float)
        given = tuple(unknowns)
        return cls(
            given, coordinates(given, healthy), np.array([one.spread for one in given], dtype=float)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(one.name for one in self.unknowns)

    @property
    def differences(self) -> np.ndarray:
        """(d,) steps over which slopes are taken."""
        log = np.array([one.logarithmic for one in self.unknowns], dtype=bool)
        return np.where(log, _DIFFERENCE, _SHARE * self.spread)

    def candidates(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Values (B,) by name of coordinates (B, d), within bounds."""
        return {
            one.name: np.clip(np.exp(x) if one.logarithmic else x, one.lower, one.upper)
            for one, x in zip(self.unknowns, z.T, strict=True)
        }


def coordinates(unknowns: Sequence[Unknown], values: np.ndarray) -> np.ndarray:
    """Coordinates (d,) of values (d,)."""
    return np.array([coordinate(one, x) for one, x in zip(unknowns, values, strict=True)])


class Curvature(NamedTuple):
    """Curvature of a recording's cost near a point, in the unit of its residuals.

    Attributes
    ----------
    shared : (f, f), ``across`` (f, p) and ``own`` (p, p): products of slopes
    residuals : (K,)
    """

    shared: np.ndarray
    across: np.ndarray
    own: np.ndarray
    residuals: np.ndarray

    def noise(self, least: float) -> float:
        """Standard deviation of an independent residual; samples that are alike count once."""
        left = self.residuals
        return max(least, math.sqrt(float(np.mean(left**2)) * correlation_time(left)))


@dataclass(frozen=True)
class Peak:
    """The most probable point of some recordings.

    Attributes
    ----------
    shared, own : Normals, the distributions from before
    z : (f,) array, coordinates of the shared unknowns
    each : (n, p) array, coordinates of what each recording has for itself
    curvatures : (n,), one for each recording
    noises : (n,) array, by which residuals were divided
    evaluations : int, simulations
    """

    shared: Normals
    own: Normals
    z: np.ndarray
    each: np.ndarray
    curvatures: tuple[Curvature, ...]
    noises: np.ndarray
    evaluations: int

    @property
    def misfits(self) -> np.ndarray:
        """(n,) root mean squares of the residuals."""
        return np.array([math.sqrt(float(np.mean(one.residuals**2))) for one in self.curvatures])

    def weighed(self, noises: np.ndarray) -> "tuple[float, np.ndarray]":
        """Logarithm of the evidence, but for a constant, and shared covariance (f, f).

        Laplace's approximation (MacKay 1992, Neural Computation 4, 415-447), with the noises (n,)
        given, so that evidence compares.
        """
        precision = np.diag(self.shared.spread**-2.0)
        height = -0.5 * float(np.sum(((self.z - self.shared.mean) / self.shared.spread) ** 2))
        for one, each, noise in zip(self.curvatures, self.each, noises, strict=True):
            away = (each - self.own.mean) / self.own.spread
            height -= 0.5 * float(one.residuals @ one.residuals / noise**2 + away @ away)
            block = one.own / noise**2 + np.diag(self.own.spread**-2.0)
            height -= 0.5 * float(np.linalg.slogdet(block)[1])
            across = one.across / noise**2
            precision += one.shared / noise**2 - across @ np.linalg.solve(block, across.T)
        height -= 0.5 * float(np.linalg.slogdet(precision)[1])
        height -= float(np.sum(np.log(self.shared.spread)))
        return height, np.linalg.inv(precision)

    def own_covariances(self) -> np.ndarray:
        """(n, p, p) covariances of what each recording has for itself, where nothing is shared."""
        told = [one.own / s**2 for one, s in zip(self.curvatures, self.noises, strict=True)]
        return np.linalg.inv(np.array(told) + np.diag(self.own.spread**-2.0))


def fit(
    comparisons: Sequence[Comparison],
    shared: Normals,
    own: Normals,
    *,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    held: Mapping[str, float] | None = None,
) -> Peak:
    """Descend to the most probable point by Levenberg and Marquardt's method.

    Parameters
    ----------
    comparisons : (n,)
    shared, own : what all recordings have in common, and what each has for itself
    start : coordinates (f,) and (n, p) to start from; the means if not given
    held : values of other unknowns, by name
    """
    f, count = len(shared.mean), len(comparisons)
    low, high = (
        coordinates(shared.unknowns, np.array([getattr(one, end) for one in shared.unknowns]))
        if f else np.zeros(0) for end in ("lower", "upper")
    )  # fmt: skip
    z, each = start or (shared.mean.copy(), np.tile(own.mean, (count, 1)))
    z, each = np.clip(z, low, high), each.copy()
    least = comparisons[0].model_error

    def residuals(n: int, points: np.ndarray) -> np.ndarray:
        values = {name: np.full(len(points), value) for name, value in (held or {}).items()}
        values |= shared.candidates(points[:, :f]) | own.candidates(points[:, f:])
        return comparisons[n].residuals(values, len(points))

    steps = np.r_[shared.differences, own.differences]

    def looked_at(n: int) -> tuple[Curvature, np.ndarray]:
        here = np.r_[z, each[n]]
        points = np.concatenate([here[None], here + np.diag(steps), here - np.diag(steps)])
        found = residuals(n, points)
        d = len(here)
        slopes = (found[1 : d + 1] - found[d + 1 :]) / (2.0 * steps[:, None])
        square = slopes @ slopes.T
        return (
            Curvature(square[:f, :f], square[:f, f:], square[f:, f:], found[0]), slopes @ found[0]
        )  # fmt: skip

    def height(z: np.ndarray, each: np.ndarray, left: Sequence[np.ndarray]) -> float:
        """Cost of a point: squared standard deviations of data and distributions."""
        found = np.sum(((z - shared.mean) / shared.spread) ** 2)
        found += np.sum(((each - own.mean) / own.spread) ** 2)
        return float(found + sum(r @ r / s**2 for r, s in zip(left, noises, strict=True)))

    spent = 0
    noises = np.full(count, least)
    for _ in range(_ITERATIONS):
        spent += count * (2 * len(steps) + 2)
        seen = [looked_at(n) for n in range(count)]
        # what a start leaves counts as noise until the descent explains it: no jump to far minima
        before, noises = noises, np.array([one.noise(least) for one, _ in seen])
        cost = height(z, each, [one.residuals for one, _ in seen])
        there = z, each
        after = cost
        for damping in _DAMPINGS:
            dz, moved = _step(seen, noises, z, each, shared, own, damping)
            there = np.clip(z + dz, low, high), each + moved
            left = [residuals(n, np.r_[there[0], there[1][n]][None])[0] for n in range(count)]
            after = height(*there, left)
            if after < cost:
                break
        if after < cost:
            z, each = there
        settled = np.all(np.abs(noises - before) < _SETTLED * before)
        if cost - after < _GAIN and settled:
            break
    curvatures = tuple(looked_at(n)[0] for n in range(count))
    noises = np.array([one.noise(least) for one in curvatures])
    return Peak(shared, own, z, each, curvatures, noises, spent)


def _step(
    seen: Sequence[tuple[Curvature, np.ndarray]],
    noises: np.ndarray,
    z: np.ndarray,
    each: np.ndarray,
    shared: Normals,
    own: Normals,
    damping: float,
) -> tuple[np.ndarray, np.ndarray]:
    """A damped step of the shared unknowns (f,) and of each recording (n, p)."""
    f = len(z)
    square = np.diag(shared.spread**-2.0)
    slope = (z - shared.mean) / shared.spread**2
    blocks = []
    for (one, slopes), noise, here in zip(seen, noises, each, strict=True):
        block = one.own / noise**2 + np.diag(own.spread**-2.0)
        block += damping * np.diag(np.diag(block))
        across = one.across / noise**2
        own_slope = slopes[f:] / noise**2 + (here - own.mean) / own.spread**2
        back = np.linalg.solve(block, np.c_[across.T, own_slope])
        square = square + one.shared / noise**2 - across @ back[:, :f]
        slope = slope + slopes[:f] / noise**2 - across @ back[:, f]
        blocks.append(back)
    square += damping * np.diag(np.diag(square))
    dz = np.clip(-np.linalg.solve(square, slope), -_LONGEST, _LONGEST)
    moved = [np.clip(-back[:, f] - back[:, :f] @ dz, -_LONGEST, _LONGEST) for back in blocks]
    return dz, np.array(moved)


def effects_of(model: Model, actuator: ParameterSet, baseline: Baseline) -> Normals:
    """Distribution of the own parameters of a healthy actuator's recordings.

    Calibration learnt it; without calibration, tolerances and stated drifts give it.
    """
    if baseline.exact:
        return Normals.of(())
    if baseline.recordings:
        prior = baseline.prior
        unknowns = tuple(model.unknown(actuator, name) for name in prior.names)
        return Normals(unknowns, prior.mean, np.sqrt(np.diag(prior.covariance)))
    known = Normals.of([*uncertain(model, actuator), *_nuisances(model, actuator)])
    drifts = np.array([_drift(actuator, one) for one in known.unknowns])
    return Normals(known.unknowns, known.mean, np.hypot(known.spread, drifts))


class LearntEffects(NamedTuple):
    """An actuator as learnt from healthy recordings: values, baseline, parameters."""

    actuator: ParameterSet
    baseline: Baseline
    parameters: list[NominalParameter]


def learn_effects(
    model: Model,
    template: ParameterSet,
    comparisons: Sequence[Comparison],
    tell: Callable[[float], None] = lambda share: None,
) -> LearntEffects:
    """Mean and spread of the parameters of healthy recordings."""
    nuisances = Normals.of(_nuisances(model, template))
    known = Normals.of(uncertain(model, template))
    first = _first(comparisons, known, nuisances, tell)
    unknowns = (*known.unknowns, *nuisances.unknowns)
    before = np.r_[known.mean, nuisances.mean], np.r_[known.spread, nuisances.spread]
    stated = np.array([_drift(template, one) for one in unknowns])
    # from above: a spread that begins too small stays so where recordings tell little of it
    effects = Normals(unknowns, np.r_[first, nuisances.mean], np.minimum(2.0 * stated, before[1]))
    count = len(comparisons)
    for n in range(_ROUNDS):
        each = side_by_side(partial(_alone, effects), comparisons)
        points = np.array([one.each[0] for one in each])
        unsure = np.array([one.own_covariances()[0] for one in each])
        variance = effects.spread**2
        weight = count / variance
        mean = (weight * points.mean(axis=0) + before[0] / before[1] ** 2) / (
            weight + before[1] ** -2.0
        )
        squares = np.sum((points - mean) ** 2 + np.diagonal(unsure, axis1=1, axis2=2), axis=0)
        spread = np.sqrt((squares + _STATED * stated**2) / (count + _STATED))
        effects = Normals(unknowns, mean, spread)
        tell(0.3 + 0.7 * (n + 1) / _ROUNDS)
    error = errors_of_mean(unsure, variance, before[1])
    places = known.names
    values = dict(zip(places, np.exp(effects.mean[: len(places)]).tolist(), strict=True))
    covariance = np.diag(effects.spread**2 + error**2)
    expected = np.array([one.expected_misfit for one in comparisons])
    misfits = expected * [one.misfits[0] for one in each]
    baseline = Baseline(
        Prior(effects.names, effects.mean, covariance),
        misfit=float(misfits.max()), expected_misfit=float(expected.max()), recordings=count,
    )  # fmt: skip
    parameters = [
        NominalParameter(
            place, values[place], template.value(place), float(e * values[place]),
            bool(e < DETERMINED * spread),
        )
        for place, e, spread in zip(places, error, known.spread, strict=False)
    ]  # fmt: skip
    return LearntEffects(template.changed(values), baseline, parameters)


def errors_of_mean(unsure: np.ndarray, variance: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Standard errors (d,) of the mean of parameters that differ between recordings.

    A recording tells the mean with the precision ``(C + V)^-1`` (Laird and Ware 1982), where C is
    the covariance of its estimate and V the variance between recordings; parameters that only their
    combination determines stay unknown, however many recordings there are.

    Parameters
    ----------
    unsure : (n, d, d), covariances of each recording's parameters, ``(C^-1 + V^-1)^-1``
    variance : (d,), diagonal of V
    prior : (d,), standard deviations of the mean before
    """
    told = np.sum(np.diag(1.0 / variance) - unsure / np.outer(variance, variance), axis=0)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(told + np.diag(prior**-2.0)))))


def _alone(effects: Normals, comparison: Comparison) -> Peak:
    """The peak of a single recording with all parameters free."""
    return fit([comparison], Normals.of(()), effects)


def _first(
    comparisons: Sequence[Comparison],
    known: Normals,
    nuisances: Normals,
    tell: Callable[[float], None],
) -> np.ndarray:
    """Coordinates (d,) at which one set of parameters explains all recordings best."""
    chosen = np.unique(np.linspace(0, len(comparisons) - 1, _SEARCHED).astype(int))
    some = [comparisons[n] for n in chosen]
    rng = np.random.default_rng(_SEED)
    draws = known.mean + known.spread * rng.standard_normal((_DRAWS, len(known.mean)))
    draws[0] = known.mean
    costs = np.sum([one.costs(known.candidates(draws), _DRAWS) for one in some], axis=0)
    starts = draws[np.unique(np.r_[0, np.argsort(costs)[:_STARTS]])]
    rest = np.tile(nuisances.mean, (len(some), 1))
    peaks = side_by_side(lambda z: fit(some, known, nuisances, start=(z, rest)), starts)
    tell(0.2)
    best = min(peaks, key=lambda one: float(np.sum(one.misfits**2)))
    rest = np.tile(nuisances.mean, (len(comparisons), 1))
    return fit(comparisons, known, nuisances, start=(best.z, rest)).z


def _nuisances(model: Model, actuator: ParameterSet) -> list[Unknown]:
    """Nuisances with a spread."""
    return [
        one for one in model.unknowns(actuator) if one.role == "nuisance" and one.spread is not None
    ]


def _drift(actuator: ParameterSet, one: Unknown) -> float:
    """How far an unknown is stated to differ between recordings, a standard deviation."""
    if "." not in one.name:
        assert one.spread is not None
        return one.spread
    stated = actuator.drift(one.name)
    return _LITTLE if stated is None else math.log1p(stated) / TWO_SIGMA
