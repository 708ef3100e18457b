"""The ball-screw twin on the samples of a motion."""

from collections.abc import Mapping

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.ball_screw.constants import FIXED, constants_table
from ematwin.models.ball_screw.parameters import BallScrew

MAGNITUDES = ("friction", "backlash", "gain", "load", "initial_error")


def twin_traces(
    actuator: BallScrew, set_point: np.ndarray, interval: float, magnitudes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Current (B, S), A, and position error (B, S), m, that the twin answers with.

    Parameters
    ----------
    actuator : BallScrew; where parameters are arrays (B,), each candidate has its own
    set_point : (S,) array, m
    interval : float, s
    magnitudes : (B, 5) array, columns as in `MAGNITUDES`: factor on the friction, backlash (m),
        factor on both gains, load that pushes towards larger positions (N), position error at the
        first sample (m)
    """
    from ematwin.models.ball_screw.batch import ball_screw_traces

    update, substeps = steps_of(actuator, interval)
    current, error = ball_screw_traces(
        np.ascontiguousarray(magnitudes, dtype=float), set_point, interval,
        constants_table(actuator), substeps, update,
    )  # fmt: skip
    return current, error


def candidate_traces(
    actuator: BallScrew,
    set_point: np.ndarray,
    interval: float,
    candidates: Mapping[str, np.ndarray],
    count: int,
) -> tuple[np.ndarray, np.ndarray]:
    """The same for candidates by name: magnitudes, and parameters of the actuator by place.

    What is not named is healthy; the healthy backlash is that of the candidate's own actuator.
    """
    own = actuator.varied(candidates, FIXED)
    healthy = {"friction": 1.0, "backlash": own.screw.backlash, "gain": 1.0}
    magnitudes = np.empty((count, len(MAGNITUDES)))
    for n, name in enumerate(MAGNITUDES):
        magnitudes[:, n] = candidates.get(name, healthy.get(name, 0.0))
    return twin_traces(own, set_point, interval, magnitudes)


def steps_of(actuator: BallScrew, interval: float) -> tuple[int, int]:
    """Steps from one update of the position loop to the next, and from one sample to the next."""
    sample_time, step = actuator.controller.sample_time, actuator.steps.twin
    update = max(1, round(sample_time / step))
    substeps = max(1, round(interval * update / sample_time))
    if abs(substeps * sample_time / update - interval) > 0.01 * interval:
        raise RecordError(
            f"The motions are sampled every {interval:g} s, not a whole number of steps of "
            f"{sample_time / update:g} s. Change controller.sample_time or steps.twin of "
            f"{actuator.name}, or resample the motions."
        )
    return update, substeps
