"""How fast a ball-screw actuator is calibrated, and motions are judged; what the step costs.

python benchmarks/monitoring.py    (simulated motions of 13 s at 25 Hz: 5 runs, 3 loads, 5 motions)
python benchmarks/monitoring.py --steps
"""

import argparse
import statistics
import timeit

import numpy as np

import ematwin
from ematwin.models.ball_screw.model import MODEL

LOADS = (-400.0, 200.0, 400.0)  # N


def main() -> None:
    """Print seconds for 75 motions, and motions a second, medians of five; or the cost of steps."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", action="store_true", help="the error of the twin by its step")
    if parser.parse_args().steps:
        steps()
        return
    actuator = ematwin.BallScrew.load()
    motions = [
        ematwin.simulate(
            None, None, {"load": load}, actuator, seed=1000 * run + 10 * motion + place
        ).changed(labels={"load": f"{load:g}", "run": str(run), "motion": str(motion)})
        for place, load in enumerate(LOADS)
        for run in range(1, 6)
        for motion in range(1, 6)
    ]
    report = ematwin.calibrate(motions)  # compiles, or loads what an earlier process compiled
    calibrating, judging = (
        statistics.median(timeit.repeat(call, number=1))
        for call in (
            lambda: ematwin.calibrate(motions),
            lambda: ematwin.detect(motions, report.calibration),
        )
    )
    print(f"calibration on {len(motions)} motions: {calibrating:.2f} s")
    print(f"detection: {len(motions) / judging:.0f} motions a second")


def steps() -> None:
    """Print the RMS difference to a step of 0.25 ms, as a share of the RMS."""
    actuator = ematwin.BallScrew.load()
    motion = ematwin.simulate(actuator=actuator)
    candidates = {
        "friction": np.array([1.0, 1.3]), "backlash": np.array([5e-5, 5e-4]),
        "load": np.array([200.0, -400.0]), "initial_error": np.array([0.0, 1e-3]),
    }  # fmt: skip

    def traces(step: float) -> list[np.ndarray]:
        finer = actuator.changed({"steps.twin": step})
        return list(MODEL.respond(finer, motion, candidates, 2).values())

    finest = traces(0.25e-3)
    print("step, ms    current, %    position error, %")
    for step in (8e-3, 4e-3, 2e-3, 1e-3):
        errors = [
            float(np.sqrt(((now - best) ** 2).mean() / (best**2).mean()))
            for now, best in zip(traces(step), finest, strict=True)
        ]
        print(f"{1e3 * step:>8g} {100 * errors[0]:>13.2f} {100 * errors[1]:>20.2f}")


if __name__ == "__main__":
    main()
