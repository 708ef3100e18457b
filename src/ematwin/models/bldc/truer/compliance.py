"""A gear that gives: two masses with a spring, a damper and a gap between them, for long steps.

Across the gap, with half of the backlash beta and delta = theta_m - theta_o,

    T_c = K (delta - clip(delta, +-beta)) + D (w_m - w_o) in contact, never pulling,

the contact of the reference model. A stiff one is far faster than a step of the monitor model, so
T_c is taken implicitly: at (1 - eta) of the way from the start of the step to its end. With
s = K dt^2 (1/J_m + 1/J_o), eta = (1/2 + s)/(1 + s) is the trapezoidal rule for a gear that is soft
and backward Euler for one that is stiff, whose limit is an inelastic contact. Derived here; the
rule is the theta method of any textbook on stiff equations. An impact counts from the start of
its step on, so a stiff gear needs short steps (`BldcActuator.largest_stable_step`).
"""

import math

from ematwin.models.bldc.monitor_step import MonitorState
from ematwin.numerics.backlash import contact_torque, stop_at_ends
from ematwin.numerics.compile import part
from ematwin.numerics.friction import (
    advance_through_rest,
    dithered_static,
    friction_torque,
    loaded_friction,
)


@part
def implicit_weight(c, dt):
    """eta: weight of the end of a step."""
    s = c.contact_stiffness * dt * dt * (c.mobility_m + c.mobility_o)
    return (0.5 + s) / (1.0 + s)


@part
def implicit_contact(twist, slip, gained, mobility, half_gap, stiffness, damping, eta, dt):
    """Mean contact torque of a step, N m.

    ``twist`` (rad) and ``slip`` (rad/s) are motor less output at the start; ``gained`` is the
    acceleration between them without contact, and ``mobility`` how much of it a torque takes.
    """
    ahead = eta * dt
    free = twist + ahead * (slip + ahead * gained)
    face = half_gap if free > 0.0 else -half_gap
    torque = stiffness * (free - face) + damping * (slip + ahead * gained)
    torque = torque / (1.0 + mobility * ahead * (stiffness * ahead + damping))
    pushed = max(torque, 0.0) if free > 0.0 else min(torque, 0.0)
    return pushed if abs(free) > half_gap else 0.0


@part
def move_compliantly(state, i, load, kappa_eq, act_m, before_m, fault, c, dt):
    """The state after motor and output have moved under torques; arguments as in `move_rigidly`."""
    td_m = fault.friction * c.t_m
    ts_m = dithered_static(c.static_ratio * td_m, td_m, kappa_eq * c.half_band)
    now = contact_torque(
        state.theta_m, state.w_m, state.theta_o, state.w_o, fault.half_gap,
        c.contact_stiffness, c.contact_damping,
    )  # fmt: skip
    direction = state.w_o if state.w_o != 0.0 else now - load
    td_o = fault.friction * loaded_friction(direction, -load, c.t_o, c.c_opposing, c.c_aiding)
    ts_o = c.static_ratio * td_o
    # a mass that static friction holds against the contact as it is now takes none of it
    held_m = (state.w_m == 0.0) & (abs(act_m - now) <= ts_m)
    held_o = (state.w_o == 0.0) & (abs(now - load) <= ts_o)
    free_m = 0.0 if held_m else c.mobility_m
    free_o = 0.0 if held_o else c.mobility_o
    drag_m = friction_torque(state.w_m, act_m - now, td_m, td_m)
    drag_o = friction_torque(state.w_o, now - load, td_o, td_o)
    eta = implicit_weight(c, dt)
    torque = implicit_contact(
        state.theta_m - state.theta_o, state.w_m - state.w_o,
        free_m * (act_m - drag_m) - free_o * (-load - drag_o), free_m + free_o,
        fault.half_gap, c.contact_stiffness, c.contact_damping, eta, dt,
    )  # fmt: skip
    w_m, _, _ = advance_through_rest(
        state.w_m, act_m - torque, c.mobility_m, td_m,
        act_m - torque, before_m - now, c.mobility_m, ts_m, td_m, dt,
    )  # fmt: skip
    w_o, _, _ = advance_through_rest(
        state.w_o, torque - load, c.mobility_o, td_o,
        torque - load, now - load, c.mobility_o, ts_o, td_o, dt,
    )  # fmt: skip
    theta_m = state.theta_m + dt * (state.w_m + eta * (w_m - state.w_m))
    theta_o = state.theta_o + dt * (state.w_o + eta * (w_o - state.w_o))
    theta_o, w_o = stop_at_ends(theta_o, w_o, c.travel_low, c.travel_high)
    return MonitorState(i, w_m, theta_m, w_o, theta_o, w_m - state.w_m, i)


@part
def carried_share(state, fault, c, dt):
    """Share of the output that moves with the motor within a step: 0 apart, 1 for a rigid gear."""
    s = c.contact_stiffness * dt * dt * c.mobility_o
    meets = math.fabs(state.theta_m - state.theta_o) >= fault.half_gap
    return s / (1.0 + s) if meets else 0.0
