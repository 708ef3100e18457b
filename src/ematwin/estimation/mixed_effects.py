"""Which faults a recording shows, where recordings of a healthy actuator differ by themselves.

Beforehand an actuator is healthy or has one fault, rarely two, each as likely as the others and as
far from healthy as its range allows (a spike and a slab: Mitchell and Beauchamp 1988, J. Am. Stat.
Assoc. 83, 1023-1032). Each such set of faults is fitted with all that differs between healthy
recordings free (`random_effects`), and its evidence says how probable it is (MacKay 1992); of two
minima of a set each has its own. The probability of a fault is the sum over all sets with it. Its
value and interval are median and quantiles over these sets, weighed by their probabilities.

Several recordings of one state of the actuator are judged together: the faults are shared, all else
is each recording's own.
"""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.assess import unassessed
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.constants import APART, BEFOREHAND, IMPLAUSIBLE, WORSE, WORST
from ematwin.estimation.findings import implausible, unexplained, verdict_on
from ematwin.estimation.free_unknowns import unknowns_of
from ematwin.estimation.identification import Identification
from ematwin.estimation.identify import Prepared, concluded, estimate_of
from ematwin.estimation.intervals import Interval, deviations, physical_of
from ematwin.estimation.prior import Prior, coordinate
from ematwin.estimation.problem import Problem
from ematwin.estimation.random_effects import Peak, effects_of, fit
from ematwin.estimation.search import Found
from ematwin.estimation.spike_and_slab import SEED, FaultSet, FaultSets
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.models.unknown import Unknown

_SECOND = 0.1  # probability that a faulty actuator has a second fault
_DRAWS = 2000


def assessed_sets(
    comparisons: Sequence[Comparison],
    faults: Sequence[Unknown],
    effects: Sequence[Unknown],
    held: Mapping[str, float],
) -> tuple[FaultSets, Peak, int]:
    """The posterior of sets of faults, the peak of the best one, and the simulations it took."""
    slabs = {one.name: _slab(one) for one in faults}
    spent = 0

    def peak_of(names: Sequence[str], start: Mapping[str, float]) -> Peak:
        nonlocal spent
        shared = [slabs[name] for name in names]
        peak = fit(comparisons, shared, effects, start=start, held=held)
        spent += peak.evaluations
        return peak

    none = peak_of((), {})
    peaks: dict[tuple[str, ...], list[Peak]] = {}
    for name, slab in slabs.items():
        start = {**none.values, name: _scanned(comparisons, slab, effects, held)}
        peaks[(name,)] = [peak_of((name,), start)]
    lead = min(peaks, key=lambda names: _left(peaks[names][0]))
    # what the scan found with all else healthy may be the further one of two minima
    both = sorted([*peaks[lead], peak_of(lead, none.values)], key=_left)
    places = [peak.problem.chart.from_values(peak.point[None])[0, 0] for peak in both]
    peaks[lead] = both if abs(places[1] - places[0]) > APART else both[:1]
    # from where a fault led it, a descent without that fault may end lower
    peaks[()] = [min(none, peak_of((), peaks[lead][0].values), key=_left)]

    def log_of(size: int, peak: Peak, noise_of: Peak) -> tuple[float, np.ndarray]:
        """Logarithm of the probability at a peak of a set, but for a constant; its covariance."""
        weighed = peak.problem.with_comparisons(noise_of.problem.comparisons)
        log, covariance = peak._replace(problem=weighed).approximated()
        return log + math.log(_beforehand(size, len(slabs))), covariance

    # a second fault only beside a first one that explains more than its prior takes
    first = peaks[lead][0]
    if log_of(1, first, first)[0] > log_of(0, peaks[()][0], first)[0]:
        for other in (name for name in slabs if name not in lead):
            peaks[(*lead, other)] = [peak_of((*lead, other), first.values)]
    each = [(names, peak) for names, some in peaks.items() for peak in some]
    # one noise for all sets, that of the best fit: else evidence would not compare
    best_fit = min((peak for _, peak in each), key=_left)
    found = [log_of(len(names), peak, best_fit) for names, peak in each]
    logs = np.array([log for log, _ in found])
    shares = np.exp(logs - logs.max())
    shares /= shares.sum()
    sets = [
        FaultSet(frozenset(names), share, _drawn(faults, names, peak, covariance))
        for (names, peak), (_, covariance), share in zip(each, found, shares.tolist(), strict=True)
    ]
    sets.sort(key=lambda one: -one.probability)
    return FaultSets(tuple(faults), tuple(sets)), each[int(np.argmax(shares))][1], spent


def _drawn(
    faults: Sequence[Unknown], names: Sequence[str], peak: Peak, covariance: np.ndarray
) -> np.ndarray:
    """Draws (N, f) of all faults around the peak of a set; those that are not in it are healthy."""
    rng = np.random.default_rng(SEED)
    found = np.tile([one.healthy for one in faults], (_DRAWS, 1))
    count = len(names)
    root = np.linalg.cholesky(covariance[:count, :count])
    away = rng.standard_normal((_DRAWS, count)) @ root.T
    places = [[one.name for one in faults].index(name) for name in names]
    for n, place in enumerate(places):
        one = faults[place]
        drawn = coordinate(one, peak.point[n]) + away[:, n]
        values = np.exp(drawn) if one.logarithmic else drawn
        found[:, place] = np.clip(values, one.lower, one.upper)
    return found


def _left(peak: Peak) -> float:
    """Mean square of the residuals of all recordings."""
    return float(np.mean(peak.misfits**2))


def _slab(one: Unknown) -> Unknown:
    """A fault that is there: normally distributed, its range within two standard deviations."""
    ends = coordinate(one, np.array([one.lower, one.upper]))
    return replace(one, spread=float(np.abs(ends - coordinate(one, one.healthy)).max()) / 2.0)


def _beforehand(size: int, count: int) -> float:
    """Probability of one set of this size among ``count`` faults."""
    if size == 0:
        return BEFOREHAND
    share = (1.0 - BEFOREHAND) * (_SECOND if size == 2 else 1.0 - _SECOND)
    return share / math.comb(count, size)


def _scanned(
    comparisons: Sequence[Comparison],
    slab: Unknown,
    effects: Sequence[Unknown],
    held: Mapping[str, float],
) -> float:
    """The value of a fault alone at which the misfit is least."""
    low, high = coordinate(slab, np.array([slab.lower, slab.upper]))
    z = np.linspace(low, high, 9)  # values of a fault at which a descent may start
    tried = np.r_[slab.healthy, np.exp(z) if slab.logarithmic else z]
    known = {**held, **{one.name: one.healthy for one in effects}}
    values = {name: np.full(len(tried), value) for name, value in known.items()}
    values[slab.name] = np.clip(tried, slab.lower, slab.upper)
    costs = np.sum([c.costs(values, len(tried)) for c in comparisons], axis=0)
    return float(values[slab.name][int(np.argmin(costs))])


def identified_by_sets(
    ready: Sequence[Prepared],
    actuator: ParameterSet,
    baseline: Baseline,
    *,
    only: Iterable[str] | None = None,
    held: Mapping[str, float] | Any | None = None,
) -> Identification:
    """Identify the faults of an actuator from several prepared recordings of one state.

    ``only`` and ``held`` are as of `ematwin.identify`. `InputError` if no fault is left, or
    something is named that is none.
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
    effects = [one for one in effects_of(model, actuator, baseline) if one.name not in fixed]
    comparisons = [model.compare(one.recording, actuator) for one in ready]
    sets, peak, spent = assessed_sets(comparisons, faults, effects, fixed)
    first, problem = ready[0].recording, Problem(comparisons[:1], faults, held=fixed)
    each = peak.each(effects)
    values, intervals, errors = {}, {}, []
    for one in faults:
        drawn = sets.given(one.name).of(one.name)
        values[one.name] = value = float(np.median(drawn))
        intervals[one.name] = Interval(*sets.interval(one, value))
        errors.append(deviations(one, drawn, value).std())
    fitted = {
        one.name: float(np.exp(z) if one.logarithmic else z)
        for one, z in zip(effects, each.mean(axis=0), strict=True)
    }
    cost = float(peak.misfits**2 @ [one.independent for one in comparisons])
    point = np.array([values[name] for name in problem.names])
    found = Found(
        point, cost, spent, np.array([[spent, cost]]), "all sets compared", "sets of faults", 0
    )
    assessed = replace(
        unassessed(model, actuator, problem, found, baseline),
        values={**values, **fitted},
        covariance=np.diag(np.square(errors)),
        intervals=intervals,
        physical={
            one.name: physical_of(one, actuator, values[one.name], intervals[one.name])
            for one in faults
        },
        sets=sets,
    )
    misfit = math.sqrt(cost / sum(one.scale for one in comparisons))
    estimate = estimate_of(actuator, problem, point, assessed.covariance, misfit, first)
    obstacles = [
        text for one in ready for text in (*one.barred, *model.excitation(one.recording, actuator))
    ]
    obstacles += _obstacles(peak, effects, each, baseline, comparisons)
    verdict = verdict_on(
        model, actuator, problem, assessed, baseline, list(dict.fromkeys(obstacles))
    )
    warnings = [text for one in ready for text in one.warnings]
    return concluded(
        actuator, first, problem, estimate, found, assessed, verdict, warnings, baseline, started
    )


def _obstacles(
    peak: Peak,
    effects: Sequence[Unknown],
    each: np.ndarray,
    baseline: Baseline,
    comparisons: Sequence[Comparison],
) -> list[str]:
    """Sentences on what of a fit forbids a verdict; ``each`` (n, p) are values of the effects."""
    told = []
    left = float(np.max(peak.misfits * [one.expected_misfit for one in comparisons]))
    most = WORSE * baseline.misfit if baseline.recordings else WORST
    if left > most:
        usual = f"the worst healthy one left {100.0 * baseline.misfit:.2g} %"
        if not baseline.recordings:
            usual = f"a good fit leaves less than {100.0 * most:.2g} %"
        told.append(unexplained(left, usual))
    if effects:
        prior = Prior.independent(effects)
        away = np.abs(each - prior.mean) / np.sqrt(np.diag(prior.covariance))
        n, k = (int(x) for x in np.unravel_index(np.argmax(away), away.shape))
        if away[n, k] > IMPLAUSIBLE:
            told.append(implausible(effects[k].name, float(away[n, k])))
    return told
