"""Stability of the sampled position loop, and its limit.

The carriage is linear while it moves one way: between samples M dv/dt = g u - F_v v, the voltage u
follows the controller's output c with a lag, and c is held. With the states at the samples

    z = (q, v, u, q_-1, q_-2),    c = k_v (k_p (q_ref - q) - (q - q_-2) / 2T)

the loop is z' = A z, and is stable if all eigenvalues of A lie within the unit circle. Coulomb
friction only damps; the less viscous of the two directions decides. Zero-order hold: Franklin,
Powell and Workman (1998), Digital Control of Dynamic Systems, section 4.3.
"""

import math
from typing import Any

import numpy as np

from ematwin.numerics.linear_algebra import exponential, largest_share, spectral_radius


def loop_radius(actuator: Any, share: float = 1.0) -> float:
    """Largest magnitude of an eigenvalue of the loop; below 1 it is stable.

    Parameters
    ----------
    actuator : LinearAxis
    share : factor on the velocity gain
    """
    held = _held(actuator)
    control = actuator.controller
    k_v = share * control.velocity_gain
    k_p, interval = control.position_gain, control.sample_time
    # rows q, v, u of the next sample; columns q, v, u, and the held output c
    loop = np.zeros((5, 5))
    loop[:3, :3] = held[:3, :3]
    output = np.array([-k_v * (k_p + 0.5 / interval), 0.0, 0.0, 0.0, k_v * 0.5 / interval])
    loop[:3] += np.outer(held[:3, 3], output)
    loop[3, 0] = loop[4, 3] = 1.0
    return spectral_radius(loop)


def velocity_gain_limit(actuator: Any) -> float:
    """The velocity gain, V s/m, below which the loop is stable at its sample time; 0 if none is."""
    share = largest_share(lambda share: loop_radius(actuator, share) < 1.0)
    return share * float(actuator.controller.velocity_gain)


def check_stability(actuator: Any) -> None:
    """Raise ValueError unless the loop is stable; the message gives the limit."""
    if loop_radius(actuator) < 1.0:
        return
    control = actuator.controller
    limit = velocity_gain_limit(actuator)
    advice = (
        f"at that sample time and position gain the limit is {limit:.4g} V s/m"
        if limit > 1e-6 * control.velocity_gain
        else "at that sample time and position gain no velocity gain is stable: lower the "
        "position gain"
    )
    raise ValueError(
        f"the position loop is unstable with controller.velocity_gain "
        f"{control.velocity_gain:.4g} V s/m at a sample time of {control.sample_time:.4g} s; "
        f"{advice}"
    )


def _held(actuator: Any) -> np.ndarray:
    """(4, 4) transition of q, v, u and the held output over a sample time."""
    friction, drive = actuator.friction, actuator.drive
    mass = actuator.carriage.mass
    viscous = friction.viscous / math.sqrt(
        max(friction.viscous_ratio, 1.0 / friction.viscous_ratio)
    )
    rates = np.zeros((4, 4))
    rates[0, 1] = 1.0
    rates[1, 1], rates[1, 2] = -viscous / mass, drive.gain / mass
    rates[2, 2], rates[2, 3] = -1.0 / drive.response_time, 1.0 / drive.response_time
    return exponential(rates * actuator.controller.sample_time)
