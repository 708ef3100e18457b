"""A ball-screw rig that does not exist, with days on which it runs a little differently."""

from collections.abc import Mapping
from functools import cache

import numpy as np

from ematwin.models.ball_screw.model import MODEL, SENSORS, as_sensed
from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.recordings.recording import Recording

# What the rig is, as factors on the template that a calibration starts from.
TRUTH = {
    "screw.friction_force": 1.25,
    "screw.fading_speed": 1.2,
    "drive.idle_current": 0.8,
    "controller.position_gain": 0.8,
    "controller.integral_gain": 1.25,
}
NOISE = (0.02, 1e-4)  # A, m
LOADS = {"light": -100.0, "heavy": 300.0}  # N, by the label of the motion


@cache
def template() -> BallScrew:
    return BallScrew.load("rm1605")


@cache
def rig() -> BallScrew:
    """The template with the parameters of `TRUTH`."""
    return template().changed({place: f * template().value(place) for place, f in TRUTH.items()})


@cache
def command() -> tuple[np.ndarray, float]:
    """80 mm out in 4 s, 2 s of rest, and back."""
    return out_and_back(rig(), 0.08, 4.0, 2.0)


def motion(seed: int = 0, **changed: object) -> Recording:
    """One motion of the rig; ``changed`` as in `simulate_motion`."""
    options: dict[str, object] = {"noise": NOISE, "seed": seed, **changed}
    return simulate_motion(rig(), *command(), **options)  # type: ignore[arg-type]


def run(
    number: int, motions: int = 2, condition: str = "normal", **fault: float
) -> list[Recording]:
    """The motions of a run, under two loads; each run has its own friction, play and gain.

    ``fault``: friction and gain as factors, backlash in m, roughness as in `simulate_motion`.
    """
    random = np.random.default_rng(1000 + number)
    friction, gain = np.exp(random.normal(0.0, [0.02, 0.01]))
    play = rig().screw.backlash * float(np.exp(random.normal(0.0, 0.2)))
    return [
        motion(
            seed=1000 * number + 10 * n + m,
            friction=friction * fault.get("friction", 1.0),
            gain=gain * fault.get("gain", 1.0),
            backlash=fault.get("backlash", play),
            roughness=fault.get("roughness", 0.0),
            load=load + random.normal(0.0, 30.0),
            labels={
                "condition": condition, "weight": weight, "run": str(number), "motion": str(m + 1),
            },
        )
        for n, (weight, load) in enumerate(LOADS.items())
        for m in range(motions)
    ]  # fmt: skip


def healthy_runs(count: int, first: int = 1, motions: int = 2) -> list[Recording]:
    """Motions of healthy runs, numbered from ``first``."""
    return [one for number in range(first, first + count) for one in run(number, motions)]


def out_and_back(
    actuator: BallScrew, stroke: float, seconds: float, rest: float
) -> tuple[np.ndarray, float]:
    """A set point (S,), m, that goes out, rests and comes back, and its interval, s."""
    interval = actuator.controller.sample_time
    time = np.arange(round((2.0 * seconds + rest) / interval)) * interval
    knots = [0.0, seconds, seconds + rest, 2.0 * seconds + rest]
    return np.interp(time, knots, [0.0, stroke, stroke, 0.0]), interval


def simulate_motion(
    actuator: BallScrew,
    set_point: np.ndarray,
    interval: float,
    *,
    noise: tuple[float, float] = SENSORS,
    seed: int = 0,
    labels: Mapping[str, str] | None = None,
    **values: float,
) -> Recording:
    """One motion over any set point, with unknowns of the actuator by name."""
    k = MODEL.values_of(actuator, values)
    inputs = Recording(
        np.arange(set_point.size) * interval, {"set_point": set_point},
        labels=labels, source="simulated",
    )  # fmt: skip
    one = {name: np.array([value]) for name, value in k.items()}
    answer = MODEL.respond(actuator, inputs, one, 1)
    clean = inputs.changed(**{name: trace[0] for name, trace in answer.items()})
    return as_sensed(clean, actuator, k["roughness"], noise, np.random.default_rng(seed))
