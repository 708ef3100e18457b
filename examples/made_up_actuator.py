"""Recordings of an actuator that does not exist, to try calibration and detection on.

python examples/made_up_actuator.py    (writes healthy.csv and later.csv into this folder)

Ten healthy runs on ten days, with the small differences that days make, and then eight runs in
which the lubricant dries out, the nut wears, and the screw is damaged. docs/your-actuator.md goes
through what to do with them.
"""

import numpy as np

import ematwin
from ematwin.monitoring.simulate import out_and_back, simulate_motion, write_motions

# The actuator as it really is; the template that calibration starts from does not know.
TRUTH = {
    "screw.lead": 0.004,
    "screw.backlash": 2e-5,
    "screw.friction_force": 1400.0,
    "screw.fading_speed": 0.06,
    "drive.supply_voltage": 48.0,
    "drive.idle_current": 0.22,
    "drive.response_time": 0.05,
    "controller.position_gain": 6.0,
    "controller.integral_gain": 12.0,
}
STROKE, SECONDS, REST = 0.08, 4.0, 2.0  # m, s, s
LATER: list[dict[str, float]] = [
    {"friction": 1.0},
    {"friction": 1.08},
    {"friction": 1.2},
    {"friction": 1.35},
    {"backlash": 4e-4},
    {"backlash": 8e-4},
    {"roughness": 0.05},
    {"roughness": 0.10},
]


def run(
    actuator: ematwin.BallScrew, number: int, faults: dict[str, float], random: np.random.Generator
) -> list[ematwin.Motion]:
    """Four motions of a day, each under another load."""
    set_point, interval = out_and_back(actuator, STROKE, SECONDS, REST)
    day = {"friction": random.normal(1.0, 0.015), "gain": random.normal(1.0, 0.005)}
    day |= {name: value * day.get(name, 1.0) for name, value in faults.items()}
    return [
        simulate_motion(
            actuator,
            set_point,
            interval,
            **day,
            load=random.uniform(-200.0, 200.0),
            seed=1000 * number + motion,
            labels={"run": str(number), "motion": str(motion)},
        )
        for motion in range(1, 5)
    ]


def main() -> None:
    """Write the two files."""
    actuator = ematwin.BallScrew.load().changed(TRUTH)
    random = np.random.default_rng(1)
    healthy = [motion for n in range(1, 11) for motion in run(actuator, n, {}, random)]
    later = [m for n, faults in enumerate(LATER, 11) for m in run(actuator, n, faults, random)]
    for motions, path in ((healthy, "healthy.csv"), (later, "later.csv")):
        write_motions(motions, path)
        print(f"wrote {path}: {len(motions)} motions")


if __name__ == "__main__":
    main()
