"""``calibrate``: from healthy recordings to a twin, its healthy population and its thresholds.

One recording is enough for the twin. The population, by which `detect` judges, takes three runs
over one command.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin import __version__
from ematwin.errors import InputError, RecordError
from ematwin.estimation.baseline import Baseline, frees_parameters
from ematwin.estimation.learn import learn, same_command
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.nominal import NominalParameter
from ematwin.files import written_whole
from ematwin.models.base import Model
from ematwin.models.channels_agree import checked
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.monitoring.calibration import Calibration, Thresholds
from ematwin.monitoring.classification import REACH, Signature
from ematwin.monitoring.features import Layout
from ematwin.monitoring.gather import Given, recordings_of
from ematwin.monitoring.healthy import HealthyRuns, Learning, without_own_share
from ematwin.monitoring.index import single_reach
from ematwin.monitoring.measure import Bench, Fit, Measured
from ematwin.monitoring.population import Population, fit_mean
from ematwin.monitoring.scores import FALSE_ALARM_RATE
from ematwin.recordings.recording import Recording
from ematwin.showing import markup
from ematwin.showing.bars import told
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
    actuator : with the values that were found
    baseline : how well they are known
    calibration : with the healthy population; None where there were too few runs over one command
    parameters : fitted ones, with what could not be determined; none where runs were added
    tied : groups of parameters of which only ratios or products are known
    run_spread : of each reported quantity, standard deviations within a run and between runs;
        of logarithms for multiples of healthy, else SI
    learnt, held_back : names of the runs; none is held back where each was judged by the others
    false_alarms : share of the recordings so judged above the threshold
    notes : sentences on what to be careful of
    """

    actuator: ParameterSet
    baseline: Baseline
    calibration: Calibration | None
    parameters: list[NominalParameter]
    tied: list[tuple[str, ...]]
    run_spread: dict[str, tuple[float, float]]
    learnt: list[str]
    held_back: list[str]
    false_alarms: float
    notes: tuple[str, ...] = ()

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
                *(markup.note(text) for text in self.notes),
            ]
        )

    def save(self, path: str | Path) -> None:
        """Write the calibrated actuator as a TOML file, with the sources of its parameters."""
        if self.calibration is not None:
            self.calibration.save(path, self.sources)
            return
        import tomli_w

        table = {**self.actuator.as_table(self.sources), "baseline": self.baseline.as_table()}
        with written_whole(path) as draft:
            draft.write_text(tomli_w.dumps(table), encoding="utf-8")

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        of_population: dict[str, object] = {"threshold": None, "signatures": []}
        if self.calibration is not None:
            of_population = {
                "threshold": vars(self.calibration.thresholds).copy(),
                "signatures": [s.fault for s in self.calibration.signatures],
            }
        return {
            "actuator": self.actuator.name,
            "kind": self.actuator.kind,
            "misfit": self.baseline.misfit if math.isfinite(self.baseline.misfit) else None,
            "tied": [list(group) for group in self.tied],
            "parameters": {p.place: vars(p).copy() for p in self.parameters},
            "spread": {k: {"within": a, "between": b} for k, (a, b) in self.run_spread.items()},
            "learnt": self.learnt,
            "held_back": self.held_back,
            "false_alarms": self.false_alarms,
            "notes": list(self.notes),
            **of_population,
        }


def calibrate(
    recordings: Given,
    template: ParameterSet | str | Path | Any = "rm1605",
    *,
    held_back: int | None = None,
    false_alarm_rate: float = FALSE_ALARM_RATE,
    known: Mapping[str, Given] | None = None,
    name: str | None = None,
    progress: Progress | bool | None = None,
    add_to: Calibration | str | Path | None = None,
) -> CalibrationReport:
    """Learn from healthy recordings how an actuator behaves, and how far healthy runs differ.

    Parameters
    ----------
    recordings : healthy ones, or the files that hold them; one is enough for the twin, three runs
        over one command also give the population that `detect` needs; nuisances such as a load
        need not be known
    template : actuator of any kind to start from: parameters, the name of a shipped set, or a file
    held_back : runs, the last ones, that take no part in learning and set the thresholds; by
        default all runs are learnt from, and each, judged by the others, sets the thresholds
    false_alarm_rate : of a healthy recording, or run, of another day
    known : recordings with a known fault, by a text ``fault`` or ``fault: remark``; each entry
        becomes a signature
    name : of the calibrated actuator
    progress : True shows a bar, in a terminal or a notebook; else called with the share done
    add_to : calibration, or its file, whose healthy runs these join: actuator and discrepancy stay,
        population and thresholds are learnt from all; ``template`` is not looked at, and one run
        is enough

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
    template: ParameterSet | str | Path | Any,
    held_back: int | None,
    false_alarm_rate: float,
    known: Mapping[str, Given],
    name: str | None,
    tell: Progress,
    add_to: Calibration | str | Path | None,
) -> CalibrationReport:
    """Do what `calibrate` says, and tell ``tell`` of it."""
    if not 0.0 < false_alarm_rate < 0.5:
        raise InputError(
            f"The false alarm rate must lie between 0 and 0.5, received {false_alarm_rate:g}."
        )
    if add_to is not None:
        if held_back is not None:
            raise InputError(
                f"Runs that are added are judged by all others, received held_back={held_back}; "
                "leave it out."
            )
        return _added(recordings, add_to, false_alarm_rate, known, name, tell)
    chosen = load_actuator(template)
    model = model_of(chosen)
    healthy = recordings_of(recordings, chosen)
    for one in healthy:
        _, barred = checked(model, one, chosen)
        if barred:
            raise RecordError(f"{one.name} is nothing to learn from: {' '.join(barred)}")
    runs = list(dict.fromkeys(one.run for one in healthy))
    wanted = held_back is not None or bool(known)
    obstacle = _no_population(model, healthy, runs)
    if obstacle and wanted:
        raise RecordError(obstacle)
    back = [] if obstacle else _held_back(runs, held_back)
    learnt_runs = [run for run in runs if run not in back]
    learning = np.array([one.run not in back for one in healthy])
    settling = model.settling_time(chosen)
    command, interval = healthy[0].channels[model.command], healthy[0].interval
    tell(0.05)
    taught = [one for one, own in zip(healthy, learning, strict=True) if own]
    first = None
    means: list[Comparison] = []
    if not frees_parameters(model):
        first = Bench(model, chosen, healthy, command, interval, settling)
        means = _means(first, learning)
    learnt = learn(
        model, chosen, [model.compare(one, chosen) for one in _evenly(taught, _MOST_LEARNT)],
        means=means, progress=lambda share: tell(0.05 + 0.45 * share),
    )  # fmt: skip
    actuator, parameters, baseline = learnt.actuator, learnt.parameters, learnt.baseline
    if name is not None:
        actuator = actuator.model_copy(update={"name": name})
    tell(0.5)
    if obstacle:
        tell(1.0)
        notes = (*learnt.notes, f"{obstacle} Without that, ematwin detect has no population.")
        return CalibrationReport(
            actuator, baseline, None, parameters, learnt.tied, {}, learnt_runs, [], 0.0, notes
        )
    channels = None if first is None else first.layout.channels
    bench = Bench(model, actuator, healthy, command, interval, settling, channels)
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
    calibration = Calibration(
        actuator=actuator,
        command=command,
        interval=interval,
        settling_time=settling,
        channels=layout.channels,
        discrepancy=discrepancy,
        **_learnt(learning_runs, ~learning, false_alarm_rate),
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
    baseline = _with_population(baseline, calibration, measured)
    calibration = replace(calibration, learnt_baseline=baseline)
    signatures = tuple(signature(calibration, fault, examples) for fault, examples in known.items())
    tell(1.0)
    return _report(
        replace(calibration, signatures=signatures), parameters, learnt.tied, learnt.notes
    )


def _no_population(model: Model, healthy: Sequence[Recording], runs: list[str]) -> str:
    """Why recordings make no population; "" if they do."""
    if len(runs) < 3:
        return (
            f"A population needs at least three healthy runs, so that two can judge the third; "
            f"received {len(runs)} ({', '.join(runs)}). Record more, on other days; a run is a "
            "file, or a value of the column run."
        )
    if frees_parameters(model):
        for one in healthy[1:]:
            if not same_command(one, healthy[0], model.command):
                return (
                    f"A population needs recordings over one command; {one.name} follows another "
                    f"than {healthy[0].name}."
                )
    return ""


def _evenly(recordings: Sequence[Recording], most: int) -> list[Recording]:
    """So many of the recordings at most, evenly chosen."""
    places = np.linspace(0, len(recordings) - 1, min(len(recordings), most))
    return [recordings[n] for n in np.unique(np.round(places).astype(int))]


def _with_population(baseline: Baseline, calibration: Calibration, measured: Measured) -> Baseline:
    """The baseline with how far healthy runs differ, where the population says more of it."""
    population, layout = calibration.population, calibration.layout
    scatter = dict(baseline.scatter)
    for n, name in enumerate(layout.magnitudes):
        scatter.setdefault(name, float(np.hypot(population.within[n], population.between[n])))
    misfit = baseline.misfit
    if not math.isfinite(misfit):
        misfit = float(np.median([one.misfit for one in measured.estimates]))
    runs = max(baseline.recordings, len(calibration.facts["runs"]))
    return replace(baseline, scatter=scatter, misfit=misfit, recordings=runs)


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
    calibration: Calibration,
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
        calibration.actuator,
        calibration.baseline,
        calibration,
        parameters,
        tied,
        {
            one.name: (float(reported.within[n]), float(reported.between[n]))
            for n, one in enumerate(calibration.model.reported(calibration.actuator))
        },
        calibration.facts["runs"],
        back,
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
    from ematwin.monitoring.detect import judge

    before = add_to if isinstance(add_to, Calibration) else Calibration.load(add_to)
    if before.healthy is None:
        raise InputError(
            f"The calibration of {before.actuator.name} does not keep its healthy runs, as those "
            "of older versions do not; calibrate anew with all healthy recordings."
        )
    given = recordings_of(recordings, before.actuator)
    measured = before.measure(given)
    tell(0.6)
    for verdict in judge(given, measured, before).runs:
        if verdict.grade in ("fault", "none"):
            raise RecordError(
                f"{verdict.name} is no healthy run by the calibration that it is to join "
                f"({verdict.reason.rstrip('.')}). Leave it out, or calibrate anew with it if it is "
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


def signature(calibration: Calibration, fault: str, recordings: Given) -> Signature:
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
    if bench.model.covariate is not None:
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
