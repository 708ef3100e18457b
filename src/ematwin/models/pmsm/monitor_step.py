"""One step of the monitor model, and the mechanics and the controller that both models share.

docs/pmsm.md. **Controller.** Position P, speed PI, current PI with decoupling; position and speed
loops take part where their samples fall due. The voltage that a tick of the current loops computes
is applied one tick later. Limits feed back into the integrators (Åström and Hägglund 1995, PID
Controllers, section 3.5), the angle of the voltage leads by the tick and a half until the middle of
its application.

**Mechanics.** The gear is a spring and a damper behind the gap; friction sticks
(Borello and Dalla Vedova 2012), or gives before it slides (LuGre), and falls with speed (Stribeck;
the form of Hess and Soom 1990, J. Tribology 112, 147-152).

**Motor**, in its rotor's frame, averaged over the PWM. Where a fault breaks the symmetry of the
phases, its negative sequence is included: of the EMF in closed form, of resistances and leg errors
by way of the phase currents. The current here flows in the turns that are not shorted; currents of
shorted loops add to it at the terminals. A step happens in its middle (trapezoidal rule); the
voltage stands still in the stator meanwhile.
"""

import math
from typing import NamedTuple

from ematwin.numerics.backlash import contact_torque, stop_at_ends
from ematwin.numerics.compile import part, step
from ematwin.numerics.friction import advance_on_bristles, advance_speed, sliding_torque
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
def advance_with_bristles(now, torque, load, c, dt):
    """As `advance_motion`, with friction that may give; and how far bristles are bent, rad."""
    if c.bristles_m == 0.0:
        return advance_motion(now, torque, load, c, dt), 0.0, 0.0
    act_m, act_o, slides_m, slides_o = torques(now, torque, load, c, dt)
    w_m, bent_m = advance_on_bristles(
        now.w_m, now.bent_m, act_m, 1.0 / c.j_m, slides_m, c.bristles_m,
        fading(now.w_m, c.w_stribeck) * c.bristle_damping, dt,
    )  # fmt: skip
    w_o, bent_o = advance_on_bristles(
        now.w_o, now.bent_o, act_o, 1.0 / c.j_o, slides_o, c.bristles_o,
        fading(now.w_o, c.w_stribeck) * c.bristle_damping, dt,
    )  # fmt: skip
    return moved(now, w_m, w_o, c, dt), bent_m, bent_o


class MonitorState(NamedTuple):
    """State of the monitor model."""

    i_d: float  # A, magnetising, in the rotor's frame
    i_q: float
    j_a: float  # A, what shorted loops draw: mu i_f
    j_b: float
    j_c: float
    w_m: float  # rad/s
    theta_m: float  # rad
    w_o: float
    theta_o: float
    dw_m: float  # rad/s, change of w_m in the last step
    bent_m: float  # rad, of the bristles between motor and housing
    bent_o: float


@step
def terminal_currents(s, co, now):
    """Currents of the phases a, b, c; ``s`` and ``co`` of the rotor's electrical angle."""
    drawn = (now.j_a + now.j_b + now.j_c) / 3.0
    x = co * now.i_d - s * now.i_q + now.j_a - drawn
    y = s * now.i_d + co * now.i_q + (now.j_b - now.j_c) / ROOT_3
    i_b = -0.5 * x + 0.5 * ROOT_3 * y
    return x, i_b, -x - i_b


@step
def leg_error(i, c):
    """Voltage that dead time and devices take from a leg, V."""
    return c.v_leg * clip(i / c.knee, -1.0, 1.0)


@step
def lost_in_legs(s, co, now, c):
    """Leg errors as a part of the voltage vector, alpha and beta, V."""
    i_a, i_b, i_c = terminal_currents(s, co, now)
    e_b = leg_error(i_b, c)
    e_c = leg_error(i_c, c)
    return (2.0 * leg_error(i_a, c) - e_b - e_c) / 3.0, (e_b - e_c) / ROOT_3


@step
def winding_voltages(s, co, now, v_alpha, v_beta, c):
    """Voltages that legs and connectors leave over the phases a, b, c; they add up to zero."""
    i_a, i_b, i_c = terminal_currents(s, co, now)
    e_a = c.added_a * i_a + leg_error(i_a, c)
    e_b = c.added_b * i_b + leg_error(i_b, c)
    e_c = c.added_c * i_c + leg_error(i_c, c)
    e_0 = (e_a + e_b + e_c) / 3.0
    u_a = v_alpha - e_a + e_0
    u_b = -0.5 * v_alpha + 0.5 * ROOT_3 * v_beta - e_b + e_0
    return u_a, u_b, -u_a - u_b


@step
def in_rotor_frame(s, co, x_a, x_b, x_c):
    """Phases that add up to zero as d and q."""
    beta = (x_b - x_c) / ROOT_3
    return co * x_a + s * beta, co * beta - s * x_a


@step
def emf_shape(s, co, theta_m, c):
    """EMF over speed in the rotor's frame, d and q, and its zero sequence, V s/rad."""
    s_m, c_m = sincos(theta_m)
    x = c.static_x + c.dynamic_x * c_m - c.dynamic_y * s_m
    y = c.static_y + c.dynamic_x * s_m + c.dynamic_y * c_m
    s_2 = 2.0 * s * co
    c_2 = co * co - s * s
    s_6 = s_2 * (3.0 - 4.0 * s_2 * s_2)
    c_6 = c_2 * (4.0 * c_2 * c_2 - 3.0)
    k_d = -0.5 * (x * s_2 + y * c_2) - (c.h_5 + c.h_7) * s_6
    k_q = 1.0 - 0.5 * (x * c_2 - y * s_2) - (c.h_5 - c.h_7) * c_6
    return c.k_e * k_d, c.k_e * k_q, 0.5 * c.k_e * (y * co - x * s)


@part
def monitor_step(now, v_alpha, v_beta, load, c, dt):
    """Advance by ``dt`` under a voltage that stands still; ``load`` is taken in the middle."""
    mid = now.theta_m + 0.5 * dt * now.w_m
    s, co = sincos(c.pole_pairs * mid)
    k_d, k_q, k_0 = emf_shape(s, co, mid, c)
    w_mid = now.w_m + 0.5 * now.dw_m
    w_e = c.pole_pairs * w_mid
    zero = w_mid * k_0
    # Legs and connectors see the currents of the middle: of a short, those of the turns and of the
    # loop alternate, and only their sum is steady.
    u_a, u_b, u_c = winding_voltages(s, co, now, v_alpha, v_beta, c)
    u_d, u_q = in_rotor_frame(s, co, u_a, u_b, u_c)
    half = 0.5 * dt
    middle = MonitorState(
        now.i_d + half / c.l_d * (u_d - w_mid * k_d - c.resistance * now.i_d
                                  + w_e * c.l_q * now.i_q),
        now.i_q + half / c.l_q * (u_q - w_mid * k_q - c.resistance * now.i_q
                                  - w_e * c.l_d * now.i_d),
        now.j_a + 0.5 * (1.0 - c.decay_a) * (c.loop_a * (u_a + zero) - now.j_a),
        now.j_b + 0.5 * (1.0 - c.decay_b) * (c.loop_b * (u_b + zero) - now.j_b),
        now.j_c + 0.5 * (1.0 - c.decay_c) * (c.loop_c * (u_c + zero) - now.j_c),
        now.w_m, now.theta_m, now.w_o, now.theta_o, now.dw_m, now.bent_m, now.bent_o,
    )  # fmt: skip
    u_a, u_b, u_c = winding_voltages(s, co, middle, v_alpha, v_beta, c)
    u_d, u_q = in_rotor_frame(s, co, u_a, u_b, u_c)
    u_d = u_d - w_mid * k_d
    u_q = u_q - w_mid * k_q
    # the trapezoidal rule: (L/dt + R/2) i+ -+ w L i+ /2 = (L/dt - R/2) i +- w L i /2 + u
    half_r = 0.5 * c.resistance
    cross_d = 0.5 * w_e * c.l_q
    cross_q = 0.5 * w_e * c.l_d
    a_d = c.l_d / dt + half_r
    a_q = c.l_q / dt + half_r
    b_d = (a_d - c.resistance) * now.i_d + cross_d * now.i_q + u_d
    b_q = (a_q - c.resistance) * now.i_q - cross_q * now.i_d + u_q
    inverse = 1.0 / (a_d * a_q + cross_d * cross_q)
    i_d = (a_q * b_d + cross_d * b_q) * inverse
    i_q = (a_d * b_q - cross_q * b_d) * inverse
    # each loop sees the voltage of its phase over the turns
    j_a = now.j_a + (1.0 - c.decay_a) * (c.loop_a * (u_a + zero) - now.j_a)
    j_b = now.j_b + (1.0 - c.decay_b) * (c.loop_b * (u_b + zero) - now.j_b)
    j_c = now.j_c + (1.0 - c.decay_c) * (c.loop_c * (u_c + zero) - now.j_c)
    m_d = 0.5 * (now.i_d + i_d)
    m_q = 0.5 * (now.i_q + i_q)
    drawn = 0.5 * (now.j_a + now.j_b + now.j_c + j_a + j_b + j_c)
    torque = (
        1.5 * (k_d * m_d + k_q * m_q + c.pole_pairs * (c.l_d - c.l_q) * m_d * m_q) - k_0 * drawn
    )
    motion, bent_m, bent_o = advance_with_bristles(now, torque, load, c, dt)
    return MonitorState(
        i_d, i_q, j_a, j_b, j_c, motion.w_m, motion.theta_m, motion.w_o, motion.theta_o,
        motion.w_m - now.w_m, bent_m, bent_o,
    )  # fmt: skip
