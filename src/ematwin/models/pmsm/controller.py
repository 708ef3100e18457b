"""The sampled loops of the drive: position P, speed PI, current PI with decoupling.

docs/pmsm.md, "Controller". One call is one tick of the current loops; position and speed loops take
part where their samples fall due. The voltage that a tick computes is applied one tick later.
Limits feed back into the integrators (Åström and Hägglund 1995, PID Controllers, section 3.5), the
angle of the voltage leads by the tick and a half until the middle of its application.
"""

import math
from typing import NamedTuple

from ematwin.numerics.compile import part
from ematwin.numerics.scalar import ROOT_3, clip, sincos


class ControlState(NamedTuple):
    """State of the loops."""

    w_ref: float  # rad/s
    i_ref: float  # A
    total: float  # N m, integral of the speed loop
    before: float  # rad, motor angle at its last sample
    w_seen: float  # rad/s, speed of that sample
    total_d: float  # V, integrals of the current loops
    total_q: float
    v_alpha: float  # V, to be applied from the next tick on
    v_beta: float


class Seen(NamedTuple):
    """Logged values of the drive at a tick."""

    i_d: float  # A, in its own frame
    i_q: float
    v_d: float  # V, commanded
    v_q: float


@part
def control_step(now, command, theta_m, theta_o, i_a, i_b, due_position, due_speed, ticks, dt, c):
    """A tick: readings in, `ControlState` and `Seen` out.

    ``command`` and the angles are on the motor shaft, as read; ``i_a`` and ``i_b`` as sensed.
    ``ticks`` make a sample of the speed loop, ``dt`` is one tick of the current loops.
    """
    w_ref = clip(c.k_position * (command - theta_o), -c.w_max, c.w_max)
    w_ref = w_ref if due_position else now.w_ref
    speed_time = ticks * dt
    w_new = (theta_m - now.before) / speed_time
    w_seen = w_new if due_speed else now.w_seen
    before = theta_m if due_speed else now.before
    error = w_ref - w_seen
    wanted = c.k_speed * error + now.total
    torque = clip(wanted, -c.i_max * c.set_torque, c.i_max * c.set_torque)
    i_ref = torque / c.set_torque if due_speed else now.i_ref
    total = now.total + c.k_total * speed_time * (error + (torque - wanted) / c.k_speed)
    total = total if due_speed else now.total

    theta_e = c.pole_pairs * theta_m
    s, co = sincos(theta_e)
    i_beta = (i_a + 2.0 * i_b) / ROOT_3
    i_d = co * i_a + s * i_beta
    i_q = co * i_beta - s * i_a
    w_e = c.pole_pairs * w_seen
    e_d = -i_d
    e_q = i_ref - i_q
    u_d = c.k_current * e_d + now.total_d - w_e * c.set_q * i_q
    u_q = c.k_current * e_q + now.total_q + w_e * (c.set_d * i_d + c.set_flux)
    size = math.sqrt(u_d * u_d + u_q * u_q)
    most = c.v_supply / ROOT_3  # the circle within the hexagon of space-vector modulation
    beyond = most / size
    share = 1.0 if size <= most else beyond  # a select: a division in a branch stops the lanes
    v_d = share * u_d
    v_q = share * u_q
    total_d = now.total_d + c.k_voltage * dt * (e_d + (v_d - u_d) / c.k_current)
    total_q = now.total_q + c.k_voltage * dt * (e_q + (v_q - u_q) / c.k_current)
    s, co = sincos(theta_e + 1.5 * dt * w_e)
    after = ControlState(
        w_ref, i_ref, total, before, w_seen, total_d, total_q, co * v_d - s * v_q,
        s * v_d + co * v_q,
    )  # fmt: skip
    return after, Seen(i_d, i_q, v_d, v_q)
