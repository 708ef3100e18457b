"""``calibrate``: from healthy recordings to a twin, and where it judges, the healthy population.

One recording is enough for the twin. Kinds that one descent fits are judged by a healthy population
as well, which takes three runs over one command.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin import __version__
from ematwin.errors import InputError, RecordError
from ematwin.estimation.baseline import Baseline, frees_parameters
from ematwin.estimation.learn import learn
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.nominal import NominalParameter
from ematwin.models.base import Model
from ematwin.models.channels_agree import checked
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.monitoring.by_population import by_population
from ematwin.monitoring.calibration import Calibration, PopulationCalibration, Thresholds
from ematwin.monitoring.classification import REACH, Signature
from ematwin.monitoring.features import Layout
from ematwin.monitoring.gather import Given, actuator_of, recordings_of
from ematwin.monitoring.healthy import HealthyRuns, Learning, without_own_share
from ematwin.monitoring.index import single_reach
from ematwin.monitoring.measure import Bench, Fit, Measured
from ematwin.monitoring.population import Population, fit_mean
from ematwin.monitoring.scores import FALSE_ALARM_RATE
from ematwin.recordings.recording import Recording
from ematwin.showing import markup
from ematwin.showing.bars import told
from ematwin.showing.drawing import page_written
from ematwin.showing.frames import frame_of_rows

Progress = Callable[[float], None]
_MOST_MEANS = 24  # mean recordings that the nominal parameters are fitted to
_MOST_LEARNT = 8  # recordings that the parameters of other kinds are fitted to
_ROUNDS = 2  # of discrepancy and values in turn
_MOST_LABELS = 20  # values of one label that are listed


@dataclass(frozen=True)
class CalibrationReport:
    """What a calibration found.

    Attributes
    ----------
    calibration : with the healthy population, where there is one (`PopulationCalibration`)
    parameters : fitted ones, with what could not be determined; none where runs were added
    tied : groups of parameters of which only ratios or products are known
    learnt, held_back : names of the runs; none is held back where each was judged by the others
    run_spread : of each quantity of the population, standard deviations within a run and between
        runs; of logarithms for multiples of healthy, else SI
    false_alarms : share of the recordings so judged above the threshold
    notes : sentences on what to be careful of
    """

    calibration: Calibration
    parameters: list[NominalParameter]
    tied: list[tuple[str, ...]]
    learnt: list[str]
    held_back: list[str] = field(default_factory=list)
    run_spread: dict[str, tuple[float, float]] = field(default_factory=dict)
    false_alarms: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def actuator(self) -> ParameterSet:
        """With the values that were found."""
        return self.calibration.actuator

    @property
    def baseline(self) -> Baseline:
        """How well they are known."""
        return self.calibration.baseline

    @property
    def sources(self) -> dict[str, str]:
        """Where the value of each fitted parameter comes from, by place."""
        runs = ", ".join(self.learnt)
        return {
            p.place: f"calibrated on healthy runs {runs} with ematwin {__version__}, standard "
            f"error {p.standard_error:.3g}"
            if p.determined
            else f"not determined by the healthy runs; template {p.template:.4g}"
            for p in self.parameters
        }

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each fitted parameter, by place; needs pandas."""
        return frame_of_rows(
            (
                {"place": p.place, "value": p.value, "standard_error": p.standard_error,
                 "template": p.template, "determined": p.determined}
                for p in self.parameters
            ),
            "place",
        )  # fmt: skip

    to_dataframe = to_frame

    def __str__(self) -> str:
        lines = [f"{self.actuator.name}, calibrated on {len(self.learnt)} runs"]
        for p in self.parameters:
            error = f"standard error {p.standard_error:.2g}" if p.determined else "not determined"
            lines.append(f"{p.place:<34} {p.value:>10.4g}  {error}")
        return "\n".join([*lines, *self.notes])

    def _repr_html_(self) -> str:
        """From how many runs, then the fitted parameters, in a notebook."""
        rows = [
            (p.place, f"{p.value:.6g}" if p.determined else "not determined",
             f"{p.standard_error:.2g}", f"{p.template:.6g}")
            for p in self.parameters
        ]  # fmt: skip
        return "".join(
            [
                markup.heading(f"{self.actuator.name}, calibrated on {len(self.learnt)} runs"),
                markup.table(("parameter", "value", "standard error", "template"), rows),
                *(markup.note(text) for text in (self.baseline.forms, *self.notes) if text),
            ]
        )

    def report(self, path: str | Path) -> None:
        """Write its page (.html), which holds all that it shows."""
        page_written(self, path, "calibration:calibration_page")

    def save(self, path: str | Path) -> None:
        """Write the calibrated actuator as a TOML file, with the sources of its parameters."""
        self.calibration.save(path, self.sources)

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        of_population: dict[str, object] = {"threshold": None, "signatures": []}
        if isinstance(self.calibration, PopulationCalibration):
            of_population = {
                "threshold": vars(self.calibration.thresholds).copy(),
                "signatures": [s.fault for s in self.calibration.signatures],
            }
        return {
            "actuator": self.actuator.name,
            "kind": self.actuator.kind,
            "misfit": self.baseline.misfit if math.isfinite(self.baseline.misfit) else None,
            "forms": self.baseline.forms,
            "absent_forms": list(self.baseline.absent_forms),
            "tied": [list(group) for group in self.tied],
            "parameters": {p.place: vars(p).copy() for p in self.parameters},
            "spread": {k: {"within": a, "between": b} for k, (a, b) in self.run_spread.items()},
            "scatter": dict(self.baseline.scatter),
            "learnt": self.learnt,
            "held_back": self.held_back,
            "false_alarms": self.false_alarms,
            "notes": list(self.notes),
            **of_population,
        }


def calibrate(
    recordings: Given,
    template: ParameterSet | str | Path | Any | None = None,
    *,
    held_back: int | None = None,
    false_alarm_rate: float | None = None,
    known: Mapping[str, Given] | None = None,
    name: str | None = None,
    progress: Progress | bool | None = None,
    add_to: Calibration | str | Path | None = None,
) -> CalibrationReport:
    """Learn from healthy recordings how an actuator behaves, and how far healthy runs differ.

    Parameters
    ----------
    recordings : healthy ones, or the files or folders that hold them; one is enough for the twin;
        three runs over one command also give the healthy population by which kinds that one
        descent fits are judged; nuisances such as a load need not be known
    template : actuator of any kind to start from: parameters, the name of a shipped set, or a file;
        if not given the default one of the kind that has such channels
    held_back : runs, the last ones, that take no part in learning and set the thresholds; by
        default all runs are learnt from, and each, judged by the others, sets the thresholds
    false_alarm_rate : of a healthy recording, or run, of another day; 0.1 if not given
    known : recordings with a known fault, by a text ``fault`` or ``fault: remark``; each entry
        becomes a signature
    name : of the calibrated actuator
    progress : True shows a bar, in a terminal or a notebook; else called with the share done
    add_to : calibration, or its file, whose healthy runs these join: actuator and discrepancy stay,
        population and thresholds are learnt from all; ``template`` is not looked at, and one run
        is enough

    ``held_back``, ``false_alarm_rate``, ``known`` and ``add_to`` are of the healthy population, and
    refused for kinds without one.

    Raises
    ------
    RecordError
        If the recordings are not alike, too few, or one run is unlike the others.
    InputError
        If an option cannot be used.
    """
    with told(progress, "calibrating") as show:
        return _calibrated(
            recordings, template, held_back, false_alarm_rate, known or {}, name,
            show or (lambda share: None), add_to,
        )  # fmt: skip


def _calibrated(
    recordings: Given,
    template: ParameterSet | str | Path | Any | None,
    held_back: int | None,
    false_alarm_rate: float | None,
    known: Mapping[str, Given],
    name: str | None,
    tell: Progress,
    add_to: Calibration | str | Path | None,
) -> CalibrationReport:
    """Do what `calibrate` says, and tell ``tell`` of it."""
    rate = FALSE_ALARM_RATE if false_alarm_rate is None else false_alarm_rate
    if not 0.0 < rate < 0.5:
        raise InputError(f"The false alarm rate must lie between 0 and 0.5, received {rate:g}.")
    if add_to is not None:
        if held_back is not None:
            raise InputError(
                f"Runs that are added are judged by all others, received held_back={held_back}; "
                "leave it out."
            )
        return _added(recordings, add_to, rate, known, name, tell)
    chosen = actuator_of(recordings) if template is None else load_actuator(template)
    model = model_of(chosen)
    by_values = frees_parameters(model)
    asked = {
        "held_back": held_back is not None,
        "false_alarm_rate": false_alarm_rate is not None,
        "known": bool(known),
    }
    given = [option for option, wanted in asked.items() if wanted]
    if by_values and given:
        raise InputError(
            f"Actuators of the kind {model.kind} are judged by the values of their faults, not by "
            f"a healthy population; leave {' and '.join(given)} out."
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
    if few and (held_back is not None or known):
        raise RecordError(few)
    back = [] if by_values or few else _held_back(runs, held_back)
    learnt_runs = [run for run in runs if run not in back]
    learning = np.array([one.run not in back for one in healthy])
    settling = model.monitoring.settling_time(chosen)
    command, interval = healthy[0].channels[model.command], healthy[0].interval
    tell(0.05)
    taught = [one for one, own in zip(healthy, learning, strict=True) if own]
    first = None
    means: list[Comparison] = []
    if not by_values:
        first = Bench(model, chosen, healthy, command, interval, settling)
        means = _means(first, learning)
    if model.recordings_differ:
        few_of_them, left_out = _sound(model, chosen, taught)
    else:
        few_of_them, left_out = _evenly(taught, _MOST_LEARNT), []
    learnt = learn(
        model, chosen, [model.compare(one, chosen) for one in few_of_them],
        means=means, progress=lambda share: tell(0.05 + 0.45 * share),
    )  # fmt: skip
    actuator, parameters = learnt.actuator, learnt.parameters
    if name is not None:
        actuator = actuator.model_copy(update={"name": name})
    tell(0.5)
    if first is None or few:
        tell(1.0)
        notes = [*left_out, *learnt.notes]
        if few:
            notes.append(f"{few} Without that, ematwin detect cannot judge.")
        return CalibrationReport(
            Calibration(actuator, learnt.baseline), parameters, learnt.tied, learnt_runs,
            notes=tuple(notes),
        )  # fmt: skip
    bench = Bench(model, actuator, healthy, command, interval, settling, first.layout.channels)
    layout = bench.layout
    fit, discrepancy, scale = _with_discrepancy(bench, learning)
    measured = bench.measured(fit)
    tell(0.8)
    of_run = [one.run for one in healthy]
    kept = HealthyRuns.of(
        model, actuator, layout, measured,
        without_own_share(layout, measured, fit, scale, of_run, learning), of_run,
    )  # fmt: skip
    learning_runs = Learning(model, actuator, layout, kept, scale)
    learning_runs.check_outliers()
    calibration = PopulationCalibration(
        actuator=actuator,
        baseline=learnt.baseline,
        command=command,
        interval=interval,
        settling_time=settling,
        channels=layout.channels,
        discrepancy=discrepancy,
        **_learnt(learning_runs, ~learning, rate),
        facts={
            "runs": learnt_runs,
            "held_back": back,
            "motions": len(healthy),
            "labels": _labels_of(healthy),
            "sources": sorted({one.source for one in healthy}),
            "template": chosen.name,
            "undetermined": [p.place for p in parameters if not p.determined],
        },
    )
    calibration = replace(calibration, baseline=_with_population(calibration, measured))
    signatures = tuple(signature(calibration, fault, examples) for fault, examples in known.items())
    tell(1.0)
    return _report(
        replace(calibration, signatures=signatures), parameters, learnt.tied, learnt.notes
    )


def _sound(
    model: Model, actuator: ParameterSet, recordings: Sequence[Recording]
) -> tuple[list[Recording], list[str]]:
    """The recordings that can be learnt from, and sentences on the others.

    Raises
    ------
    RecordError
        If there is none.
    """
    why = [model.excitation(one, actuator) for one in recordings]
    sound = [one for one, told in zip(recordings, why, strict=True) if not told]
    if not sound:
        raise RecordError(f"No recording can be learnt from. Of the first one: {' '.join(why[0])}")
    return sound, [
        f"{one.name} was left out: {' '.join(told)}"
        for one, told in zip(recordings, why, strict=True)
        if told
    ]


def _evenly(recordings: Sequence[Recording], most: int) -> list[Recording]:
    """So many of the recordings at most, evenly chosen."""
    places = np.linspace(0, len(recordings) - 1, min(len(recordings), most))
    return [recordings[n] for n in np.unique(np.round(places).astype(int))]


def _with_population(calibration: PopulationCalibration, measured: Measured) -> Baseline:
    """The baseline with how far healthy runs differ, as the population says."""
    spread = calibration.population.spread.tolist()
    return replace(
        calibration.baseline,
        scatter=dict(zip(calibration.layout.magnitudes, spread, strict=False)),
        misfit=float(np.median([one.misfit for one in measured.estimates])),
        recordings=len(calibration.facts["runs"]),
    )


def _learnt(learning: Learning, held_back: np.ndarray, rate: float) -> dict[str, Any]:
    """What of a `Calibration` follows from its healthy runs.

    ``held_back`` (N,) of bool: recordings that only set the thresholds.
    """
    kept = learning.healthy
    population, reported = learning.populations(~held_back)
    motion, run, size = learning.limits(*learning.tested(held_back), rate)
    covariate = kept.covariate
    return {
        "population": population,
        "reported": reported,
        "thresholds": Thresholds(motion, run, size, rate),
        "statistics": {
            name: (float(found[~held_back].mean()), float(found[~held_back].std(ddof=1)))
            for name, found in kept.statistics.items()
        },
        "covariate_range": None
        if learning.scale is None
        else (float(covariate.min()), float(covariate.max())),
        "healthy": kept,
    }


def _report(
    calibration: PopulationCalibration,
    parameters: list[NominalParameter],
    tied: list[tuple[str, ...]],
    notes: list[str],
) -> CalibrationReport:
    """What is told of a calibration whose healthy runs are at hand."""
    back = calibration.facts["held_back"]
    over = calibration.tested().index() > calibration.thresholds.motion
    reported = calibration.reported
    runs = len(calibration.learning.healthy.names)
    return CalibrationReport(
        calibration,
        parameters,
        tied,
        calibration.facts["runs"],
        back,
        {
            one.name: (float(reported.within[n]), float(reported.between[n]))
            for n, one in enumerate(calibration.quantities)
        },
        float(over.mean()),
        (*notes, *_cautions(calibration.thresholds, calibration.layout, runs, len(back))),
    )


def _added(
    recordings: Given,
    add_to: Calibration | str | Path,
    rate: float,
    known: Mapping[str, Given],
    name: str | None,
    tell: Progress,
) -> CalibrationReport:
    """A calibration with more healthy runs, such as those of a later occasion."""
    before = add_to if isinstance(add_to, Calibration) else Calibration.load(add_to)
    if not isinstance(before, PopulationCalibration):
        raise InputError(
            f"The calibration of {before.actuator.name} has no healthy population to add to; "
            "calibrate anew with all healthy recordings."
        )
    if before.healthy is None:
        raise InputError(
            f"The calibration of {before.actuator.name} does not keep its healthy runs, as those "
            "of older versions do not; calibrate anew with all healthy recordings."
        )
    given = recordings_of(recordings, before.actuator)
    measured = before.measure(given)
    tell(0.6)
    for one_run in by_population(given, before, measured).runs:
        if one_run.grade in ("fault", "none"):
            raise RecordError(
                f"{one_run.name} is no healthy run by the calibration that it is to join "
                f"({one_run.reason.rstrip('.')}). Leave it out, or calibrate anew with it if it is "
                "healthy all the same."
            )
    taken, of_run = set(before.healthy.names), []
    for one in given:
        of_run.append(f"{one.run} of {one.source}" if one.run in taken else one.run)
    if before.healthy.holds(measured.features, before.layout.kinds) or taken & set(of_run):
        raise RecordError(
            f"Run {given[0].run} of {given[0].source} is among the healthy runs already; give runs "
            "that are new."
        )
    more = HealthyRuns.of(
        before.model, before.actuator, before.layout, measured, measured.features, of_run
    )
    actuator = before.actuator if name is None else before.actuator.model_copy(
        update={"name": name}
    )  # fmt: skip
    kept = before.healthy.with_more(more)
    learning = Learning(before.model, actuator, before.layout, kept, before.population.scale)
    after = replace(
        before,
        actuator=actuator,
        **_learnt(learning, np.zeros(len(kept.runs), dtype=bool), rate),
        signatures=(),
        facts={
            **before.facts,
            "runs": kept.names,
            "held_back": [],
            "motions": len(kept.runs),
            "labels": f"{before.facts.get('labels', 'none')}; added: {_labels_of(given)}",
            "sources": sorted({*before.facts.get("sources", []), *(one.source for one in given)}),
        },
    )
    signatures = [_restated(one, before.population, after.population) for one in before.signatures]
    signatures += [signature(after, fault, examples) for fault, examples in known.items()]
    tell(1.0)
    return _report(replace(after, signatures=tuple(signatures)), [], [], [])


def _restated(one: Signature, before: Population, after: Population) -> Signature:
    """A signature in the scores of another population over the same covariate."""
    raw = one.coefficients * before.spread + before.coefficients
    return replace(one, coefficients=(raw - after.coefficients) / after.spread)


def signature(calibration: PopulationCalibration, fault: str, recordings: Given) -> Signature:
    """What recordings with a known fault look like; ``fault`` as in `calibrate`."""
    given = recordings_of(recordings, calibration.actuator)
    measured = calibration.measure(given)
    scores = calibration.scores(measured).values
    limited = np.clip(scores, -REACH, REACH)
    runs = ", ".join(dict.fromkeys(one.run for one in given))
    said, colon, remark = fault.partition(":")
    return Signature(
        said.strip(),
        fit_mean(measured.covariate, calibration.population.scale, limited),
        f"{len(given)} motions{colon}{remark}, runs {runs}",
    )


def _means(bench: Bench, learning: np.ndarray) -> list[Comparison]:
    """The mean recording of each run and condition, evenly chosen where there are many.

    More than `_MOST_MEANS` make the fit slow, not better.
    """
    groups = np.unique(bench.groups[learning])
    places = np.linspace(0, len(groups) - 1, min(len(groups), _MOST_MEANS))
    means = []
    for group in groups[np.unique(np.round(places).astype(int))]:
        members = [bench.comparisons[n] for n in np.flatnonzero(bench.groups == group)]
        means.append(members[0].averaged(members[1:]))
    return means


def _held_back(runs: list[str], wanted: int | None) -> list[str]:
    """The runs that only set the thresholds; none where each is judged by the others."""
    if wanted is None:
        return []
    if not 1 <= wanted <= len(runs) - 2:
        raise InputError(
            f"Of {len(runs)} runs between 1 and {len(runs) - 2} can be held back, received "
            f"{wanted}."
        )
    return runs[-wanted:]


def _with_discrepancy(bench: Bench, learning: np.ndarray) -> tuple[Fit, np.ndarray, float | None]:
    """The last fit, the discrepancy of the twin over the covariate, and the covariate's scale."""
    fit = bench.fit(search=LocalDescent())  # healthy ones lie in the valley of health
    scale = None
    if bench.model.monitoring.covariate is not None:
        scale = float(np.sqrt((fit.covariate[learning] ** 2).mean())) or 1.0
    discrepancy = np.zeros(1)
    for _ in range(_ROUNDS):
        left = np.concatenate(list(fit.residuals.values()), axis=1)[learning]
        discrepancy = discrepancy + fit_mean(fit.covariate[learning], scale, left)
        fit = bench.fit(discrepancy, scale, fit)
    return fit, discrepancy, scale


def _cautions(thresholds: Thresholds, layout: Layout, runs: int, back: int) -> list[str]:
    reach = single_reach(layout.kinds)
    if max(thresholds.motion, thresholds.run) < reach:
        return []
    said = f"{runs - back} runs to learn from and {back} held back" if back else f"{runs} runs"
    return [
        f"The thresholds ({thresholds.motion:.2f} for a motion, {thresholds.run:.2f} for a run) "
        f"are so high that no single magnitude reaches them (at most {reach:.2f}): {said} say too "
        "little about how far healthy runs differ. Record more healthy runs, on other days."
    ]


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
