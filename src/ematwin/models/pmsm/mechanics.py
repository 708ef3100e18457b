"""Motor and output on a gear with play: what both models share.

docs/pmsm.md, "Mechanics". The gear is a spring and a damper behind the gap; friction sticks
(Borello and Dalla Vedova 2012), or in the reference model gives before it slides (LuGre), and falls
with speed (Stribeck; the form of Hess and Soom 1990, J. Tribology 112, 147-152).
"""

from typing import NamedTuple

from ematwin.numerics.backlash import contact_torque, stop_at_ends
from ematwin.numerics.compile import part, step
from ematwin.numerics.friction import advance_on_bristles, advance_speed, sliding_torque
from ematwin.numerics.scalar import sincos


class Motion(NamedTuple):
    """Speeds (rad/s) and angles (rad) on the motor shaft."""

    w_m: float
    theta_m: float
    w_o: float
    theta_o: float


@step
def fading(w, w_stribeck):
    """Share of the excess of static friction that is left at a speed."""
    x = w / w_stribeck
    return 1.0 / (1.0 + x * x)


@step
def torques(now, torque, load, c, dt):
    """Torques but friction on motor and output, and sliding friction of both, N m."""
    half = 0.5 * dt
    mid_m = now.theta_m + half * now.w_m
    mid_o = now.theta_o + half * now.w_o
    gear = contact_torque(mid_m, now.w_m, mid_o, now.w_o, c.half_gap, c.stiffness, c.damping)
    ripple, _ = sincos(c.cogging_periods * mid_m + c.cogging_phase)
    act_m = torque - gear - c.viscous_m * now.w_m - c.cogging * ripple
    act_o = gear - load - c.viscous_o * now.w_o
    slides_m = sliding_torque(c.friction_m, c.static_ratio, fading(now.w_m, c.w_stribeck))
    slides_o = sliding_torque(c.friction_o, c.static_ratio, fading(now.w_o, c.w_stribeck))
    return act_m, act_o, slides_m, slides_o


@step
def moved(now, w_m, w_o, c, dt):
    """`Motion` after a step that ends with these speeds."""
    half = 0.5 * dt
    theta_m = now.theta_m + half * (now.w_m + w_m)
    theta_o, w_o_kept = stop_at_ends(
        now.theta_o + half * (now.w_o + w_o), w_o, c.travel_low, c.travel_high
    )
    return Motion(w_m, theta_m, w_o_kept, theta_o)


@step
def advance_motion(now, torque, load, c, dt):
    """`Motion` after a step under a motor torque and a load, both of its middle."""
    act_m, act_o, slides_m, slides_o = torques(now, torque, load, c, dt)
    w_m = advance_speed(now.w_m, act_m, c.j_m, c.static_ratio * c.friction_m, slides_m, dt)
    w_o = advance_speed(now.w_o, act_o, c.j_o, c.static_ratio * c.friction_o, slides_o, dt)
    return moved(now, w_m, w_o, c, dt)


@part
def advance_with_bristles(now, bent_m, bent_o, torque, load, c, dt):
    """As `advance_motion`, with friction that gives; and how far bristles are bent after it, rad.

    Without bristles (stiffness 0) friction sticks.
    """
    if c.bristles_m == 0.0:
        return advance_motion(now, torque, load, c, dt), 0.0, 0.0
    act_m, act_o, slides_m, slides_o = torques(now, torque, load, c, dt)
    w_m, bent_m = advance_on_bristles(
        now.w_m, bent_m, act_m, 1.0 / c.j_m, slides_m, c.bristles_m,
        fading(now.w_m, c.w_stribeck) * c.bristle_damping, dt,
    )  # fmt: skip
    w_o, bent_o = advance_on_bristles(
        now.w_o, bent_o, act_o, 1.0 / c.j_o, slides_o, c.bristles_o,
        fading(now.w_o, c.w_stribeck) * c.bristle_damping, dt,
    )  # fmt: skip
    return moved(now, w_m, w_o, c, dt), bent_m, bent_o
