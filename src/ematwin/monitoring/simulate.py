"""Simulated motions: to try the whole path without a rig, and to test it."""

from pathlib import Path

import numpy as np

from ematwin.errors import InputError
from ematwin.monitoring.twin import twin_traces
from ematwin.plant.ball_screw import BallScrew
from ematwin.readers.tables import write_table
from ematwin.signals.motion import Motion


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
    friction: float = 1.0,
    backlash: float | None = None,
    gain: float = 1.0,
    roughness: float = 0.0,
    load: float = 0.0,
    noise: tuple[float, float] = (0.03, 2e-4),
    seed: int = 0,
    labels: dict[str, str] | None = None,
) -> Motion:
    """One motion of a ball-screw actuator with faults and sensor noise.

    Parameters
    ----------
    friction, gain : factors on the healthy friction and on the gains of the position loop
    backlash : m; None takes the actuator's
    roughness : share of the moving current that swings once a turn of the screw and, half as
        much, with its second harmonic: a simple measure of surface damage; the nut swings with it
        by the same share of a millimetre
    load : N, towards larger positions
    noise : standard deviations of current (A) and position (m)
    seed : of the noise and of the phase of the swings

    Raises
    ------
    InputError
        If a magnitude is impossible.
    """
    play = actuator.screw.backlash if backlash is None else backlash
    for name, value, least in (
        ("friction", friction, 1e-3), ("backlash", play, 0.0), ("gain", gain, 1e-3),
        ("roughness", roughness, 0.0),
    ):  # fmt: skip
        if not np.isfinite(value) or value < least:
            raise InputError(f"{name} must be at least {least:g}, received {value:g}.")
    if not np.isfinite(load):
        raise InputError(f"load must be a finite number, received {load:g}.")
    random = np.random.default_rng(seed)
    magnitudes = np.array([[friction, play, gain, load, 0.0]])
    current, error = (x[0] for x in twin_traces(actuator, set_point, interval, magnitudes))
    turns = (set_point - error) / actuator.screw.lead
    phase = random.uniform(0.0, 2.0 * np.pi, 2)
    swing = np.sin(2.0 * np.pi * turns + phase[0])
    swing += 0.5 * np.sin(4.0 * np.pi * turns + phase[1])
    moving = current - actuator.drive.idle_current
    current = current + roughness * moving * swing + random.normal(0.0, noise[0], current.size)
    error = error + roughness * 1e-3 * swing * (np.abs(np.gradient(set_point)) > 0.0)
    error = error + random.normal(0.0, noise[1], error.size)
    time = np.arange(set_point.size) * interval
    return Motion(time, set_point, error, np.abs(current), labels or {}, "simulated")


def write_motions(motions: list[Motion], path: str | Path) -> None:
    """Write motions as one CSV or Parquet table in mm and A, as a test bench would."""
    labels = list(dict.fromkeys(name for motion in motions for name in motion.labels))
    columns: dict[str, object] = {
        name: [motion.labels.get(name, "") for motion in motions for _ in motion.time]
        for name in labels
    }
    columns["time_s"] = np.concatenate([motion.time for motion in motions])
    columns["set_point_mm"] = np.concatenate([1e3 * motion.set_point for motion in motions])
    columns["position_error_mm"] = np.concatenate([1e3 * m.position_error for m in motions])
    columns["current_a"] = np.concatenate([motion.current for motion in motions])
    write_table(path, columns)
