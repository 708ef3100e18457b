"""Which faults a recording shows, where recordings of a healthy actuator differ by themselves.

Beforehand an actuator is healthy or has one fault, rarely two, each as likely as the others and as
far from healthy as its range allows (a spike and a slab: Mitchell and Beauchamp 1988, J. Am. Stat.
Assoc. 83, 1023-1032). Each such set of faults is fitted with all that differs between healthy
recordings free (`random_effects`), and its evidence says how probable it is (MacKay 1992). The
probability of a fault is that of all sets with it; its value and interval are those of the sets
with it, weighed so.

Several recordings of one state of the actuator are judged together: the faults are shared, all else
is each recording's own.
"""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.constants import (
    BEFOREHAND,
    CERTAIN,
    COVERAGE,
    IMPLAUSIBLE,
    SMALLEST,
    TELLING,
    WORSE,
)
from ematwin.estimation.findings import range_of, size_of
from ematwin.estimation.identification import Identification
from ematwin.estimation.identify import Prepared, estimate_of
from ematwin.estimation.intervals import Interval, mean_slope
from ematwin.estimation.prior import coordinate
from ematwin.estimation.problem import Problem, unknowns_of
from ematwin.estimation.random_effects import Normals, Peak, effects_of, fit
from ematwin.estimation.verdict import Verdict, faults_said, least_certain
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.models.unknown import Unknown
from ematwin.recordings.read import assumptions
from ematwin.showing.words import listed

_SECOND = 0.1  # probability that a faulty actuator has a second fault
_SLAB = 2.0  # standard deviations of the slab from healthy to the far end of a range
_SCANNED = 9  # values of a fault at which a descent may start


@dataclass(frozen=True)
class _Set:
    """A set of faults at its peak: log evidence, coordinates (f,) and covariance (f, f)."""

    names: tuple[str, ...]
    peak: Peak
    evidence: float
    covariance: np.ndarray


@dataclass(frozen=True)
class Assessed:
    """What is known of each fault.

    Attributes
    ----------
    faults : those that were looked for
    probability : by name, to be as far from healthy as matters
    healthy : float, probability that there is none
    faulty : float, probability that one is as far from healthy as matters
    values, errors, intervals : by name, if the fault is there; errors of coordinates
    best : the most probable set
    """

    faults: tuple[Unknown, ...]
    probability: dict[str, float]
    healthy: float
    faulty: float
    values: dict[str, float]
    errors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    best: _Set
    evaluations: int


def assessed_sets(
    comparisons: Sequence[Comparison],
    faults: Sequence[Unknown],
    effects: Normals,
    held: Mapping[str, float],
) -> Assessed:
    """The probability and the value of each fault."""
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
    sets = [
        _Set(names, peak, _evidence(peak, noises, len(slabs)), peak.weighed(noises)[1])
        for names, peak in peaks.items()
    ]
    sizes = np.array([one.evidence for one in sets])
    weights = np.exp(sizes - sizes.max())
    weights /= weights.sum()
    return _summed(sets, weights, faults)


def _left(peak: Peak) -> float:
    """Mean square of what is left of all recordings."""
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


def _summed(sets: Sequence[_Set], weights: np.ndarray, faults: Sequence[Unknown]) -> Assessed:
    """Probabilities, values and intervals over all sets."""
    probability, values, errors, intervals = {}, {}, {}, {}
    for one in faults:
        parts = [
            (weight, float(s.peak.z[n]), math.sqrt(float(s.covariance[n, n])))
            for s, weight in zip(sets, weights, strict=True)
            for n, name in enumerate(s.names)
            if name == one.name
        ]
        total = sum(part[0] for part in parts)
        share = [part[0] / total for part in parts]
        mean = sum(w * z for w, (_, z, _) in zip(share, parts, strict=True))
        variance = sum(
            w * (e**2 + (z - mean) ** 2) for w, (_, z, e) in zip(share, parts, strict=True)
        )
        error = math.sqrt(variance)
        ends = coordinate(one, np.array([one.lower, one.upper]))
        low, high = np.clip([mean - COVERAGE * error, mean + COVERAGE * error], *ends)
        back = math.exp if one.logarithmic else float
        values[one.name] = float(back(mean))
        errors[one.name] = error
        intervals[one.name] = (float(back(low)), float(back(high)))
        probability[one.name] = sum(weight * _matters(one, z, error) for weight, z, error in parts)
    known = {one.name: one for one in faults}
    faulty = 0.0
    for s, weight in zip(sets, weights, strict=True):
        errors_of = np.sqrt(np.diag(s.covariance))
        parts_of = zip(s.names, s.peak.z.tolist(), errors_of.tolist(), strict=True)
        faulty += weight * max((_matters(known[n], z, e) for n, z, e in parts_of), default=0.0)
    return Assessed(
        tuple(faults), probability, float(weights[0]), faulty, values, errors, intervals,
        sets[int(np.argmax(weights))], sum(s.peak.evaluations for s in sets),
    )  # fmt: skip


def _matters(one: Unknown, z: float, error: float) -> float:
    """Probability that a fault which is there is `SMALLEST` of its range from healthy, or more."""
    ends = [one.healthy - SMALLEST * one.width, one.healthy + SMALLEST * one.width]
    low, high = coordinate(one, np.clip(ends, 0.5 * one.lower, None))
    inside = math.erf((high - z) / (error * math.sqrt(2.0))) - math.erf(
        (low - z) / (error * math.sqrt(2.0))
    )
    return 1.0 - 0.5 * inside


def identified_by_sets(
    ready: Sequence[Prepared],
    actuator: ParameterSet,
    baseline: Baseline,
    *,
    only: Iterable[str] | None = None,
    held: Mapping[str, float] | Any | None = None,
) -> Identification:
    """What recordings of one state of an actuator say of its faults, all together.

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
    found = assessed_sets(comparisons, faults, effects, fixed)
    peak = found.best.peak
    obstacles = list(
        dict.fromkeys(
            text
            for one in ready
            for text in (*one.barred, *model.excitation(one.recording, actuator))
        )
    )
    obstacles += _obstacles(peak, baseline, comparisons)
    verdict = _verdict(model, actuator, found, obstacles)
    cost = float(sum(one.residuals @ one.residuals for one in peak.curvatures))
    misfit = math.sqrt(cost / sum(one.scale for one in comparisons))
    first = ready[0].recording
    problem = Problem(comparisons[:1], faults, held=fixed)
    point = np.array([found.values[name] for name in problem.names])
    fitted = effects.candidates(peak.each.mean(axis=0)[None])
    return Identification(
        verdict=verdict,
        estimate=estimate_of(
            model, actuator, problem, point, np.diag(_errors(found) ** 2), misfit, first
        ),
        faults=model.as_faults(problem.values(point)),
        cost=cost,
        evaluations=found.evaluations,
        seconds=time.perf_counter() - started,
        history=np.array([[found.evaluations, cost]]),
        algorithm="sets of faults",
        seed=0,
        stopped="all sets compared",
        searched=problem.names,
        warnings=[text for one in ready for text in one.warnings],
        assumed=assumptions(first),
        actuator=actuator,
        provenance=first.provenance,
        intervals=found.intervals,
        physical_values={
            one.name: _physical(one, actuator, found) for one in faults
        },
        fitted={name: float(values[0]) for name, values in fitted.items()},
        calibrated=baseline.calibrated,
        recording=first,
        certain=found.probability,
    )  # fmt: skip


def _physical(one: Unknown, actuator: ParameterSet, found: Assessed) -> tuple[float, float, float]:
    """Value, low and high end of a fault in the unit that can be measured."""
    value, low, high = (
        one.physical_value(actuator, x).value
        for x in (found.values[one.name], *found.intervals[one.name])
    )
    return value, low, high


def _errors(found: Assessed) -> np.ndarray:
    """(d,) standard errors of values, as many from healthy as those of their coordinates."""
    errors = []
    for one in found.faults:
        error, value = found.errors[one.name], found.values[one.name]
        if one.logarithmic:
            error *= mean_slope(value, one.healthy)
        errors.append(error)
    return np.array(errors)


def _obstacles(peak: Peak, baseline: Baseline, comparisons: Sequence[Comparison]) -> list[str]:
    """Sentences on what of a fit forbids a verdict."""
    told = []
    left = float(np.max(peak.misfits * [one.expected_misfit for one in comparisons]))
    if baseline.recordings and left > WORSE * baseline.misfit:
        told.append(
            f"The twin leaves {100.0 * left:.1f} % of this recording unexplained, and "
            f"{100.0 * baseline.misfit:.1f} % of the worst healthy one: it does something that the "
            "twin cannot. Check channels, units, the load and the actuator."
        )
    if not peak.own.names:
        return told
    away = np.abs(peak.each - peak.own.mean) / peak.own.spread
    n, k = (int(x) for x in np.unravel_index(np.argmax(away), away.shape))
    if away[n, k] > IMPLAUSIBLE:
        told.append(
            f"To explain this recording {peak.own.names[k]} would have to be {away[n, k]:.0f} "
            "standard deviations off what is known of it: it is of another actuator, or something "
            "is wrong with a channel."
        )
    return told


def _verdict(
    model: Model, actuator: ParameterSet, found: Assessed, obstacles: Sequence[str]
) -> Verdict:
    """The verdict: a fault is named with a probability of `CERTAIN`."""
    likely = found.probability
    if obstacles:
        reason = " ".join(obstacles)
        return Verdict("none", (), reason, f"No verdict: {reason}")
    named = tuple(name for name, p in likely.items() if p > CERTAIN)
    said, ranges = {}, {}
    for one in found.faults:
        value, *ends = _physical(one, actuator, found)
        interval = Interval(min(ends), max(ends))
        said[one.name] = size_of(one, actuator, value, interval)
        ranges[one.name] = range_of(one, actuator, value, interval)
    far = {
        one.name: max(abs(end - one.healthy) for end in found.intervals[one.name]) / one.width
        for one in found.faults
    }
    if named:
        others = {name: x for name, x in far.items() if name not in named}
        beside = [said[n] for n, p in likely.items() if n not in named and p > BEFOREHAND]
        reason = f"Perhaps also {listed(beside)}." if beside else ""
        rest = reason or (least_certain("No other fault", others, ranges) if others else "")
        sentence = f"{faults_said([said[name] for name in named])} {rest}".rstrip()
        return Verdict("fault", named, reason, sentence)
    suspects = sorted((p, name) for name, p in likely.items() if p > 1.0 - CERTAIN)[::-1]
    which = " or ".join(f"{said[name]}, {100.0 * p:.0f} % probable" for p, name in suspects)
    if found.healthy < 1.0 - CERTAIN and found.faulty > CERTAIN:
        reason = f"{which}; this recording does not tell which."
        return Verdict("changed", (), reason, f"Changed: {reason}")
    if found.faulty > BEFOREHAND:
        reason = f"As likely healthy as not: {which}. Record more, or judge several together."
        return Verdict("none", (), reason, f"No verdict: {reason}")
    unseen = [name for name, x in far.items() if x > TELLING]
    reason = f"A fault of {listed(unseen)} would hardly show in this motion." if unseen else ""
    sentence = f"Healthy: {least_certain('no fault', far, ranges)} {reason}".rstrip()
    return Verdict("healthy", (), reason, sentence)
