"""Simulated motions: to try the whole path without a rig, and to test it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.errors import DivergedError, InputError
from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.models.ball_screw.twin import candidate_traces
from ematwin.models.ball_screw.unknowns import unknowns
from ematwin.models.base import simulated_provenance
from ematwin.models.scenario import Scenario
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

SENSORS = (0.03, 2e-4)  # A and m: standard deviations of a usual rig


def simulate(
    model: Any,
    actuator: BallScrew,
    scenario: Scenario,
    values: Mapping[str, float],
    *,
    sample_rate: float | None = None,
    noise: Noise | None = None,
    seed: int = 0,
) -> Recording:
    """One motion over a scenario, sampled at the rate of the position loop if none is given.

    Without ``noise`` the sensors have that of a usual rig (`SENSORS`); with it, that is all there
    is.

    Raises
    ------
    InputError
        If the scenario holds a load over time, or cannot be sampled at this rate.
    DivergedError
        If the twin left the finite numbers.
    """
    if scenario.load:
        raise InputError(
            f"Scenario {scenario.name} has a load over time; a ball-screw actuator carries a "
            "constant one. Leave it out and give the load, in N, with the faults."
        )
    interval = actuator.controller.sample_time
    if sample_rate is not None:
        interval = 1.0 / sample_rate if np.isfinite(sample_rate) and sample_rate > 0.0 else np.nan
    if not scenario.duration >= interval:  # NaN fails this as well
        raise InputError(
            f"A scenario of {scenario.duration:g} s cannot be sampled at {sample_rate} Hz; give "
            "a positive rate that leaves at least two samples."
        )
    time = np.arange(int(scenario.duration / interval + 1e-9) + 1) * interval
    set_point, _ = scenario.histories(time)
    sensors = SENSORS if noise is None else (0.0, 0.0)
    random = np.random.default_rng(seed)
    current, error = _measured(actuator, set_point, interval, values, sensors, random)
    found = Recording(
        time,
        {"set_point": set_point, "position_error": error, "current": current},
        units={"set_point": "m", "position_error": "m", "current": "A"},
        source="simulated",
        provenance=simulated_provenance(model, actuator, scenario, values, noise, seed),
    )
    return found if noise is None else noise.apply(found, random)


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

    chosen = MODEL.values_of(actuator, values)
    random = np.random.default_rng(seed)
    current, error = _measured(actuator, set_point, interval, chosen, noise, random)
    return Recording(
        np.arange(set_point.size) * interval,
        {"set_point": set_point, "position_error": error, "current": current},
        labels=labels,
        source="simulated",
    )


def _measured(
    actuator: BallScrew,
    set_point: np.ndarray,
    interval: float,
    values: Mapping[str, float],
    noise: tuple[float, float],
    random: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Current (S,), A, and position error (S,), m, of an actuator with faults, as measured.

    Roughness is a simple measure of surface damage: a share of the moving current swings once a
    turn of the screw and, half as much, with its second harmonic; the nut swings with it by the
    same share of a millimetre.
    """
    healthy = {one.name: one.healthy for one in unknowns(actuator)}
    one = {name: np.array([values.get(name, value)]) for name, value in healthy.items()}
    roughness = float(one.pop("roughness")[0])
    current, error = (trace[0] for trace in candidate_traces(actuator, set_point, interval, one, 1))
    if not (np.isfinite(current).all() and np.isfinite(error).all()):
        raise DivergedError(
            f"The twin of {actuator.name} diverged; check its parameters and the scenario."
        )
    turns = (set_point - error) / actuator.screw.lead
    phase = random.uniform(0.0, 2.0 * np.pi, 2)
    swing = np.sin(2.0 * np.pi * turns + phase[0])
    swing += 0.5 * np.sin(4.0 * np.pi * turns + phase[1])
    moving = current - actuator.drive.idle_current
    current = current + roughness * moving * swing + random.normal(0.0, noise[0], current.size)
    error = error + roughness * 1e-3 * swing * (np.abs(np.gradient(set_point)) > 0.0)
    error = error + random.normal(0.0, noise[1], error.size)
    return np.abs(current), error
