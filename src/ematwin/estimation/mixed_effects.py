"""Which faults a recording shows, where recordings of a healthy actuator differ by themselves.

Beforehand an actuator is healthy or has one fault, rarely two, each as likely as the others and as
far from healthy as its range allows (a spike and a slab: Mitchell and Beauchamp 1988, J. Am. Stat.
Assoc. 83, 1023-1032). Each such set of faults is fitted with all that differs between healthy
recordings free (`random_effects`), and its evidence says how probable it is (MacKay 1992). The
probability of a fault is the sum over all sets with it; its value and interval are averages over
these sets, weighed by their probabilities.

Several recordings of one state of the actuator are judged together: the faults are shared, all else
is each recording's own.
"""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.constants import BEFOREHAND, IMPLAUSIBLE, WORSE, WORST
from ematwin.estimation.findings import implausible, unexplained, verdict_on
from ematwin.estimation.free_unknowns import unknowns_of
from ematwin.estimation.identification import Identification
from ematwin.estimation.identify import Prepared, estimate_of
from ematwin.estimation.intervals import Interval, deviations, physical_of
from ematwin.estimation.prior import coordinate
from ematwin.estimation.problem import Problem
from ematwin.estimation.random_effects import Normals, Peak, effects_of, fit
from ematwin.estimation.spike_and_slab import FaultSet, FaultSets
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.models.unknown import Unknown
from ematwin.recordings.read import assumptions

_SECOND = 0.1  # probability that a faulty actuator has a second fault
_SLAB = 2.0  # standard deviations of the slab from healthy to the far end of a range
_SCANNED = 9  # values of a fault at which a descent may start
_DRAWS, _SEED = 2000, 20_201


def assessed_sets(
    comparisons: Sequence[Comparison],
    faults: Sequence[Unknown],
    effects: Normals,
    held: Mapping[str, float],
) -> tuple[FaultSets, Peak, int]:
    """The posterior of sets of faults, the peak of the best one, and the simulations it took."""
    slabs = {one.name: _slab(one) for one in faults}
    count = len(comparisons)
    rest = np.tile(effects.mean, (count, 1))

    def peak_of(names: Iterable[str], z: np.ndarray, each: np.ndarray) -> Peak:
        chosen = [slabs[name] for name in names]
        shared = Normals(
            tuple(one for slab in chosen for one in slab.unknowns),
            np.array([float(slab.mean[0]) for slab in chosen]),
            np.array([float(slab.spread[0]) for slab in chosen]),
        )
        return fit(comparisons, shared, effects, start=(z, each), held=held)

    peaks: dict[tuple[str, ...], Peak] = {(): peak_of((), np.zeros(0), rest)}
    for name, slab in slabs.items():
        at = _scanned(comparisons, slab, effects, held)
        peaks[(name,)] = peak_of((name,), np.array([at]), peaks[()].each)
    lead = max((names for names in peaks if names), key=lambda names: -_left(peaks[names]))
    # from where a fault led it, a descent without that fault may end lower
    again = peak_of((), np.zeros(0), peaks[lead].each)
    peaks[()] = min(peaks[()], again, key=_left)
    # a second fault only beside a first one that explains more than its prior takes
    noises = peaks[lead].noises
    if _evidence(peaks[lead], noises, len(slabs)) > _evidence(peaks[()], noises, len(slabs)):
        for other in (name for name in slabs if name not in lead):
            z = np.r_[peaks[lead].z, slabs[other].mean]
            peaks[(*lead, other)] = peak_of((*lead, other), z, peaks[lead].each)
    # one noise for all sets, that of the best fit: else evidence would not compare
    noises = min(peaks.values(), key=_left).noises
    logs = {names: _evidence(peak, noises, len(slabs)) for names, peak in peaks.items()}
    most = max(logs.values())
    weights = {names: math.exp(log - most) for names, log in logs.items()}
    total = sum(weights.values())
    sets = [
        FaultSet(frozenset(names), weight / total, _drawn(faults, names, peaks[names], noises))
        for names, weight in weights.items()
    ]
    sets.sort(key=lambda one: -one.probability)
    best = max(weights, key=lambda names: weights[names])
    spent = sum(peak.evaluations for peak in peaks.values())
    return FaultSets(tuple(faults), tuple(sets)), peaks[best], spent


def _drawn(
    faults: Sequence[Unknown], names: Sequence[str], peak: Peak, noises: np.ndarray
) -> np.ndarray:
    """Draws (N, f) of all faults around the peak of a set; those that are not in it are healthy."""
    rng = np.random.default_rng(_SEED)
    found = np.tile([one.healthy for one in faults], (_DRAWS, 1))
    covariance = peak.weighed(noises)[1]
    away = rng.standard_normal((_DRAWS, len(names))) @ np.linalg.cholesky(covariance).T
    places = [[one.name for one in faults].index(name) for name in names]
    values = peak.shared.candidates(peak.z + away)
    for place, name in zip(places, names, strict=True):
        found[:, place] = values[name]
    return found


def _left(peak: Peak) -> float:
    """Mean square of the residuals of all recordings."""
    return float(np.mean(peak.misfits**2))


def _evidence(peak: Peak, noises: np.ndarray, count: int) -> float:
    """Logarithm of the probability of a set among ``count`` faults, but for a constant."""
    return peak.weighed(noises)[0] + math.log(_beforehand(len(peak.z), count))


def _slab(one: Unknown) -> Normals:
    """Where a fault lies if it is there: a normal distribution whose middle holds its range."""
    ends = coordinate(one, np.array([one.lower, one.upper]))
    mean = coordinate(one, np.array([one.healthy]))
    return Normals((one,), mean, np.array([np.abs(ends - mean).max() / _SLAB]))


def _beforehand(size: int, count: int) -> float:
    """Probability of one set of this size among ``count`` faults."""
    if size == 0:
        return BEFOREHAND
    share = (1.0 - BEFOREHAND) * (_SECOND if size == 2 else 1.0 - _SECOND)
    return share / math.comb(count, size)


def _scanned(
    comparisons: Sequence[Comparison], slab: Normals, effects: Normals, held: Mapping[str, float]
) -> float:
    """The coordinate of a fault alone at which the misfit is least."""
    one = slab.unknowns[0]
    low, high = coordinate(one, np.array([one.lower, one.upper]))
    z = np.r_[slab.mean, np.linspace(low, high, _SCANNED)]
    values = {name: np.full(len(z), value) for name, value in held.items()}
    values |= effects.candidates(np.tile(effects.mean, (len(z), 1))) | slab.candidates(z[:, None])
    costs = np.sum([c.costs(values, len(z)) for c in comparisons], axis=0)
    return float(z[int(np.argmin(costs))])


def identified_by_sets(
    ready: Sequence[Prepared],
    actuator: ParameterSet,
    baseline: Baseline,
    *,
    only: Iterable[str] | None = None,
    held: Mapping[str, float] | Any | None = None,
) -> Identification:
    """Identify the faults of an actuator from several recordings of one state.

    Parameters
    ----------
    ready : prepared recordings
    actuator, baseline : as calibrated, or as its file says
    only, held : faults that are looked for, and values of others; as in `ematwin.identify`

    Raises
    ------
    InputError
        If no fault is left, or something is named that is none.
    """
    model = model_of(actuator)
    started = time.perf_counter()
    free, fixed = unknowns_of(model, actuator, only, held)
    faults = [one for one in free if one.role == "fault"]
    others = [one.name for one in free if one.role == "nominal"]
    if not faults or others:
        raise InputError(
            f"The kind {model.kind} is judged by its faults, with all parameters free beside them; "
            f"received {', '.join(others) or 'no fault'} to search. Name faults, or an algorithm."
        )
    effects = effects_of(model, actuator, baseline)
    kept = [n for n, name in enumerate(effects.names) if name not in fixed]
    effects = Normals(
        tuple(effects.unknowns[n] for n in kept), effects.mean[kept], effects.spread[kept]
    )
    comparisons = [model.compare(one.recording, actuator) for one in ready]
    sets, peak, spent = assessed_sets(comparisons, faults, effects, fixed)
    values, intervals, errors = {}, {}, []
    for one in faults:
        drawn = sets.given(one.name)
        values[one.name] = float(drawn.of(one.name).mean())
        intervals[one.name] = Interval(*drawn.interval(one.name, one.lower, one.upper))
        errors.append(deviations(one, drawn.of(one.name), values[one.name]).std())
    physical = {
        one.name: physical_of(one, actuator, values[one.name], intervals[one.name])
        for one in faults
    }
    obstacles = list(
        dict.fromkeys(
            text
            for one in ready
            for text in (*one.barred, *model.excitation(one.recording, actuator))
        )
    )
    obstacles += _obstacles(peak, baseline, comparisons)
    verdict = verdict_on(
        model, actuator, faults, sets, intervals, physical, calibrated=baseline.calibrated,
        obstacles=obstacles,
    )  # fmt: skip
    cost = float(sum(one.residuals @ one.residuals for one in peak.curvatures))
    misfit = math.sqrt(cost / sum(one.scale for one in comparisons))
    first = ready[0].recording
    problem = Problem(comparisons[:1], faults, held=fixed)
    point = np.array([values[name] for name in problem.names])
    fitted = effects.candidates(peak.each.mean(axis=0)[None])
    return Identification(
        verdict=verdict,
        estimate=estimate_of(
            model, actuator, problem, point, np.diag(np.square(errors)), misfit, first
        ),
        faults=model.as_faults(problem.values(point)),
        cost=cost,
        evaluations=spent,
        seconds=time.perf_counter() - started,
        history=np.array([[spent, cost]]),
        algorithm="sets of faults",
        seed=0,
        stopped="all sets compared",
        searched=problem.names,
        warnings=[text for one in ready for text in one.warnings],
        assumed=assumptions(first),
        actuator=actuator,
        provenance=first.provenance,
        intervals={name: (one.low, one.high) for name, one in intervals.items()},
        physical_values={name: (x, one.low, one.high) for name, (x, one) in physical.items()},
        fitted={name: float(values[0]) for name, values in fitted.items()},
        calibrated=baseline.calibrated,
        recording=first,
        probabilities=sets.probabilities,
    )  # fmt: skip


def _obstacles(peak: Peak, baseline: Baseline, comparisons: Sequence[Comparison]) -> list[str]:
    """Sentences on what of a fit forbids a verdict."""
    told = []
    left = float(np.max(peak.misfits * [one.expected_misfit for one in comparisons]))
    most = WORSE * baseline.misfit if baseline.recordings else WORST
    if left > most:
        usual = f"the worst healthy one left {100.0 * baseline.misfit:.2g} %"
        if not baseline.recordings:
            usual = f"a good fit leaves less than {100.0 * most:.2g} %"
        told.append(unexplained(left, usual))
    if peak.own.names:
        away = np.abs(peak.each - peak.own.mean) / peak.own.spread
        n, k = (int(x) for x in np.unravel_index(np.argmax(away), away.shape))
        if away[n, k] > IMPLAUSIBLE:
            told.append(implausible(peak.own.names[k], float(away[n, k])))
    return told
