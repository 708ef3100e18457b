"""``calibrate``: from healthy recordings to a twin, its healthy population and its thresholds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin import __version__
from ematwin.errors import InputError, RecordError
from ematwin.estimation.nominal import NominalParameter, fit_nominal
from ematwin.models.base import Model, Reported
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.monitoring.calibration import Calibration, Thresholds
from ematwin.monitoring.classification import REACH, Signature
from ematwin.monitoring.features import Layout
from ematwin.monitoring.gather import Given, recordings_of
from ematwin.monitoring.index import health_index, prediction_bound, single_reach
from ematwin.monitoring.measure import Bench, Fit, Measured, reported_values, statistics_of
from ematwin.monitoring.population import Population, fit_mean
from ematwin.monitoring.scores import FALSE_ALARM_RATE, Scores
from ematwin.recordings.recording import Recording

Progress = Callable[[float], None]
_MOST_MEANS = 24  # mean recordings that the nominal parameters are fitted to
_ROUNDS = 2  # of discrepancy and values in turn
_OUTLIER = 4.0  # robust standard deviations of the logarithm of a run's index
_LEAST_SCATTER = 0.15  # of that logarithm: few runs may agree by chance
_ODD = 8.0  # robust standard deviations of what is reported
_MOST_LABELS = 20  # values of one label that are listed


@dataclass(frozen=True)
class CalibrationReport:
    """What a calibration found.

    Attributes
    ----------
    calibration : Calibration
    parameters : fitted ones, with what could not be determined
    run_spread : of each reported quantity, standard deviations within a run and between runs;
        of logarithms for multiples of healthy, else SI
    learnt, held_back : names of the runs
    false_alarms : share of the held-back recordings above the threshold
    notes : sentences on what to be careful of
    """

    calibration: Calibration
    parameters: list[NominalParameter]
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
            else f"not determined by the healthy runs; kept at the template's {p.template:.4g}"
            for p in self.parameters
        }

    def save(self, path: str | Path) -> None:
        """Write the calibration as a TOML file, with the sources of its parameters."""
        self.calibration.save(path, self.sources)

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        limits = self.calibration.thresholds
        return {
            "actuator": self.calibration.actuator.name,
            "kind": self.calibration.actuator.kind,
            "parameters": {p.place: vars(p).copy() for p in self.parameters},
            "spread": {k: {"within": a, "between": b} for k, (a, b) in self.run_spread.items()},
            "learnt": self.learnt,
            "held_back": self.held_back,
            "false_alarms": self.false_alarms,
            "notes": list(self.notes),
            "threshold": vars(limits).copy(),
            "signatures": [s.fault for s in self.calibration.signatures],
        }


def calibrate(
    recordings: Given,
    template: ParameterSet | str | Path | Any = "rm1605",
    *,
    held_back: int | None = None,
    false_alarm_rate: float = FALSE_ALARM_RATE,
    known: Mapping[str, Given] | None = None,
    name: str | None = None,
    progress: Progress | None = None,
) -> CalibrationReport:
    """Learn from healthy recordings how an actuator behaves, and how far healthy runs differ.

    Parameters
    ----------
    recordings : healthy ones, or the files that hold them, of at least three runs, all over one
        command; nuisances such as a load need not be known
    template : actuator of any kind to start from: parameters, the name of a shipped set, or a file
    held_back : runs, the last ones, that take no part in learning and set the thresholds; by
        default two of five or more, else one
    false_alarm_rate : of a healthy recording, or run, of another day
    known : recordings with a known fault, by a text ``fault`` or ``fault: remark``; each entry
        becomes a signature
    name : of the calibrated actuator
    progress : called with the share done

    Raises
    ------
    RecordError
        If the recordings are not alike, too few, or one run is unlike the others.
    InputError
        If an option cannot be used.
    """
    chosen = load_actuator(template)
    model = model_of(chosen)
    tell = progress or (lambda share: None)
    if not 0.0 < false_alarm_rate < 0.5:
        raise InputError(
            f"The false alarm rate must lie between 0 and 0.5, received {false_alarm_rate:g}."
        )
    healthy = recordings_of(recordings, chosen)
    runs = list(dict.fromkeys(one.run for one in healthy))
    back = _held_back(runs, held_back)
    learnt_runs = [run for run in runs if run not in back]
    learning = np.array([one.run not in back for one in healthy])
    settling = model.settling_time(chosen)
    model.check_channels(healthy[0])
    command, interval = healthy[0].channels[model.command], healthy[0].interval
    first = Bench(model, chosen, healthy, command, interval, settling)
    groups = first.groups
    tell(0.1)
    actuator, parameters = fit_nominal(model, chosen, _means(first, learning))
    if name is not None:
        actuator = actuator.model_copy(update={"name": name})
    tell(0.5)
    bench = Bench(model, actuator, healthy, command, interval, settling, first.layout.channels)
    layout = bench.layout
    fit, discrepancy, scale = _with_discrepancy(bench, learning)
    measured = bench.measured(fit)
    tell(0.8)
    values = reported_values(model, actuator, layout, measured.features)
    healthy_runs = _Healthy(model, actuator, layout, measured, values, healthy, scale)
    healthy_runs.check_outliers()
    population, reported = healthy_runs.populations(learning)
    scores = Scores(
        population.scores(measured.features, measured.covariate), layout.names, layout.kinds, groups
    )
    thresholds = _thresholds(
        scores.values[~learning], groups[~learning], layout.kinds, false_alarm_rate
    )
    over = scores.index()[~learning] > thresholds.motion
    has_covariate = model.covariate is not None
    statistics = statistics_of([e for e, own in zip(measured.estimates, learning, strict=True)
                                if own])  # fmt: skip
    calibration = Calibration(
        actuator=actuator,
        command=command,
        interval=interval,
        settling_time=settling,
        channels=layout.channels,
        discrepancy=discrepancy,
        population=population,
        reported=reported,
        thresholds=thresholds,
        statistics={
            name: (float(found.mean()), float(found.std(ddof=1)))
            for name, found in statistics.items()
        },
        covariate_range=(float(measured.covariate.min()), float(measured.covariate.max()))
        if has_covariate
        else None,
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
    signatures = tuple(
        signature(calibration, fault, examples) for fault, examples in (known or {}).items()
    )
    tell(1.0)
    return CalibrationReport(
        replace(calibration, signatures=signatures),
        parameters,
        {
            one.name: (float(reported.within[n]), float(reported.between[n]))
            for n, one in enumerate(model.reported(actuator))
        },
        learnt_runs,
        back,
        float(over.mean()),
        tuple(_cautions(thresholds, layout, len(runs), len(back))),
    )


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
    if len(runs) < 3:
        raise RecordError(
            f"A calibration needs at least three healthy runs, two to learn from and one to set "
            f"the threshold; received {len(runs)} ({', '.join(runs)}). Record more, on other days; "
            "a run is a file, or a value of the column run."
        )
    count = wanted if wanted is not None else (2 if len(runs) >= 5 else 1)
    if not 1 <= count <= len(runs) - 2:
        raise InputError(
            f"Of {len(runs)} runs between 1 and {len(runs) - 2} can be held back, received {count}."
        )
    return runs[-count:]


def _with_discrepancy(bench: Bench, learning: np.ndarray) -> tuple[Fit, np.ndarray, float | None]:
    """The last fit, the discrepancy of the twin over the covariate, and the covariate's scale."""
    fit = bench.fit()
    scale = None
    if bench.model.covariate is not None:
        scale = float(np.sqrt((fit.covariate[learning] ** 2).mean())) or 1.0
    discrepancy = np.zeros(1)
    for _ in range(_ROUNDS):
        left = np.concatenate(list(fit.residuals.values()), axis=1)[learning]
        discrepancy = discrepancy + fit_mean(fit.covariate[learning], scale, left)
        fit = bench.fit(discrepancy, scale, fit)
    return fit, discrepancy, scale


def _thresholds(
    scores: np.ndarray, groups: np.ndarray, kinds: Sequence[str], rate: float
) -> Thresholds:
    runs = np.unique(groups)
    means = np.stack([scores[groups == g].mean(0) for g in runs])
    return Thresholds(
        motion=prediction_bound(health_index(scores, kinds), groups, rate),
        run=prediction_bound(health_index(means, kinds), runs, rate),
        run_size=len(scores) / len(runs),
        false_alarm_rate=rate,
    )


def _cautions(thresholds: Thresholds, layout: Layout, runs: int, back: int) -> list[str]:
    reach = single_reach(layout.kinds)
    if max(thresholds.motion, thresholds.run) < reach:
        return []
    return [
        f"The thresholds ({thresholds.motion:.2f} for a motion, {thresholds.run:.2f} for a run) "
        f"are so high that no single magnitude reaches them (at most {reach:.2f}): {runs - back} "
        f"runs to learn from and {back} held back say too little about how far healthy runs "
        "differ. Record more healthy runs, on other days."
    ]


@dataclass(frozen=True)
class _Healthy:
    """Healthy recordings with what was measured on them."""

    model: Model
    actuator: ParameterSet
    layout: Layout
    measured: Measured
    values: np.ndarray
    recordings: list[Recording]
    scale: float | None

    def populations(self, members: np.ndarray) -> tuple[Population, Population]:
        """Of the features, and of what is reported, from members (N,) of bool."""
        magnitudes = self.layout.magnitudes
        unknowns = {one.name: one for one in self.model.faults(self.actuator)}
        on_bound = np.array([
            unknowns[name].healthy in (unknowns[name].lower, unknowns[name].upper)
            for name in magnitudes
        ], dtype=bool)  # fmt: skip
        errors = self.measured.errors(self.layout, members)
        cut = np.zeros(errors.shape, dtype=bool)
        cut[: len(magnitudes)] = on_bound
        population = self._population(self.measured.features, members, errors, cut)
        reported = self.model.reported(self.actuator)
        own_errors, own_cut = np.zeros(len(reported)), np.zeros(len(reported), dtype=bool)
        for n, one in enumerate(reported):
            if one.name in magnitudes:
                place = magnitudes.index(one.name)
                own_errors[n], own_cut[n] = errors[place], cut[place]
                if one.logarithmic:
                    own_errors[n] /= float(np.exp(self.values[members, n].mean()))
        return population, self._population(self.values, members, own_errors, own_cut)

    def _population(
        self, features: np.ndarray, members: np.ndarray, errors: np.ndarray, cut: np.ndarray
    ) -> Population:
        measured = self.measured
        return Population.of(
            features[members], measured.covariate[members], measured.groups[members], self.scale,
            errors, cut,
        )  # fmt: skip

    def check_outliers(self) -> None:
        """Refuse a run that is unlike all others: it may be a faulty one among the healthy."""
        measured, kinds = self.measured, self.layout.kinds
        groups, covariate = measured.groups, measured.covariate
        of_run = np.array([one.run for one in self.recordings])
        runs = list(dict.fromkeys(of_run.tolist()))
        if len(runs) < 4:
            return  # of three, nobody can tell which one is the odd one
        index = []
        for run in runs:
            others = of_run != run
            population, _ = self.populations(others)
            own = population.scores(measured.features[~others], covariate[~others])
            means = [own[groups[~others] == g].mean(0) for g in np.unique(groups[~others])]
            index.append(float(np.log(np.mean(health_index(np.stack(means), kinds)))))
        level = np.array(index)
        for n, run in enumerate(runs):
            rest = np.delete(level, n)
            away = level[n] - float(np.median(rest))
            if away > _OUTLIER * max(_robust_spread(rest), _LEAST_SCATTER):
                raise _odd_one(
                    run, len(runs), f"it lies {np.exp(away):.1f} times as far from the others as "
                    "they lie from each other",
                )  # fmt: skip
        for k, one in enumerate(self.model.reported(self.actuator)):
            if not np.isfinite(one.least):
                continue
            level = np.array([self.values[of_run == run, k].mean() for run in runs])
            for n, run in enumerate(runs):
                rest = np.delete(level, n)
                away = abs(level[n] - float(np.median(rest)))
                if away > max(_ODD * _robust_spread(rest), one.least):
                    raise _odd_one(
                        run, len(runs), f"its {one.name} differs from theirs by {_shown(one, away)}"
                    )


def _shown(one: Reported, away: float) -> str:
    """A difference as people read it."""
    if one.logarithmic:
        return f"{100.0 * away:.2g} %"
    return f"{one.scale * away:.2g} {one.unit}".rstrip()


def _robust_spread(values: np.ndarray) -> float:
    """Standard deviation by the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _odd_one(run: str, count: int, how: str) -> RecordError:
    return RecordError(
        f"Run {run} is unlike the other {count - 1} healthy runs: {how}. If it is faulty or of "
        "another rig, leave it out."
    )


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
