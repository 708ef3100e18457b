"""Faults of a real ball-screw actuator: calibrate on healthy runs, judge the others.

The recordings are those of Ruiz-Carcel and Starr (Cranfield University,
doi:10.17862/cranfield.rd.5097649), as one table: condition, load_kgf, run, motion, time_s,
set_point_mm, position_error_mm, current_a. They are not part of ematwin.

python examples/cranfield.py runs_1_to_5.parquet
python examples/cranfield.py runs_1_to_5.parquet --judge runs_6_to_10.parquet
python examples/cranfield.py runs_1_to_5.parquet --rotate    (false alarms on other healthy runs)
"""

import argparse
import itertools
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ematwin
from ematwin.monitoring import CalibrationReport, Detection, Scores
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
LEARNING, THRESHOLD = ("1", "2", "3"), ("4", "5")
Motions = list[ematwin.Recording]


def main() -> None:
    """Print the tables and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", nargs="?", type=Path, help="runs 1 to 5, healthy and faulty")
    parser.add_argument("--judge", type=Path, help="runs that took no part in anything")
    parser.add_argument("--out", type=Path, default=Path("cranfield"), help="folder for the page")
    parser.add_argument("--rotate", action="store_true", help="false alarms, each run left out")
    given = parser.parse_args()
    if given.recordings is None or not given.recordings.exists():
        print(
            "Give the file with the recordings. They are published at "
            "https://doi.org/10.17862/cranfield.rd.5097649; docs/real-recordings.md says how to "
            "bring them into one table."
        )
        return
    motions = ematwin.read_motions(given.recordings)
    if given.rotate:
        rotate(motions)
        return
    teaching = LEARNING + THRESHOLD if given.judge else LEARNING
    report = calibrated(motions, LEARNING, THRESHOLD, teaching)
    judged = motions if given.judge is None else ematwin.read_motions(given.judge)
    found = ematwin.detect(judged, report.calibration)
    unseen = [motion.run not in teaching for motion in judged]

    print(f"threshold from healthy runs {', '.join(THRESHOLD)}, learnt from {', '.join(LEARNING)}")
    print(f"names learnt from faulty runs {', '.join(teaching)}; judged on the others\n")
    named = [v.fault == FAULTS.get(v.labels["condition"]) for v in found.motions]
    named_run = [v.fault == FAULTS.get(v.labels["condition"]) for v in found.runs]
    scores = report.calibration.scores(judged)
    held = report.calibration.scores(
        [m for m in motions if m.labels["condition"] == HEALTHY and m.run in THRESHOLD]
    )
    ways = {
        "motion": [v.alarm for v in found.motions],
        "model": alarms_of(scores, held, {"model"}),
        "statistics": alarms_of(scores, held, {"mean", "band"}),
        **pca(motions, judged),
    }
    heading = ["by run", "by motion", "model only", "statistics", "PCA T2", "PCA Q"]
    heading = heading[: 1 + len(ways)]
    print(
        f"{'% detected':<18}" + "".join(f"{text:>12}" for text in heading) + f"{'named right':>16}"
    )
    of = [motion.labels["condition"] for motion in judged]
    of_run = [verdict.labels["condition"] for verdict in found.runs]
    for condition in dict.fromkeys([HEALTHY, *FAULTS]):
        if condition not in of:
            continue
        rows = [[v.alarm for v, c in zip(found.runs, of_run, strict=True) if c == condition]]
        rows += [
            [x for x, c in zip(way, of, strict=True) if c == condition] for way in ways.values()
        ]
        line = f"{condition:<18}" + "".join(f"{100 * np.mean(row):>12.0f}" for row in rows)
        if condition in TAUGHT:
            own = [n for n, c in enumerate(of) if c == condition and unseen[n]]
            detected = [n for n in own if found.motions[n].alarm]
            runs = [
                named_run[n]
                for n, verdict in enumerate(found.runs)
                if verdict.alarm
                and of_run[n] == condition
                and verdict.labels["run"] not in teaching
            ]
            motion_share = 100 * np.mean([named[n] for n in detected]) if detected else np.nan
            line += f"{motion_share:>8.0f} /{100 * np.mean(runs):>4.0f}"
        print(line)
    print("\nnamed right: % of the detected motions / of the runs that took no part in teaching")
    loads(found)
    given.out.mkdir(parents=True, exist_ok=True)
    report.save(given.out / "calibrated.toml")
    page = given.out / "report.html"
    page.write_text(detection_page(found), encoding="utf-8")
    print(f"wrote {page}")


def calibrated(
    motions: Motions, learning: tuple[str, ...], held: tuple[str, ...], teaching: tuple[str, ...]
) -> CalibrationReport:
    """Calibrated on healthy runs, with a signature for each taught stage of a fault."""
    healthy = [
        motion
        for run in learning + held
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
    return ematwin.calibrate(healthy, held_back=len(held), known=known, name="cranfield")


def alarms_of(scores: Scores, held: Scores, kinds: Collection[str]) -> list[bool]:
    """Alarms of motions where only the features of some kinds count, with a limit of their own."""
    return list(scores.index(kinds) > held.limit(kinds=kinds))


@dataclass
class Stroke:
    """One way of the motion: its transient and its steady part, slices of samples."""

    transient: slice
    steady: slice


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

    ways = (Stroke(slice(0, 35), slice(35, 125)), Stroke(slice(200, 240), slice(240, 324)))

    def features(motion: ematwin.Recording) -> list[float]:
        values = []
        for way in ways:
            for signal in (motion.current, motion.position_error):
                start, steady = signal[way.transient], signal[way.steady]
                values += [
                    start.mean(), np.abs(start).max(), float(np.abs(start).argmax()),
                    steady.mean(), steady.std(),
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


def loads(found: Detection) -> None:
    """What the twin, which is told no load, says of it, beside what the rig held."""
    held = sorted({verdict.labels["load_kgf"] for verdict in found.motions}, key=float)
    print("\nload held by the rig, and as estimated from healthy motions (mean, spread), N")
    for text in held:
        own = [
            v.load
            for v in found.motions
            if v.labels["load_kgf"] == text and v.labels["condition"] == HEALTHY
        ]
        if own:
            print(f"{9.80665 * float(text):>8.0f} {np.mean(own):>8.0f} {np.std(own):>6.0f}")


def rotate(motions: Motions) -> None:
    """False alarms on a healthy run that neither taught nor set the threshold."""
    runs = LEARNING + THRESHOLD
    healthy = [m for m in motions if m.labels["condition"] == HEALTHY]
    single, together = [], []
    for out in runs:
        rest = [run for run in runs if run != out]
        for held in itertools.combinations(rest, 2):
            learning = tuple(run for run in rest if run not in held)
            report = calibrated(healthy, learning, held, ())
            found = ematwin.detect([m for m in healthy if m.run == out], report.calibration)
            single += [verdict.alarm for verdict in found.motions]
            together += [verdict.alarm for verdict in found.runs]
    print(
        f"two runs to learn from, two for the threshold, one judged: "
        f"{100 * np.mean(single):.1f} % of {len(single)} motions and "
        f"{100 * np.mean(together):.1f} % of {len(together)} runs raise a false alarm"
    )


if __name__ == "__main__":
    main()
