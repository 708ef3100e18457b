"""Motor and output on a gear with play: what both models share.

docs/pmsm.md, "Mechanics". The gear is a spring and a damper behind the gap; friction sticks
(Borello and Dalla Vedova 2012) and falls with speed (Stribeck; the form of Hess and Soom 1990, J.
Tribology 112, 147-152).
"""

from typing import NamedTuple

from ematwin.numerics.backlash import contact_torque, stop_at_ends
from ematwin.numerics.compile import step
from ematwin.numerics.friction import advance_speed
from ematwin.numerics.scalar import sincos


class Motion(NamedTuple):
    """Speeds (rad/s) and angles (rad) on the motor shaft."""

    w_m: float
    theta_m: float
    w_o: float
    theta_o: float


@step
def stribeck(w, t_dynamic, static_ratio, w_stribeck):
    """Dry friction torque in motion at a speed, N m."""
    x = w / w_stribeck
    return t_dynamic * (1.0 + (static_ratio - 1.0) / (1.0 + x * x))


@step
def advance_motion(now, torque, load, c, dt):
    """`Motion` after a step under a motor torque and a load, both of its middle."""
    half = 0.5 * dt
    mid_m = now.theta_m + half * now.w_m
    mid_o = now.theta_o + half * now.w_o
    gear = contact_torque(mid_m, now.w_m, mid_o, now.w_o, c.half_gap, c.stiffness, c.damping)
    ripple, _ = sincos(c.cogging_periods * mid_m)
    act_m = torque - gear - c.viscous_m * now.w_m - c.cogging * ripple
    act_o = gear - load - c.viscous_o * now.w_o
    w_m = advance_speed(
        now.w_m, act_m, c.j_m, c.static_ratio * c.friction_m,
        stribeck(now.w_m, c.friction_m, c.static_ratio, c.w_stribeck), dt,
    )  # fmt: skip
    w_o = advance_speed(
        now.w_o, act_o, c.j_o, c.static_ratio * c.friction_o,
        stribeck(now.w_o, c.friction_o, c.static_ratio, c.w_stribeck), dt,
    )  # fmt: skip
    theta_m = now.theta_m + half * (now.w_m + w_m)
    theta_o, w_o_kept = stop_at_ends(
        now.theta_o + half * (now.w_o + w_o), w_o, c.travel_low, c.travel_high
    )
    return Motion(w_m, theta_m, w_o_kept, theta_o)
