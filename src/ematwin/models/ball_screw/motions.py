"""Simulated motions over any set point, and what sensors show of a simulated motion."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.recordings.recording import Recording

SENSORS = (0.03, 2e-4)  # A and m: standard deviations of a usual rig


def out_and_back(
    actuator: BallScrew, stroke: float, seconds: float, rest: float
) -> tuple[np.ndarray, float]:
    """A set point (S,), m, that goes out, rests and comes back, and its interval, s.

    Parameters
    ----------
    stroke : float, m; ``seconds`` for one way; ``rest`` s between
    """
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
    """One motion over any set point.

    Parameters
    ----------
    set_point : (S,) array, m; ``interval`` in s
    noise : standard deviations of current (A) and position (m)
    seed : of the noise and of the phase of the swings
    labels : of the recording
    **values : unknowns of the actuator by name, e.g. ``friction=1.3``

    Raises
    ------
    InputError
        If there is no such unknown, or its value lies out of bounds.
    """
    from ematwin.models.ball_screw.model import MODEL

    k = MODEL.values_of(actuator, values)
    inputs = Recording(
        np.arange(set_point.size) * interval, {"set_point": set_point},
        labels=labels, source="simulated",
    )  # fmt: skip
    one = {name: np.array([value]) for name, value in k.items()}
    answer = MODEL.respond(actuator, inputs, one, 1)
    clean = inputs.changed(**{name: trace[0] for name, trace in answer.items()})
    return as_sensed(clean, actuator, k["roughness"], noise, np.random.default_rng(seed))


def as_sensed(
    clean: Recording,
    actuator: Any,
    roughness: float,
    noise: tuple[float, float],
    random: np.random.Generator,
) -> Recording:
    """A simulated motion with roughness and the noise (A, m) of its sensors.

    Roughness is a simple measure of surface damage: a share of the moving current swings once a
    turn of the screw and, half as much, with its second harmonic; the nut swings with it by the
    same share of a millimetre.
    """
    set_point, current, error = clean.set_point, clean.current, clean.position_error
    turns = (set_point - error) / actuator.screw.lead
    phase = random.uniform(0.0, 2.0 * np.pi, 2)
    swing = np.sin(2.0 * np.pi * turns + phase[0])
    swing += 0.5 * np.sin(4.0 * np.pi * turns + phase[1])
    moving = current - actuator.drive.idle_current
    current = current + roughness * moving * swing + random.normal(0.0, noise[0], current.size)
    error = error + roughness * 1e-3 * swing * (np.abs(np.gradient(set_point)) > 0.0)
    error = error + random.normal(0.0, noise[1], error.size)
    return clean.changed(current=np.abs(current), position_error=error)
