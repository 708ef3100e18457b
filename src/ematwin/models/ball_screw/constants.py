"""The parameters of an actuator as the kernel takes them: on the motor shaft."""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.ball_screw.parameters import BallScrew

# These set the grid of steps, which a batch shares: they cannot differ between candidates.
FIXED = ("controller.sample_time", "steps.twin")


class BallScrewConstants(NamedTuple):
    """What the model needs of the actuator, SI, on the motor shaft."""

    per_radian: float  # m of nut for one radian of the screw
    half_gap: float  # rad, healthy
    friction: float  # N m, dry friction extrapolated to standstill, no load
    w_fading: float  # rad/s, speed at which the falling friction would vanish
    c_opposing: float  # 1/eta_o - 1
    c_aiding: float  # 1 - eta_a
    voltage: float  # V
    i_idle: float  # A
    response_time: float  # s
    k_position: float  # 1/s
    k_integral: float  # 1/s^2
    sample_time: float  # s


def kernel_constants(actuator: BallScrew) -> BallScrewConstants:
    """Constants of the equations in docs/ball-screw.md.

    Where parameters are arrays (B,), so are the constants that depend on them.
    """
    screw, drive, control = actuator.screw, actuator.drive, actuator.controller
    per_radian = screw.lead / (2.0 * math.pi)
    return BallScrewConstants(
        per_radian=per_radian,
        half_gap=0.5 * screw.backlash / per_radian,
        friction=screw.friction_force * per_radian,
        w_fading=screw.fading_speed / per_radian,
        c_opposing=1.0 / screw.efficiency_opposing - 1.0,
        c_aiding=1.0 - screw.efficiency_aiding,
        voltage=drive.supply_voltage,
        i_idle=drive.idle_current,
        response_time=drive.response_time,
        k_position=control.position_gain,
        k_integral=control.integral_gain,
        sample_time=control.sample_time,
    )


def constants_table(actuator: BallScrew) -> np.ndarray:
    """The same as a (1, 12) array; (B, 12) where parameters are arrays (B,)."""
    constants = kernel_constants(actuator)
    if all(isinstance(value, float | int) for value in constants):
        return np.array([constants], dtype=float)
    count = max(np.size(value) for value in constants)
    return np.column_stack([np.broadcast_to(value, count) for value in constants])
