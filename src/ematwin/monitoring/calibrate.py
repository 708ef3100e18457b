"""``calibrate``: from healthy recordings to a twin, and where it judges, the healthy population.

One recording is enough for the twin. Kinds with `Model.monitoring` are judged by a healthy
population as well, which takes three runs over one command.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ematwin.errors import InputError, RecordError
from ematwin.estimation.baseline import frees_parameters
from ematwin.estimation.learn import learn
from ematwin.models.base import Model, Monitoring
from ematwin.models.channels_agree import checked
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.monitoring.by_population import by_population
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.calibration_report import Basis, CalibrationReport
from ematwin.monitoring.gather import Given, actuator_of, recordings_of
from ematwin.monitoring.learn_population import (
    check_outliers,
    evenly,
    mean_recordings,
    restated,
    signature,
    with_discrepancy,
    with_spread,
    without_own_share,
)
from ematwin.monitoring.measure import Bench
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told

Progress = Callable[[float], None]
_MOST_LEARNT = 8  # recordings that the parameters of other kinds are fitted to
_MOST_LABELS = 20  # values of one label that are listed


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
    of_run = [one.run for one in healthy]
    runs = list(dict.fromkeys(of_run))
    few = "" if by_values or len(runs) >= 3 else (
        "A healthy population needs at least three healthy runs, so that two can judge the third; "
        f"received {len(runs)} ({', '.join(runs)}). Record more, on other days; a run is a file, "
        "or a value of the column run."
    )  # fmt: skip
    if few and known:
        raise RecordError(few)
    tell(0.05)
    left_out: list[str] = []
    if by_values:
        some = evenly(healthy, _MOST_LEARNT)
        if model.recordings_differ:
            some, left_out = _sound(model, chosen, healthy)
        beside = [model.compare(one, chosen) for one in some]
    else:
        command, interval = healthy[0].channels[model.command], healthy[0].interval
        settling = Monitoring.of(model).settling_time(chosen)
        bench = Bench(model, chosen, healthy, command, interval, settling)
        beside = mean_recordings(bench)
    learnt = learn(model, chosen, beside, lambda share: tell(0.05 + 0.45 * share))
    actuator, parameters = _renamed(learnt.actuator, name), learnt.parameters
    tell(0.5)
    if by_values or few:
        tell(1.0)
        notes = [*left_out, *learnt.notes]
        if few:
            notes.append(f"{few} Without that, ematwin detect cannot judge.")
        return CalibrationReport(
            Calibration(actuator, learnt.baseline), parameters, learnt.tied, runs,
            notes=tuple(notes),
            basis=Basis(chosen, [c.recording for c in beside], learnt.nuisances, learnt.forms),
        )  # fmt: skip
    bench = Bench(model, actuator, healthy, command, interval, settling, bench.layout.channels)
    fit, discrepancy, scale = with_discrepancy(bench)
    measured = bench.measured(fit)
    tell(0.8)
    features = without_own_share(bench, measured, fit, scale, of_run)
    calibration = PopulationCalibration(
        actuator=actuator,
        baseline=learnt.baseline,
        command=command,
        interval=interval,
        settling_time=settling,
        channels=bench.layout.channels,
        discrepancy=discrepancy,
        scale=scale,
        healthy=measured.healthy(features, of_run),
        facts={
            "labels": _labels_of(healthy),
            "sources": sorted({one.source for one in healthy}),
            "undetermined": [p.place for p in parameters if not p.determined],
        },
    )
    check_outliers(calibration)
    calibration = replace(calibration, baseline=with_spread(calibration, measured))
    signatures = tuple(signature(calibration, fault, examples) for fault, examples in known.items())
    calibration = replace(calibration, signatures=signatures)
    tell(1.0)
    return CalibrationReport(calibration, parameters, learnt.tied, runs, tuple(learnt.notes))


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
    more = measured.healthy(measured.features, of_run)
    after = replace(
        before,
        actuator=_renamed(before.actuator, name),
        healthy=before.healthy.with_more(more),
        signatures=(),
        facts={
            **before.facts,
            "labels": f"{before.facts.get('labels', 'none')}; added: {_labels_of(given)}",
            "sources": sorted({*before.facts.get("sources", []), *(one.source for one in given)}),
        },
    )
    signatures = [restated(one, before.population, after.population) for one in before.signatures]
    signatures += [signature(after, fault, examples) for fault, examples in known.items()]
    tell(1.0)
    after = replace(after, signatures=tuple(signatures))
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
