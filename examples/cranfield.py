"""Faults of a real ball-screw actuator: calibrate on healthy runs, judge the others.

The recordings are those of Ruiz-Carcel and Starr (Cranfield University,
doi:10.17862/cranfield.rd.5097649), as one table: condition, load_kgf, run, motion, time_s,
set_point_mm, position_error_mm, current_a. They are not part of ematwin.

python examples/cranfield.py runs_1_to_5.parquet             (each run judged by the others)
python examples/cranfield.py runs_1_to_5.parquet --judge runs_6_to_10.parquet
python examples/cranfield.py runs_1_to_5.parquet --rotate    (with three or four runs to learn from)
python examples/cranfield.py runs_1_to_5.parquet --drift     (healthy runs made to drift)
"""

import argparse
import itertools
from pathlib import Path

import numpy as np

import ematwin
from ematwin.models.reading import read
from ematwin.monitoring.calibration import CalibrationReport
from ematwin.monitoring.detection import Detection, Diagnosis
from ematwin.report.detection import detection_page

HEALTHY = "normal"
FAULTS = {
    "lackLubrication1": "lubrication",
    "lackLubrication2": "lubrication",
    "backlash1": "backlash",
    "backlash2": "backlash",
    **{f"spalling{stage}": "spalling" for stage in range(1, 9)},
}
TAUGHT = [name for name in FAULTS if name not in {f"spalling{stage}" for stage in range(1, 6)}]
RUNS = ("1", "2", "3", "4", "5")
LEARNING, THRESHOLD = RUNS[:3], RUNS[3:]  # of the PCA
Motions = list[ematwin.Recording]


def main() -> None:
    """Print the tables and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", nargs="?", type=Path, help="runs 1 to 5, healthy and faulty")
    parser.add_argument("--judge", type=Path, help="runs that took no part in anything")
    parser.add_argument("--out", type=Path, default=Path("cranfield"), help="folder for the page")
    parser.add_argument("--rotate", action="store_true", help="false alarms with fewer runs")
    parser.add_argument(
        "--drift", action="store_true", help="false alarms where healthy runs drift"
    )
    given = parser.parse_args()
    if given.recordings is None or not given.recordings.exists():
        print(
            "Give the file with the recordings. They are published at "
            "https://doi.org/10.17862/cranfield.rd.5097649; docs/real-recordings.md says how to "
            "bring them into one table."
        )
        return
    motions = read(given.recordings, actuator="rm1605", split=True)
    if given.rotate:
        rotate(motions)
        return
    if given.drift:
        drift(motions)
        return
    if given.judge is None:
        print("each run judged by healthy and faulty recordings of the other four\n")
        judged = motions
        folds = [(tuple(run for run in RUNS if run != out), (out,)) for out in RUNS]
    else:
        print("learnt from healthy and faulty runs 1 to 5, judged on others\n")
        judged = read(given.judge, actuator="rm1605", split=True)
        folds = [(RUNS, tuple(dict.fromkeys(motion.run for motion in judged)))]
    found: list[Detection] = []
    order: Motions = []
    for teaching, runs in folds:
        report = calibrated(motions, teaching, teaching)
        own = [motion for motion in judged if motion.run in runs]
        found.append(ematwin.detect(own, report.calibration))
        order += own
    table(found, pca(motions, order))
    loads(found)
    report = calibrated(motions, RUNS, RUNS)
    given.out.mkdir(parents=True, exist_ok=True)
    report.save(given.out / "calibrated.toml")
    page = given.out / "report.html"
    page.write_text(detection_page(ematwin.detect(judged, report.calibration)), encoding="utf-8")
    print(f"wrote {page}")


def table(found: list[Detection], ways: dict[str, list[bool]]) -> None:
    """A row for each condition."""
    runs = [verdict for one in found for verdict in one.runs]
    single = [verdict for one in found for verdict in one.motions]
    print("% of runs and of motions; unsure: no verdict")
    heading = ["alarm", "unsure", "right", "alarm", "unsure", "right", *ways]
    print(f"{'':<18}{'by run':>20}{'by motion':>30}{'motions in alarm where':>26}")
    print(f"{'':<18}" + "".join(f"{text:>{12 if text in ways else 10}}" for text in heading))
    of = [verdict.labels["condition"] for verdict in single]
    for condition in dict.fromkeys([HEALTHY, *FAULTS]):
        if condition not in of:
            continue
        line = f"{condition:<18}"
        for verdicts in (runs, single):
            own = [v for v in verdicts if v.labels["condition"] == condition]
            alarms = [v for v in own if v.alarm]
            right = [v.fault == FAULTS.get(condition) for v in alarms]
            line += f"{100 * len(alarms) / len(own):>10.0f}"
            line += f"{100 * np.mean([v.grade == 'none' for v in own]):>10.0f}"
            line += f"{100 * np.mean(right):>10.0f}" if right and condition in FAULTS else " " * 10
        for way in ways.values():
            own_way = [x for x, c in zip(way, of, strict=True) if c == condition]
            line += f"{100 * np.mean(own_way):>12.0f}"
        print(line)
    print("\nright: % of the alarms that bear the right name; spalling 1 to 5 taught none")


def calibrated(
    motions: Motions, learning: tuple[str, ...], teaching: tuple[str, ...]
) -> CalibrationReport:
    """Calibrated on healthy runs, with a signature for each taught stage of a fault."""
    healthy = [
        motion
        for run in learning
        for motion in motions
        if motion.labels["condition"] == HEALTHY and motion.run == run
    ]
    known = {
        f"{FAULTS[stage]}: {stage}": [
            m for m in motions if m.labels["condition"] == stage and m.run in teaching
        ]
        for stage in TAUGHT
        if teaching
    }
    return ematwin.calibrate(healthy, known=known, name="cranfield")


def pca(motions: Motions, judged: Motions) -> dict[str, list[bool]]:
    """Alarms of T2 and Q of a PCA on 20 features of a motion, rebuilt after the data's paper.

    Its list of features is not at hand; these are of the kind that it describes: of each way, size
    and shape of the transient and level and unrest of steady motion, of current and error. Fitted
    on runs 1 to 3, components for 90 % of the variance, thresholds at 90 % of runs 4 and 5.
    """
    try:
        from sklearn.decomposition import PCA
        from sklearn.preprocessing import StandardScaler
    except ImportError:
        print("(without the columns of PCA: they need scikit-learn)\n")
        return {}

    # samples of the transient and of the steady part, out and back
    ways = ((slice(0, 35), slice(35, 125)), (slice(200, 240), slice(240, 324)))

    def features(motion: ematwin.Recording) -> list[float]:
        values = []
        for transient, steady in ways:
            for signal in (motion.current, motion.position_error):
                start, rest = signal[transient], signal[steady]
                values += [
                    start.mean(), np.abs(start).max(), float(np.abs(start).argmax()),
                    rest.mean(), rest.std(),
                ]  # fmt: skip
        return values

    def table(some: Motions) -> np.ndarray:
        return np.array([features(motion) for motion in some])

    healthy = [m for m in motions if m.labels["condition"] == HEALTHY]
    learning = table([m for m in healthy if m.run in LEARNING])
    scaler = StandardScaler().fit(learning)
    model = PCA(0.9, svd_solver="full").fit(scaler.transform(learning))

    def statistics(some: Motions) -> tuple[np.ndarray, np.ndarray]:
        scaled = scaler.transform(table(some))
        scores = model.transform(scaled)
        left = scaled - model.inverse_transform(scores)
        return (scores**2 / model.explained_variance_).sum(1), (left**2).sum(1)

    limits = [np.quantile(x, 0.9) for x in statistics([m for m in healthy if m.run in THRESHOLD])]
    t2, q = statistics(judged)
    return {"T2": list(t2 > limits[0]), "Q": list(q > limits[1])}


def loads(found: list[Detection]) -> None:
    """What the twin, which is told no load, says of it, beside what the rig held."""
    verdicts = [verdict for one in found for verdict in one.motions]
    held = sorted({verdict.labels["load_kgf"] for verdict in verdicts}, key=float)
    print("\nload held by the rig, and as estimated from healthy motions (mean, spread), N")
    for text in held:
        own = [
            v.standing.covariate.value
            for v in verdicts
            if v.labels["load_kgf"] == text and v.labels["condition"] == HEALTHY
        ]
        if own:
            print(f"{9.80665 * float(text):>8.0f} {np.mean(own):>8.0f} {np.std(own):>6.0f}")


def rotate(motions: Motions) -> None:
    """False alarms on a healthy run that taught nothing, with three or four runs to learn from."""
    for count in (3, 4):
        single, together = [], []
        for out in RUNS:
            rest = [run for run in RUNS if run != out]
            for learning in itertools.combinations(rest, count):
                report = calibrated(motions, learning, learning)
                own = [m for m in motions if m.labels["condition"] == HEALTHY and m.run == out]
                found = ematwin.detect(own, report.calibration)
                single += found.motions
                together += found.runs
        print(f"{count} runs to learn from: {rates(single, 'motions')}; {rates(together, 'runs')}")


def drift(motions: Motions) -> None:
    """False alarms where friction and the current's level of healthy runs drift under one load.

    By one and two healthy deviations: of the friction that is estimated from single motions, and of
    the mean current of motions under that load. Each run is judged by the other four.
    """
    healthy = [m for m in motions if m.labels["condition"] == HEALTHY]
    reports = {}
    for out in RUNS:
        rest = tuple(run for run in RUNS if run != out)
        reports[out] = calibrated(motions, rest, rest)
    for count in (0, 1, 2):
        for friction, level in ((1, 1), (-1, -1), (1, -1), (-1, 1)) if count else ((0, 0),):
            single, together = [], []
            for out, report in reports.items():
                own = [
                    drifted(m, report, healthy, count * friction, count * level)
                    for m in healthy
                    if m.run == out
                ]
                found = ematwin.detect(own, report.calibration)
                single += found.motions
                together += found.runs
            print(
                f"friction {count * friction:+d}, level {count * level:+d}: "
                f"{rates(single, 'motions')}; {rates(together, 'runs')}"
            )


def drifted(
    motion: ematwin.Recording,
    report: CalibrationReport,
    healthy: Motions,
    friction: float,
    level: float,
) -> ematwin.Recording:
    """A motion with friction and the level of its current changed by so many deviations."""
    calibration = report.calibration
    held = motion.labels["load_kgf"]
    means = [m.current.mean() for m in healthy if m.labels["load_kgf"] == held]
    factor = float(np.exp(friction * calibration.reported.spread[0]))
    load = 9.80665 * float(held)
    command = ematwin.Scenario.from_columns(motion.time, motion.set_point)
    before, after = (
        ematwin.simulate(
            None, command, {"load": load, "friction": x}, calibration.actuator,
            sample_rate=motion.sample_rate,
        )
        for x in (1.0, factor)
    )  # fmt: skip
    return motion.changed(
        current=motion.current + after.current - before.current + level * np.std(means),
        position_error=motion.position_error + after.position_error - before.position_error,
    )


def rates(verdicts: list[Diagnosis], kind: str) -> str:
    """Alarms, named ones, and those without a verdict, as a text."""
    alarm, named, unsure = (
        100 * np.mean([found(v) for v in verdicts])
        for found in (
            lambda v: v.alarm,
            lambda v: v.grade == "fault",
            lambda v: v.grade == "none",
        )
    )
    return (
        f"of {len(verdicts)} {kind} {alarm:.1f} % raise an alarm ({named:.1f} % named), "
        f"{unsure:.1f} % have no verdict"
    )


if __name__ == "__main__":
    main()
