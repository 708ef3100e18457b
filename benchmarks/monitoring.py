"""How fast a ball-screw actuator is calibrated, and motions are judged.

python benchmarks/monitoring.py    (simulated motions of 13 s at 25 Hz: 5 runs, 3 loads, 5 motions)
"""

import statistics
import time
from collections.abc import Callable

import ematwin
from ematwin.monitoring.simulate import out_and_back, simulate_motion

LOADS = (-400.0, 200.0, 400.0)  # N


def main() -> None:
    """Print seconds for 75 motions, and motions a second, medians of five."""
    actuator = ematwin.BallScrew.load()
    set_point, interval = out_and_back(actuator, 0.12, 5.0, 3.0)
    motions = [
        simulate_motion(
            actuator,
            set_point,
            interval,
            load=load,
            seed=1000 * run + 10 * motion + place,
            labels={"load": f"{load:g}", "run": str(run), "motion": str(motion)},
        )
        for place, load in enumerate(LOADS)
        for run in range(1, 6)
        for motion in range(1, 6)
    ]
    report = ematwin.calibrate(motions)  # compiles, or loads what an earlier process compiled
    calibrating = statistics.median(timed(lambda: ematwin.calibrate(motions)) for _ in range(5))
    judging = statistics.median(
        timed(lambda: ematwin.detect(motions, report.calibration)) for _ in range(5)
    )
    print(f"calibration on {len(motions)} motions: {calibrating:.2f} s")
    print(f"detection: {len(motions) / judging:.0f} motions a second")


def timed(call: Callable[[], object]) -> float:
    """Seconds that a call takes."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
