"""Recordings of an actuator that does not exist, to try calibration and detection on.

python examples/made_up_actuator.py    (writes healthy.csv and later.csv into this folder)

Ten healthy runs on ten days, with the small differences that days make, and then eight runs in
which the lubricant dries out, the nut wears, and the screw is damaged. docs/your-actuator.md goes
through what to do with them.
"""

import numpy as np

import ematwin
from ematwin.models.ball_screw.parameters import BallScrew

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
STROKE, SECONDS, REST = 0.08, 4.0, 2.0  # m, s one way, s between
INTERVAL = 0.04  # s, of the position loop
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


def command() -> ematwin.Scenario:
    """A set point that goes out, rests and comes back, sampled as the position loop does."""
    time = np.arange(round((2.0 * SECONDS + REST) / INTERVAL)) * INTERVAL
    corners = [0.0, SECONDS, SECONDS + REST, 2.0 * SECONDS + REST]
    return ematwin.Scenario.from_columns(time, np.interp(time, corners, [0.0, STROKE, STROKE, 0.0]))


def run(
    actuator: BallScrew, number: int, faults: dict[str, float], random: np.random.Generator
) -> list[ematwin.Recording]:
    """Four motions of a day, each under another load."""
    day = {"friction": random.normal(1.0, 0.015), "gain": random.normal(1.0, 0.005)}
    day |= {name: value * day.get(name, 1.0) for name, value in faults.items()}
    return [
        ematwin.simulate(
            scenario=command(),
            faults={**day, "load": random.uniform(-200.0, 200.0)},
            actuator=actuator,
            seed=1000 * number + motion,
        ).changed(labels={"run": str(number), "motion": str(motion)})
        for motion in range(1, 5)
    ]


def main() -> None:
    """Write the two files."""
    actuator = BallScrew.load().changed(TRUTH)
    random = np.random.default_rng(1)
    healthy = [motion for n in range(1, 11) for motion in run(actuator, n, {}, random)]
    later = [m for n, faults in enumerate(LATER, 11) for m in run(actuator, n, faults, random)]
    for motions, path in ((healthy, "healthy.csv"), (later, "later.csv")):
        ematwin.write(motions, path)
        print(f"wrote {path}: {len(motions)} motions")


if __name__ == "__main__":
    main()
