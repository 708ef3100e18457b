"""``calibrate``: from healthy motions to a twin, its healthy population and its thresholds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ematwin import __version__
from ematwin.errors import InputError, RecordError
from ematwin.monitoring.calibration import Calibration, Signature, Thresholds
from ematwin.monitoring.features import Layout
from ematwin.monitoring.index import health_index, prediction_bound, single_reach
from ematwin.monitoring.measure import REPORTED, Bench, Measured, reported_values
from ematwin.monitoring.naming import REACH
from ematwin.monitoring.nominal import MeanMotion, NominalParameter, fit_nominal
from ematwin.monitoring.phases import SETTLED, phases
from ematwin.monitoring.population import Population, fit_parabola
from ematwin.plant.ball_screw import BallScrew
from ematwin.readers.motions import labels_of
from ematwin.signals.motion import Motion

Progress = Callable[[float], None]
FALSE_ALARM_RATE = 0.1
_MOST_MEANS = 24  # mean motions that the nominal parameters are fitted to
_ROUNDS = 2  # of discrepancy and magnitudes in turn
_OUTLIER = 4.0  # robust standard deviations of the logarithm of a run's index
_LEAST_SCATTER = 0.15  # of that logarithm: few runs may agree by chance
_ODD = 8.0  # robust standard deviations of a magnitude
# Of friction and gain (logarithms) and backlash (m): no healthy run is that far off.
_LEAST_ODD = {"friction": (0.25, "%"), "backlash": (5e-4, "mm"), "gain": (0.25, "%")}


@dataclass(frozen=True)
class CalibrationReport:
    """What a calibration found.

    Attributes
    ----------
    calibration : Calibration
    parameters : fitted ones, with what could not be determined
    run_spread : of each reported magnitude, standard deviations within a run and between runs;
        logarithms of ratios, backlash in m
    learnt, held_back : names of the runs
    false_alarms : share of the held-back motions above the threshold
    notes : sentences on what to be careful of
    """

    calibration: Calibration
    parameters: list[NominalParameter]
    run_spread: dict[str, tuple[float, float]]
    learnt: list[str]
    held_back: list[str]
    false_alarms: float
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        limits = self.calibration.thresholds
        return {
            "actuator": self.calibration.actuator.name,
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
    motions: list[Motion],
    template: BallScrew | str | Path = "rm1605",
    *,
    held_back: int | None = None,
    false_alarm_rate: float = FALSE_ALARM_RATE,
    known: Mapping[str, list[Motion]] | None = None,
    name: str | None = None,
    progress: Progress | None = None,
) -> CalibrationReport:
    """Learn from healthy motions how the actuator behaves, and how far healthy runs differ.

    Parameters
    ----------
    motions : healthy ones, of at least three runs, all over one command; their loads need not be
        known
    template : parameters to start from
    held_back : runs, the last ones, that take no part in learning and set the thresholds; by
        default two of five or more, else one
    false_alarm_rate : of a healthy motion, or run, of another day
    known : motions with a known fault, by a text ``fault`` or ``fault: remark``; each entry
        becomes a signature
    name : of the calibrated actuator
    progress : called with the share done

    Raises
    ------
    RecordError
        If the motions are not alike, too few, or one run is unlike the others.
    InputError
        If an option cannot be used.
    """
    template = BallScrew.load(template)
    tell = progress or (lambda share: None)
    if not 0.0 < false_alarm_rate < 0.5:
        raise InputError(
            f"The false alarm rate must lie between 0 and 0.5, received {false_alarm_rate:g}."
        )
    runs = list(dict.fromkeys(motion.run for motion in motions))
    back = _held_back(runs, held_back)
    learnt_runs = [run for run in runs if run not in back]
    learning = np.array([motion.run not in back for motion in motions])
    set_point, interval = motions[0].set_point, motions[0].interval
    settling = SETTLED / template.controller.position_gain
    layout = Layout.of(phases(set_point, interval, settling))
    bench = Bench(motions, set_point, interval, layout)
    groups = numbered([motion.together for motion in motions])
    tell(0.1)
    actuator, parameters = fit_nominal(
        template,
        set_point,
        interval,
        [
            MeanMotion(bench.current[own].mean(0), bench.position_error[own].mean(0))
            for own in (groups == g for g in _spread_out(np.unique(groups[learning])))
        ],
    )
    if name is not None:
        actuator = actuator.model_copy(update={"name": name})
    tell(0.5)
    measured, discrepancy, scale = _with_discrepancy(bench, actuator, learning)
    tell(0.8)
    features = bench.features(measured)
    values = reported_values(layout, features)
    _check_outliers(features, values, measured.load, groups, motions, scale, layout.kinds)
    learnt = (measured.load[learning], groups[learning], scale)
    population = Population.of(features[learning], *learnt)
    reported = Population.of(values[learning], *learnt)
    scores = population.scores(features, measured.load)
    thresholds = _thresholds(scores[~learning], groups[~learning], layout.kinds, false_alarm_rate)
    over = health_index(scores[~learning], layout.kinds) > thresholds.motion
    calibration = Calibration(
        actuator=actuator,
        set_point=set_point,
        interval=interval,
        settling_time=settling,
        discrepancy=discrepancy,
        population=population,
        reported=reported,
        thresholds=thresholds,
        coupling=(
            float(measured.coupling[learning].mean()),
            float(measured.coupling[learning].std(ddof=1)),
        ),
        load_range=(float(measured.load.min()), float(measured.load.max())),
        facts={
            "runs": learnt_runs,
            "held_back": back,
            "motions": len(motions),
            "labels": labels_of(motions),
            "sources": sorted({motion.source for motion in motions}),
            "template": template.name,
            "undetermined": [p.place for p in parameters if not p.determined],
        },
    )
    signatures = tuple(
        _signature(calibration, fault, examples) for fault, examples in (known or {}).items()
    )
    tell(1.0)
    spread = {
        key: (float(reported.within[n]), float(reported.between[n]))
        for n, key in enumerate(REPORTED)
    }
    return CalibrationReport(
        replace(calibration, signatures=signatures),
        parameters,
        spread,
        learnt_runs,
        back,
        float(over.mean()),
        tuple(_cautions(thresholds, len(runs), len(back))),
    )


def _cautions(thresholds: Thresholds, runs: int, back: int) -> list[str]:
    if max(thresholds.motion, thresholds.run) < single_reach():
        return []
    return [
        f"The thresholds ({thresholds.motion:.2f} for a motion, {thresholds.run:.2f} for a run) "
        f"are so high that no single magnitude reaches them (at most {single_reach():.2f}): "
        f"{runs - back} runs to learn from and {back} held back tell too little of how healthy "
        "runs differ. Record more healthy runs, on other days."
    ]


def sources_of(report: CalibrationReport) -> dict[str, str]:
    """Where the value of each fitted parameter comes from, for the parameter file."""
    runs = ", ".join(report.learnt)
    return {
        p.place: f"calibrated on healthy runs {runs} with ematwin {__version__}, standard error "
        f"{p.standard_error:.3g}"
        if p.determined
        else f"not determined by the healthy runs: the template's {p.template:.4g} holds it"
        for p in report.parameters
    }


def measure(calibration: Calibration, motions: list[Motion]) -> tuple[np.ndarray, Measured]:
    """Features (N, F) and measurements of motions, with a calibrated actuator."""
    bench = Bench(motions, calibration.set_point, calibration.interval, calibration.layout)
    first = bench.measure(calibration.actuator)
    scale = calibration.population.load_scale
    measured = bench.measure(calibration.actuator, calibration.discrepancy, scale, first.magnitudes)
    return bench.features(measured), measured


def numbered(keys: list[tuple[str, ...]]) -> np.ndarray:
    """Number (N,) of each key, equal for equal keys, in the order of their first appearance."""
    order = {key: n for n, key in enumerate(dict.fromkeys(keys))}
    return np.array([order[key] for key in keys])


def _spread_out(groups: np.ndarray) -> np.ndarray:
    """At most `_MOST_MEANS` of the groups, evenly chosen: more make the fit slow, not better."""
    places = np.linspace(0, len(groups) - 1, min(len(groups), _MOST_MEANS))
    return groups[np.unique(np.round(places).astype(int))]


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


def _with_discrepancy(
    bench: Bench, actuator: BallScrew, learning: np.ndarray
) -> tuple[Measured, np.ndarray, float]:
    """Measurements, the discrepancy of the twin (3, 2 S), and the scale of the load."""
    measured = bench.measure(actuator)
    load = measured.load[learning]
    scale = float(np.sqrt((load**2).mean())) or 1.0
    discrepancy = np.zeros((3, 2 * bench.set_point.size))
    for _ in range(_ROUNDS):
        left = np.concatenate([measured.current, measured.position_error], axis=1)[learning]
        more = fit_parabola(measured.load[learning], scale, left)
        discrepancy = discrepancy + more
        measured = bench.measure(actuator, discrepancy, scale, measured.magnitudes)
    return measured, discrepancy, scale


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


def _check_outliers(
    features: np.ndarray,
    values: np.ndarray,
    load: np.ndarray,
    groups: np.ndarray,
    motions: list[Motion],
    scale: float,
    kinds: Sequence[str],
) -> None:
    """Refuse a run that is unlike all others: it may be a faulty one among the healthy."""
    of_run = np.array([motion.run for motion in motions])
    runs = list(dict.fromkeys(of_run))
    if len(runs) < 4:
        return  # of three, nobody can tell which one is the odd one
    index = []
    for run in runs:
        others = of_run != run
        population = Population.of(features[others], load[others], groups[others], scale)
        own = population.scores(features[~others], load[~others])
        means = [own[groups[~others] == g].mean(0) for g in np.unique(groups[~others])]
        index.append(float(np.log(np.mean(health_index(np.stack(means), kinds)))))
    level = np.array(index)
    for n, run in enumerate(runs):
        rest = np.delete(level, n)
        away = level[n] - float(np.median(rest))
        if away > _OUTLIER * max(_robust_spread(rest), _LEAST_SCATTER):
            raise _odd_one(
                run, len(runs), f"{np.exp(away):.1f} times as far from the others as they"
            )
    for k, (name, (least, unit)) in enumerate(_LEAST_ODD.items()):
        level = np.array([values[of_run == run, k].mean() for run in runs])
        for n, run in enumerate(runs):
            rest = np.delete(level, n)
            away = abs(level[n] - float(np.median(rest)))
            if away > max(_ODD * _robust_spread(rest), least):
                shown = 1e3 * away if unit == "mm" else 100.0 * away
                raise _odd_one(run, len(runs), f"{name} {shown:.2g} {unit} further off than they")


def _robust_spread(values: np.ndarray) -> float:
    """Standard deviation by the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _odd_one(run: str, count: int, how: str) -> RecordError:
    return RecordError(
        f"Run {run} is unlike the other {count - 1} healthy runs: it lies {how} lie from each "
        "other. If it is faulty or of another rig, leave it out (--where)."
    )


def _signature(calibration: Calibration, fault: str, motions: list[Motion]) -> Signature:
    features, measured = measure(calibration, motions)
    scores = calibration.population.scores(features, measured.load)
    limited = np.clip(scores, -REACH, REACH)
    scale = calibration.population.load_scale
    runs = ", ".join(dict.fromkeys(motion.run for motion in motions))
    return Signature(
        fault.partition(":")[0].strip(),
        fit_parabola(measured.load, scale, limited),
        f"{len(motions)} motions{fault.partition(':')[1]}{fault.partition(':')[2]}, runs {runs}",
    )
