"""``calibrate``: from healthy recordings to a twin, and where it judges, the healthy population.

One recording is enough for the twin. Kinds with `Model.monitoring` are judged by a healthy
population as well, which takes three runs over one command: the discrepancy of the twin, healthy
runs, signatures. Bands of the residual of a run come from a discrepancy learnt from the other runs:
a share of the run's noise in it would make its bands look quieter than the bands of a later run.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.estimation.baseline import frees_parameters
from ematwin.estimation.learn import learn
from ematwin.estimation.local import LocalDescent
from ematwin.models.base import Model, Monitoring
from ematwin.models.channels_agree import checked
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.monitoring.by_population import by_population
from ematwin.monitoring.calibration import Basis, Calibration, CalibrationReport
from ematwin.monitoring.measure import Bench, Fit, Measured, Motion
from ematwin.monitoring.population import Population, Signature, basis, fit_mean
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.monitoring.runs import Given, actuator_of, recordings_of
from ematwin.numerics.signals import spread_of
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told

Progress = Callable[[float], None]
_MOST_LEARNT = 8  # recordings that the parameters of other kinds are fitted to
_MOST_MEANS = 24  # mean recordings that those of monitored kinds are fitted to: more are no better
_MOST_LABELS = 20  # values of one label that are listed
_OUTLIER = 4.0  # robust standard deviations of the logarithm of a run's distance
_LEAST_SCATTER = 0.2  # of that logarithm: few runs may agree by chance
_WILD = 4.0  # healthy deviations that a feature counts at most: one alone makes no run odd
_ODD = 8.0  # robust standard deviations of what is reported


def calibrate(
    recordings: Given,
    template: ParameterSet | str | Path | Any | None = None,
    *,
    known: Mapping[str, Given] | None = None,
    name: str | None = None,
    progress: Progress | bool | None = None,
    add_to: Calibration | str | Path | None = None,
) -> CalibrationReport:
    """Learn from healthy recordings how an actuator behaves, and how far healthy runs differ.

    Parameters
    ----------
    recordings : healthy ones, or the files or folders that hold them; one is enough for the twin;
        three runs over one command also give the healthy population by which kinds with
        `Model.monitoring` are judged; nuisances such as a load need not be known
    template : actuator of any kind to start from: parameters, the name of a shipped set, or a file;
        if not given the default one of the kind that has such channels
    known : recordings with a known fault, by a text ``fault`` or ``fault: remark``; each entry
        becomes a signature
    name : of the calibrated actuator
    progress : True shows a bar, in a terminal or a notebook; else called with the share done
    add_to : calibration, or its file, whose healthy runs these join: actuator and discrepancy stay,
        the population is learnt from all; ``template`` is not looked at, and one run
        is enough

    ``known`` and ``add_to`` are of the healthy population, and refused for kinds without one.

    Raises
    ------
    RecordError
        If the recordings are not alike, too few, or one run is unlike the others.
    InputError
        If an option cannot be used.
    """
    with told(progress, "calibrating") as show:
        tell = show or (lambda share: None)
        if add_to is not None:
            return _added(recordings, add_to, known or {}, name, tell)
        return _calibrated(recordings, template, known or {}, name, tell)


def _calibrated(
    recordings: Given,
    template: ParameterSet | str | Path | Any | None,
    known: Mapping[str, Given],
    name: str | None,
    tell: Progress,
) -> CalibrationReport:
    """The twin, and where it judges, the healthy population."""
    chosen = actuator_of(recordings) if template is None else load_actuator(template)
    model = model_of(chosen)
    by_values = frees_parameters(model)
    if by_values and known:
        raise InputError(
            f"Actuators of the kind {model.kind} are judged by the values of their faults, not by "
            "a healthy population; leave known out."
        )
    healthy = recordings_of(recordings, chosen)
    for one in healthy:
        _, barred = checked(model, one, chosen)
        if barred:
            raise RecordError(f"{one.name} is nothing to learn from: {' '.join(barred)}")
    runs = list(dict.fromkeys(one.run for one in healthy))
    few = "" if by_values or len(runs) >= 3 else (
        "A healthy population needs at least three healthy runs, so that two can judge the third; "
        f"received {len(runs)} ({', '.join(runs)}). Record more, on other days; a run is a file, "
        "or a value of the column run."
    )  # fmt: skip
    if few and known:
        raise RecordError(few)
    tell(0.05)
    notes: list[str] = []
    if by_values:
        some = _evenly(healthy, _MOST_LEARNT)
        if model.recordings_differ:
            some, notes = _sound(model, chosen, healthy)
        beside = [model.compare(one, chosen) for one in some]
    else:
        settling = Monitoring.of(model).settling_time(chosen)
        motion = Motion(healthy[0].channels[model.command], healthy[0].interval, settling)
        bench = Bench(chosen, motion, healthy)
        beside = _mean_recordings(bench)
    learnt = learn(model, chosen, beside, lambda share: tell(0.05 + 0.45 * share))
    actuator, notes = _renamed(learnt.actuator, name), [*notes, *learnt.notes]
    tell(0.5)
    report = CalibrationReport(
        Calibration(actuator, learnt.baseline), learnt.parameters, learnt.tied, runs, tuple(notes)
    )
    if not (by_values or few):
        report = replace(report, calibration=_population(report, bench, known, tell))
    else:
        if few:
            notes.append(f"{few} Without that, ematwin detect cannot judge.")
        recorded = [one.recording for one in beside]
        shown = Basis(chosen, recorded, learnt.nuisances, learnt.forms)
        report = replace(report, notes=tuple(notes), basis=shown)
    tell(1.0)
    return report


def _population(
    learnt: CalibrationReport, template: Bench, known: Mapping[str, Given], tell: Progress
) -> PopulationCalibration:
    """The healthy population of a twin that was learnt, from recordings beside its template."""
    actuator, healthy = learnt.actuator, template.recordings
    bench = Bench(actuator, template.motion, healthy)
    fit, discrepancy, scale = _with_discrepancy(bench)
    measured = bench.measured(fit)
    tell(0.8)
    calibration = PopulationCalibration(
        actuator=actuator,
        baseline=learnt.baseline,
        motion=bench.motion,
        discrepancy=discrepancy,
        scale=scale,
        healthy=replace(measured, features=_without_own_share(bench, measured, fit, scale)),
        facts={
            "labels": _labels_of(healthy),
            "sources": sorted({one.source for one in healthy}),
            "undetermined": [p.place for p in learnt.parameters if not p.determined],
        },
    )
    _check_outliers(calibration)
    spread = calibration.population.spread.tolist()
    baseline = replace(
        learnt.baseline,
        scatter=dict(zip(bench.layout.magnitudes, spread, strict=False)),
        misfit=float(np.median([one.misfit for one in measured.estimates])),
        recordings=len(learnt.learnt),
    )
    calibration = replace(calibration, baseline=baseline)
    return replace(calibration, signatures=signatures(calibration, known))


def _renamed(actuator: ParameterSet, name: str | None) -> ParameterSet:
    return actuator if name is None else actuator.model_copy(update={"name": name})


def _sound(
    model: Model, actuator: ParameterSet, recordings: Sequence[Recording]
) -> tuple[list[Recording], list[str]]:
    """The recordings that can be learnt from, and sentences on the others.

    `RecordError` if there is none.
    """
    obstacles = [(one, " ".join(model.excitation(one, actuator))) for one in recordings]
    sound = [one for one, why in obstacles if not why]
    if not sound:
        raise RecordError(f"No recording can be learnt from. Of the first one: {obstacles[0][1]}")
    return sound, [f"{one.name} was left out: {why}" for one, why in obstacles if why]


def _added(
    recordings: Given,
    add_to: Calibration | str | Path,
    known: Mapping[str, Given],
    name: str | None,
    tell: Progress,
) -> CalibrationReport:
    """Add healthy runs to a calibration, such as runs of a later occasion."""
    before = add_to if isinstance(add_to, Calibration) else Calibration.load(add_to)
    if not isinstance(before, PopulationCalibration):
        raise InputError(
            f"The calibration of {before.actuator.name} has no healthy population to add to; "
            "calibrate anew with all healthy recordings."
        )
    given = recordings_of(recordings, before.actuator)
    measured = before.measure(given)
    tell(0.6)
    for one_run in by_population(given, before, measured).runs:
        if one_run.grade == "fault" or not one_run.probabilities:
            raise RecordError(
                f"{one_run.name} is no healthy run by the calibration that it is to join "
                f"({one_run.verdict.sentence.rstrip('.')}). Leave it out, or calibrate anew with "
                "it if it is healthy all the same."
            )
    taken = set(before.healthy.names)
    of_run = [f"{one.run} of {one.source}" if one.run in taken else one.run for one in given]
    if before.healthy.holds(measured.features, before.layout.kinds) or taken & set(of_run):
        raise RecordError(
            f"Run {given[0].run} of {given[0].source} is among the healthy runs already; give runs "
            "that are new."
        )
    after = replace(
        before,
        actuator=_renamed(before.actuator, name),
        healthy=before.healthy.with_more(replace(measured, runs=tuple(of_run))),
        signatures=(),
        facts={
            **before.facts,
            "labels": f"{before.facts.get('labels', 'none')}; added: {_labels_of(given)}",
            "sources": sorted({*before.facts.get("sources", []), *(one.source for one in given)}),
        },
    )
    stated = tuple(_restated(s, before.population, after.population) for s in before.signatures)
    after = replace(after, signatures=(*stated, *signatures(after, known)))
    tell(1.0)
    return CalibrationReport(after, [], [], after.healthy.names)


def _labels_of(recordings: Sequence[Recording]) -> str:
    """The labels of recordings with their values, as a text."""
    values: dict[str, dict[str, None]] = {}
    for one in recordings:
        for name, value in one.labels.items():
            values.setdefault(name, {})[value] = None
    return (
        "; ".join(f"{name} {', '.join(list(v)[:_MOST_LABELS])}" for name, v in values.items())
        or "none"
    )


def _restated(one: Signature, before: Population, after: Population) -> Signature:
    """A signature in the scores of another population over the same covariate."""
    raw = one.coefficients * before.spread + before.coefficients
    return replace(one, coefficients=(raw - after.coefficients) / after.spread)


def signatures(
    calibration: PopulationCalibration, known: Mapping[str, Given]
) -> tuple[Signature, ...]:
    """What recordings with known faults look like; ``known`` as in `calibrate`."""
    found = []
    for fault, recordings in known.items():
        measured = calibration.measure(recordings)
        name, colon, remark = fault.partition(":")
        scores = calibration.scores(measured)
        source = f"{len(scores)} motions{colon}{remark}, runs {', '.join(measured.names)}"
        mean = fit_mean(measured.covariate, calibration.scale, scores)
        found.append(Signature(name.strip(), mean, source))
    return tuple(found)


def _evenly(items: Sequence[Any] | np.ndarray, most: int) -> list[Any]:
    """So many of the items at most, evenly chosen."""
    places = np.linspace(0, len(items) - 1, min(len(items), most))
    return [items[n] for n in np.unique(np.round(places).astype(int))]


def _mean_recordings(bench: Bench) -> list[Comparison]:
    """The mean recording of each run and condition, evenly chosen where there are many."""
    means = []
    for group in _evenly(np.unique(bench.groups), _MOST_MEANS):
        members = [bench.comparisons[n] for n in np.flatnonzero(bench.groups == group)]
        means.append(members[0].averaged(members[1:]))
    return means


def _with_discrepancy(bench: Bench) -> tuple[Fit, np.ndarray, float | None]:
    """The last fit, the discrepancy of the twin over the covariate, and the covariate's scale."""
    fit = bench.fit(search=LocalDescent())  # healthy ones lie in the valley of health
    scale = None
    if bench.monitoring.covariate is not None:
        scale = float(np.sqrt((fit.covariate**2).mean())) or 1.0
    discrepancy = np.zeros(1)
    for _ in range(2):  # of discrepancy and values in turn
        left = fit.residuals.reshape(len(fit.found), -1)
        discrepancy = discrepancy + fit_mean(fit.covariate, scale, left)
        fit = bench.fit(discrepancy, scale, fit)
    return fit, discrepancy, scale


def _check_outliers(calibration: PopulationCalibration) -> None:
    """Refuse a run that is unlike all others: it may be a faulty one among the healthy."""
    healthy, kinds = calibration.healthy, np.array(calibration.layout.kinds)
    members = [healthy.of_run(run) for run in healthy.names]
    if len(members) < 4:
        return  # of three, nobody can tell which one is the odd one

    def refuse(n: int, how: str) -> None:
        raise RecordError(
            f"Run {healthy.names[n]} is unlike the other {len(members) - 1} healthy runs: {how}. "
            "If it is faulty or of another rig, leave it out."
        )

    sizes = np.minimum(np.abs(calibration.tested), _WILD)
    # of all features, and of the residual alone: magnitudes may differ from day to day so much
    # that a rough run does not stand out
    for columns in (np.ones(len(kinds), dtype=bool), kinds != "model"):
        levels = np.array([np.log(sizes[own][:, columns].mean()) for own in members])
        for n, (away, spread) in enumerate(_beside_others(levels)):
            if away > _OUTLIER * max(spread, _LEAST_SCATTER):
                refuse(n, f"it lies {np.exp(away):.1f} times as far from the others as they lie "
                       "from each other")  # fmt: skip
    for k, one in enumerate(calibration.quantities):
        levels = np.array([calibration.values[own, k].mean() for own in members])
        for n, (away, spread) in enumerate(_beside_others(levels)):
            if abs(away) > max(_ODD * spread, one.least):
                unit, scale = ("%", 100.0) if one.logarithmic else (one.unit, one.scale)
                shown = f"{scale * abs(away):.2g} {unit}".rstrip()
                refuse(n, f"its {one.name} differs from theirs by {shown}")


def _beside_others(levels: np.ndarray) -> list[tuple[float, float]]:
    """How far each is from the median of the others, and the robust spread of these."""
    found = []
    for n, own in enumerate(levels):
        rest = np.delete(levels, n)
        middle = float(np.median(rest))
        found.append((float(own - middle), float(spread_of(np.abs(rest - middle)))))
    return found


def _without_own_share(
    bench: Bench, measured: Measured, fit: Fit, scale: float | None
) -> np.ndarray:
    """Features (N, F) with the bands that are left of a discrepancy from the other runs alone.

    Magnitudes and means need none of it: a run adds to the discrepancy as much as it takes from the
    mean of the population. ``fit`` is with the discrepancy of all recordings.
    """
    features, layout = measured.features.copy(), bench.layout
    bands = [n for n, kind in enumerate(layout.kinds) if kind == "band"]
    left = fit.residuals.reshape(len(features), -1)
    for own in map(measured.of_run, measured.names):
        mean = fit_mean(fit.covariate[~own], scale, left[~own])
        rest = left[own] - basis(fit.covariate[own], scale) @ mean
        for n, row in zip(np.flatnonzero(own), rest, strict=True):
            magnitudes = dict(zip(layout.magnitudes, features[n], strict=False))
            residuals = row.reshape(len(bench.motion.channels), -1)
            features[n, bands] = layout.values(magnitudes, residuals)[bands]
    return features
