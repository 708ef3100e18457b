"""Magnitudes of one motion: those with which the twin answers as the actuator did.

Levenberg-Marquardt on current and position error together. What the twin leaves unexplained on
healthy motions (its discrepancy; Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63, 425-464) is taken
off first, so that it does not bias the magnitudes.
"""

from dataclasses import dataclass

import numpy as np

from ematwin.identification.descent import Descent
from ematwin.monitoring.twin import MAGNITUDES, twin_traces
from ematwin.plant.ball_screw import BallScrew

_ITERATIONS = 12
_MOST_FRICTION = 6.0  # factor
_MOST_BACKLASH = 5e-3  # m
_MOST_LOAD = 2.0  # of the healthy friction at standstill


@dataclass(frozen=True)
class Weights:
    """Standard deviations that weigh the residuals against each other."""

    current: float  # A
    position_error: float  # m


@dataclass(frozen=True)
class Prior:
    """What is held of a magnitude before the motion is seen: mean and standard deviation."""

    mean: np.ndarray  # (5,), as in MAGNITUDES
    spread: np.ndarray  # (5,)


def first_prior(actuator: BallScrew) -> Prior:
    """Wide enough to let the motion speak where it says anything."""
    force = actuator.screw.friction_force
    return Prior(
        np.array([1.0, actuator.screw.backlash, 1.0, 0.0, 0.0]),
        np.array([2.0, 1e-3, 0.3, 0.5 * force, 2e-3]),
    )


def first_starts(actuator: BallScrew, initial_error: float) -> np.ndarray:
    """Starts (2, 5) of a search that knows nothing yet, one for each direction of the load."""
    pull = 0.1 * actuator.screw.friction_force
    starts = np.tile(first_prior(actuator).mean, (2, 1))
    starts[:, 3] = (-pull, pull)
    starts[:, 4] = initial_error
    return starts


def estimate(
    actuator: BallScrew,
    set_point: np.ndarray,
    interval: float,
    current: np.ndarray,
    position_error: np.ndarray,
    weights: Weights,
    prior: Prior,
    starts: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Magnitudes (5,) of a motion and the cost that is left.

    Parameters
    ----------
    set_point, current, position_error : (S,) arrays, m, A, m; the discrepancy already taken off
    starts : (M, 5) array, where the search begins; the best end is taken
    """
    lower, upper = box(actuator)
    width = upper - lower
    measured = np.r_[current / weights.current, position_error / weights.position_error]

    def residuals(points: np.ndarray) -> np.ndarray:
        magnitudes = lower + points * width
        i, e = twin_traces(actuator, set_point, interval, magnitudes)
        answer = np.concatenate([i / weights.current, e / weights.position_error], axis=1)
        held = (magnitudes - prior.mean) / prior.spread
        return np.concatenate([answer - measured, held], axis=1)

    zero, one = np.zeros(len(MAGNITUDES)), np.ones(len(MAGNITUDES))
    points = np.clip((starts - lower) / width, zero, one)
    descent = Descent.start(points, residuals, damping=1e-3)
    for _ in range(_ITERATIONS):
        descent.iterate(residuals, zero, one, lambda x: np.clip(x, zero, one))
    best = descent.best(1)
    return lower + best.points[0] * width, float(best.costs[0])


def box(actuator: BallScrew) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds (5,) of the magnitudes."""
    load = _MOST_LOAD * actuator.screw.friction_force
    return (
        np.array([0.05, 0.0, 0.3, -load, -5e-3]),
        np.array([_MOST_FRICTION, _MOST_BACKLASH, 3.0, load, 5e-3]),
    )
