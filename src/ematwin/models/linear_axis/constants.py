"""The parameters and faults of candidates as the kernel takes them."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.linear_axis.parameters import LinearAxis

# These set the grid of steps, which a batch shares: they cannot differ between candidates.
FIXED = ("controller.sample_time", "steps.twin")


class AxisConstants(NamedTuple):
    """What the model needs of an axis, SI."""

    mobility: float  # 1/kg
    dry_forward: float  # N
    dry_backward: float  # N
    standstill: float  # friction at standstill over Coulomb friction, less 1
    per_fading: float  # s/m
    viscous_forward: float  # N s/m
    viscous_backward: float  # N s/m
    gain: float  # N/V
    offset: float  # N
    per_lag: float  # 1/s
    limit: float  # V
    k_position: float  # 1/s
    k_velocity: float  # V s/m


def constants_table(actuator: LinearAxis, candidates: Mapping[str, Any], count: int) -> np.ndarray:
    """(B, 13) array of constants, columns as in `AxisConstants`.

    Parameters
    ----------
    actuator : LinearAxis
    candidates : faults by name and parameters by place, (B,) each; what is not named is healthy
    count : B
    """
    own = actuator.varied(candidates, FIXED)
    friction, drive, control = own.friction, own.drive, own.controller
    one = np.ones(count)
    dry = friction.coulomb * candidates.get("friction", one)
    dry_side = np.sqrt(friction.coulomb_ratio * candidates.get("dry_asymmetry", one))
    viscous = friction.viscous * candidates.get("viscous", one)
    viscous_side = np.sqrt(friction.viscous_ratio * candidates.get("viscous_asymmetry", one))
    found = AxisConstants(
        mobility=1.0 / own.carriage.mass,
        dry_forward=dry / dry_side,
        dry_backward=dry * dry_side,
        standstill=friction.standstill_ratio - 1.0,
        per_fading=1.0 / friction.fading_speed,
        viscous_forward=viscous / viscous_side,
        viscous_backward=viscous * viscous_side,
        gain=drive.gain * candidates.get("drive_gain", one),
        offset=drive.offset,
        per_lag=1.0 / drive.response_time,
        limit=drive.voltage_limit,
        k_position=control.position_gain * candidates.get("position_gain", one),
        k_velocity=control.velocity_gain,
    )
    return np.column_stack([np.broadcast_to(value, count) for value in found])


def substeps_of(actuator: LinearAxis) -> int:
    """Steps from one sample to the next."""
    return max(1, math.ceil(actuator.controller.sample_time / actuator.steps.twin - 1e-9))
