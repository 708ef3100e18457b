"""The ball-screw twin on the samples of a motion."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.ball_screw.parameters import FIXED, BallScrew
from ematwin.models.ball_screw.step import BallScrewConstants, ball_screw_at_rest, ball_screw_traces
from ematwin.models.stepped import Stepped, stepped_of
from ematwin.numerics.compile import plain


def candidate_traces(
    actuator: BallScrew, set_point: np.ndarray, interval: float, candidates: Mapping[str, Any],
    count: int,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Current (A) and position error (m) that the twin answers with, (B, S) arrays.

    ``set_point`` (S,) in m and ``interval`` in s; ``candidates`` are unknowns by name and
    parameters by place, (B,) each. A healthy backlash is the parameter of the candidate.
    """
    update, substeps = steps_of(actuator, interval)
    c = ball_screw_constants(actuator, candidates, update, substeps)
    state = plain(ball_screw_at_rest)(set_point[0], c)
    return ball_screw_traces(set_point, None, c, state, interval, substeps, count=count)


def stepped(actuator: BallScrew) -> Stepped:
    """The actuator sample by sample, from rest, the nut in the middle of its play."""
    interval = actuator.controller.sample_time
    update, substeps = steps_of(actuator, interval)
    return stepped_of(
        ball_screw_traces, ball_screw_at_rest,
        lambda candidates: ball_screw_constants(actuator, candidates, update, substeps),
        inputs=("set_point",), interval=interval, substeps=substeps,
    )  # fmt: skip


def ball_screw_constants(
    actuator: BallScrew, k: Mapping[str, Any], update: int, substeps: int
) -> BallScrewConstants:
    """Constants of the equations in docs/ball-screw.md, numbers or (B,) arrays.

    ``k`` are unknowns by name and parameters by place; steps are as of `steps_of`.
    """
    own = actuator.varied(k, FIXED)
    screw, drive, control = own.screw, own.drive, own.controller
    per_radian = screw.lead / (2.0 * math.pi)
    gain = k.get("gain", 1.0)
    return BallScrewConstants(
        per_radian=per_radian,
        half_gap=0.5 * k.get("backlash", screw.backlash) / per_radian,
        friction=screw.friction_force * per_radian * k.get("friction", 1.0),
        w_fading=screw.fading_speed / per_radian,
        c_opposing=1.0 / screw.efficiency_opposing - 1.0,
        c_aiding=1.0 - screw.efficiency_aiding,
        load=k.get("load", 0.0) * per_radian,
        voltage=drive.supply_voltage,
        i_idle=drive.idle_current,
        response_time=drive.response_time,
        k_position=control.position_gain * gain,
        k_integral=control.integral_gain * gain,
        update=float(update),
        share=1.0 / substeps,
        initial_error=k.get("initial_error", 0.0),
    )


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
