"""``calibrate``: from healthy recordings to a twin, and where it judges, the healthy population.

One recording is enough for the twin. Kinds with `Model.monitoring` are judged by a healthy
population as well, which takes three runs over one command: the discrepancy of the twin, healthy
runs, signatures. Bands of the residual of a run come from a discrepancy learnt from the other runs:
a share of the run's noise in it would make its bands look quieter than the bands of a later run.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.estimation.baseline import frees_parameters
from ematwin.estimation.constants import IMPLAUSIBLE
from ematwin.estimation.learn import learn
from ematwin.estimation.local import LocalDescent
from ematwin.models.base import Model, Monitoring, Progress
from ematwin.models.channels_agree import checked
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.monitoring.by_population import by_population
from ematwin.monitoring.calibration import Basis, Calibration, CalibrationReport
from ematwin.monitoring.measure import Beside, Measurements, Motion, measured
from ematwin.monitoring.population import Parabola
from ematwin.monitoring.population_calibration import PopulationCalibration, Signature
from ematwin.monitoring.runs import Given, actuator_of, recordings_of
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told

_MOST_LEARNT = 8  # recordings that the parameters of other kinds are fitted to
_MOST_MEANS = 24  # mean recordings that those of monitored kinds are fitted to: more are no better
_MOST_LABELS = 20  # values of one label that are listed
_FEWEST = 5  # runs, of which one can be told from the others: three know too little of a fourth


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
            report = _added(recordings, add_to, known or {}, name, tell)
        else:
            chosen = actuator_of(recordings) if template is None else load_actuator(template)
            report = _calibrated(recordings, chosen, known or {}, name, tell)
        tell(1.0)
        return report


def _calibrated(
    recordings: Given,
    template: ParameterSet,
    known: Mapping[str, Given],
    name: str | None,
    tell: Progress,
) -> CalibrationReport:
    """The twin, and where it judges, the healthy population."""
    model = model_of(template)
    if frees_parameters(model) and known:
        raise InputError(
            f"Actuators of the kind {model.kind} are judged by the values of their faults, not by "
            "a healthy population; leave known out."
        )
    healthy, again = _once(recordings_of(recordings, template))
    for one in healthy:
        _, barred = checked(model, one, template)
        if barred:
            raise RecordError(f"{one.name} is nothing to learn from: {' '.join(barred)}")
    runs = list(dict.fromkeys(one.run for one in healthy))

    def twin(comparisons: Sequence[Comparison], notes: Sequence[str] = ()) -> CalibrationReport:
        tell(0.05)
        learnt = learn(model, template, comparisons, lambda share: tell(0.05 + 0.45 * share))
        shown = [one.recording for one in comparisons]
        tell(0.5)
        return CalibrationReport(
            Calibration(_renamed(learnt.actuator, name), learnt.baseline),
            learnt.parameters, learnt.tied, runs, (*again, *notes, *learnt.notes),
            Basis(template, shown, learnt.nuisances, learnt.forms),
        )  # fmt: skip

    if frees_parameters(model):
        some, notes = _sound(model, template, healthy)
        return twin([model.compare(one, template) for one in some], notes)
    few = "" if len(runs) >= 3 else (
        "A healthy population needs at least three healthy runs, so that two can judge the third; "
        f"received {len(runs)} ({', '.join(runs)}). Record more, on other days; a run is a file, "
        "or a value of the column run."
    )  # fmt: skip
    if few and known:
        raise RecordError(few)
    motion = _motion_of(healthy[0], template)
    report = twin(_mean_recordings([Beside(template, motion, one) for one in healthy]))
    if few:
        note = f"{few} Without that, ematwin detect cannot judge."
        return replace(report, notes=(*report.notes, note))
    calibration = _population(report, [Beside(report.actuator, motion, one) for one in healthy])
    tell(0.8)
    _refuse_odd(calibration)
    taught = replace(calibration, signatures=signatures(calibration, known))
    return replace(report, calibration=taught, basis=None)


def _once(recordings: Sequence[Recording]) -> tuple[list[Recording], list[str]]:
    """The recordings, those with the same contents once, and a sentence on each of the others."""
    known: dict[Any, Recording] = {}
    notes = []
    for one in recordings:
        content = tuple((name, hash(values.tobytes())) for name, values in one.columns())
        if content in known:
            notes.append(
                f"{one.name} has the contents of {known[content].name} before it and counts once."
            )
        known.setdefault(content, one)
    return list(known.values()), notes


def _sound(
    model: Model, actuator: ParameterSet, recordings: Sequence[Recording]
) -> tuple[list[Recording], list[str]]:
    """The recordings that are learnt from, and sentences on those that cannot be.

    `RecordError` if there is none.
    """
    if not model.recordings_differ:
        return _evenly(recordings, _MOST_LEARNT), []
    obstacles = [(one, " ".join(model.excitation(one, actuator))) for one in recordings]
    sound = [one for one, why in obstacles if not why]
    if not sound:
        raise RecordError(f"No recording can be learnt from. Of the first one: {obstacles[0][1]}")
    return sound, [f"{one.name} was left out: {why}" for one, why in obstacles if why]


def _renamed(actuator: ParameterSet, name: str | None) -> ParameterSet:
    return actuator if name is None else actuator.model_copy(update={"name": name})


def _evenly(items: Sequence[Any], most: int) -> list[Any]:
    """So many of the items at most, evenly chosen."""
    places = np.linspace(0, len(items) - 1, min(len(items), most))
    return [items[n] for n in np.unique(np.round(places).astype(int))]


def _motion_of(recording: Recording, actuator: ParameterSet) -> Motion:
    """The motion of a recording, with the channels in which the twin answers."""
    model = model_of(actuator)
    monitoring = Monitoring.of(model)
    settling = monitoring.settling_time(actuator)
    compared = monitoring.compare(model, recording, actuator, settling)
    command = recording.channels[model.command]
    return Motion(command, recording.interval, settling, tuple(compared.measured()))


def _mean_recordings(beside: Sequence[Beside]) -> list[Comparison]:
    """The mean recording of each run and condition, evenly chosen where there are many."""
    groups: dict[Any, list[Comparison]] = {}
    for one in beside:
        groups.setdefault(one.recording.together, []).append(one.comparison)
    some = _evenly(list(groups.values()), _MOST_MEANS)
    return [first.averaged(others) for first, *others in some]


def _population(learnt: CalibrationReport, beside: Sequence[Beside]) -> PopulationCalibration:
    """The healthy population of a twin that was learnt, from recordings beside it."""
    for one in beside:
        one.fit(LocalDescent())  # healthy ones lie in the valley of health
    _, covariate = _left_of(beside)
    discrepancy = Parabola(float(np.sqrt((covariate**2).mean())) or 1.0, np.zeros(1))
    for _ in range(2):  # of discrepancy and values in turn
        more = Parabola.of(*_left_of(beside), discrepancy.scale).coefficients
        discrepancy = replace(discrepancy, coefficients=discrepancy.coefficients + more)
        for one in beside:
            one.again(discrepancy)
    healthy, recordings = measured(beside), [one.recording for one in beside]
    found = PopulationCalibration(
        actuator=learnt.actuator,
        baseline=learnt.baseline,
        motion=beside[0].motion,
        discrepancy=discrepancy,
        healthy=replace(healthy, features=_without_own_share(beside, healthy, discrepancy.scale)),
        facts={
            "labels": _labels_of(recordings),
            "sources": sorted({one.source for one in recordings}),
            "undetermined": [p.place for p in learnt.parameters if not p.determined],
        },
    )
    spread = found.population.spread.tolist()
    baseline = replace(
        learnt.baseline,
        scatter=dict(zip(found.magnitudes, spread, strict=False)),
        misfit=float(np.median([one.misfit for one in beside])),
        recordings=len(learnt.learnt),
    )
    return replace(found, baseline=baseline)


def _left_of(beside: Sequence[Beside]) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (N, C S) of recordings, and their covariates (N,)."""
    residuals = np.array([one.residuals.ravel() for one in beside])
    return residuals, np.array([one.covariate for one in beside])


def _without_own_share(beside: Sequence[Beside], healthy: Measurements, scale: float) -> np.ndarray:
    """Features (N, F) with the bands that are left of a discrepancy from the other runs alone.

    Magnitudes and means need none of it: a run adds to the discrepancy as much as it takes from the
    mean of the population. The recordings were fitted with the discrepancy of all of them.
    """
    features, (left, covariate) = healthy.features.copy(), _left_of(beside)
    layout = beside[0].motion.layout(beside[0].actuator)
    bands = [n for n, one in enumerate(layout) if one.kind == "band"]
    for n, one in enumerate(beside):
        others = healthy.runs != healthy.runs[n]
        mean = Parabola.of(left[others], covariate[others], scale)
        rest = left[n] - mean.at(covariate[n])
        features[n, bands] = one.features(rest.reshape(one.residuals.shape))[bands]
    return features


def _labels_of(recordings: Sequence[Recording]) -> str:
    """The labels of recordings with their values, as a text."""
    said = []
    for name in dict.fromkeys(name for one in recordings for name in one.labels):
        values = dict.fromkeys(one.labels[name] for one in recordings if name in one.labels)
        said.append(f"{name} {', '.join(list(values)[:_MOST_LABELS])}")
    return "; ".join(said) or "none"


def _refuse_odd(calibration: PopulationCalibration) -> None:
    """Refuse a run that the others cannot believe to be healthy: it may be a faulty one."""
    healthy = calibration.healthy
    if len(healthy.names) < _FEWEST:
        return
    found = {
        run: calibration.without(run).posterior(healthy.part(healthy.runs == run))
        for run in healthy.names
    }
    odd = min(found, key=lambda run: found[run].healthy)
    if found[odd].healthy < math.erfc(IMPLAUSIBLE / math.sqrt(2.0)):
        causes = found[odd].probabilities
        raise RecordError(
            f"Run {odd} is unlike the other {len(found) - 1} healthy runs: most like "
            f"{max(causes, key=lambda name: causes[name])}. If it is faulty or of another rig, "
            "leave it out."
        )


def signatures(
    calibration: PopulationCalibration, known: Mapping[str, Given]
) -> tuple[Signature, ...]:
    """What recordings with known faults look like; ``known`` as in `calibrate`."""
    found = []
    for fault, recordings in known.items():
        own = measured(calibration.beside(recordings))
        name, colon, remark = fault.partition(":")
        scores = Parabola.of(calibration.scores(own), own.covariate, calibration.scale)
        source = f"{len(own.runs)} motions{colon}{remark}, runs {', '.join(own.names)}"
        found.append(Signature(name.strip(), scores, source))
    return tuple(found)


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
    beside = before.beside(recordings)
    given, more = [one.recording for one in beside], measured(beside)
    tell(0.6)
    for run in by_population(beside, before).runs:
        if run.grade == "fault" or not run.probabilities:
            raise RecordError(
                f"{run.name} is no healthy run by the calibration that it is to join "
                f"({run.verdict.sentence.rstrip('.')}). Leave it out, or calibrate anew with it if "
                "it is healthy all the same."
            )
    taken = before.healthy.names
    runs = [f"{one.run} of {one.source}" if one.run in taken else one.run for one in given]
    if before.knows(more) or set(taken) & set(runs):
        raise RecordError(
            f"Run {given[0].run} of {given[0].source} is among the healthy runs already; give runs "
            "that are new."
        )
    after = replace(
        before,
        actuator=_renamed(before.actuator, name),
        healthy=before.healthy.with_more(replace(more, runs=np.array(runs))),
        signatures=(),
        facts={
            **before.facts,
            "labels": f"{before.facts.get('labels', 'none')}; added: {_labels_of(given)}",
            "sources": sorted({*before.facts.get("sources", []), *(one.source for one in given)}),
        },
    )
    stated = [one.in_scores_of(before.population, after.population) for one in before.signatures]
    after = replace(after, signatures=(*stated, *signatures(after, known)))
    return CalibrationReport(after, [], [], after.healthy.names)
