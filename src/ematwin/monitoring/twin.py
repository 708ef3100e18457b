"""The ball-screw twin on the samples of a motion."""

import numpy as np

from ematwin.errors import RecordError
from ematwin.kernels.ball_screw_batch import ball_screw_traces
from ematwin.plant.ball_screw import BallScrew

MAGNITUDES = ("friction", "backlash", "gain", "load", "initial_error")


def twin_traces(
    actuator: BallScrew, set_point: np.ndarray, interval: float, magnitudes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Current (B, S), A, and position error (B, S), m, that the twin answers with.

    Parameters
    ----------
    actuator : BallScrew
    set_point : (S,) array, m
    interval : float, s
    magnitudes : (B, 5) array, columns as in `MAGNITUDES`: factor on the friction, backlash (m),
        factor on both gains, load that pushes towards larger positions (N), position error at the
        first sample (m)
    """
    update, substeps = steps_of(actuator, interval)
    constants = actuator.kernel_constants()
    current, error = ball_screw_traces(
        np.ascontiguousarray(magnitudes, dtype=float), set_point, interval, constants, substeps,
        update,
    )  # fmt: skip
    return current, error


def steps_of(actuator: BallScrew, interval: float) -> tuple[int, int]:
    """Steps from one update of the position loop to the next, and from one sample to the next."""
    sample_time, step = actuator.controller.sample_time, actuator.steps.twin
    update = max(1, round(sample_time / step))
    substeps = max(1, round(interval * update / sample_time))
    if abs(substeps * sample_time / update - interval) > 0.01 * interval:
        raise RecordError(
            f"The motions are sampled each {interval:g} s, which is no whole number of steps of "
            f"{sample_time / update:g} s. Change controller.sample_time or steps.twin of "
            f"{actuator.name}, or resample the motions."
        )
    return update, substeps
