"""Backlash between motor and output, three ways, all on the motor shaft.

``half_gap`` is half the backlash: the output can lag or lead the motor by that much.

- `play`: the hysteresis operator of a massless output that moves only when it is pushed.
- `contact_torque`: two masses with a stiff, damped contact (reference model).
- `advance_rigid_play`: two masses with a rigid, inelastic contact (monitor model). Its limit for
  a light output held by friction is `play`; it takes steps ten times as long as the stiff contact
  allows.
"""

from ematwin.numerics.compile import step
from ematwin.numerics.friction import advance_speed
from ematwin.numerics.scalar import clip


@step
def play(theta_m, theta_o, half_gap):
    """Position of a massless output after the motor has moved to ``theta_m``."""
    return clip(theta_o, theta_m - half_gap, theta_m + half_gap)


@step
def contact_torque(theta_m, w_m, theta_o, w_o, half_gap, stiffness, damping):
    """Torque of the motor on the output, N m; zero inside the gap.

    Kelvin-Voigt contact that cannot pull: on leaving, damping never exceeds the elastic part.
    """
    twist = theta_m - theta_o
    squeeze = stiffness * (twist - clip(twist, -half_gap, half_gap))
    torque = squeeze + damping * (w_m - w_o)
    pushed = max(torque, 0.0) if squeeze > 0.0 else min(torque, 0.0)
    return pushed if squeeze != 0.0 else 0.0


@step
def advance_rigid_play(
    theta_m, w_m, theta_o, w_o, act_m, act_o, j_m, j_o, ts_m, td_m, ts_o, td_o, half_gap, dt
):
    """Advance two masses with rigid contact by ``dt``; gives ``theta_m, w_m, theta_o, w_o``.

    Both masses first move freely. Where that would close the gap beyond its width they meet:
    they take one speed, which keeps their momentum (inelastic impact, and rolling on together),
    and share all torques and both frictions.
    """
    free_m = advance_speed(w_m, act_m, j_m, ts_m, td_m, dt)
    free_o = advance_speed(w_o, act_o, j_o, ts_o, td_o, dt)
    j = j_m + j_o
    w_mean = (j_m * w_m + j_o * w_o) / j
    joint = advance_speed(w_mean, act_m + act_o, j, ts_m + ts_o, td_m + td_o, dt)
    twist = (theta_m + dt * free_m) - (theta_o + dt * free_o)
    apart = abs(twist) <= half_gap
    w_m_next = free_m if apart else joint
    w_o_next = free_o if apart else joint
    theta_m_next = theta_m + dt * w_m_next
    theta_o_next = theta_o + dt * w_o_next
    # In contact the output lies on the face that it was pushed to: no drift of the gap.
    face = half_gap if twist > 0.0 else -half_gap
    theta_o_next = theta_o_next if apart else theta_m_next - face
    return theta_m_next, w_m_next, theta_o_next, w_o_next


@step
def stop_at_ends(theta_o, w_o, travel_low, travel_high):
    """Inelastic end stops: the output rests on the stop it has reached."""
    low = theta_o <= travel_low
    high = theta_o >= travel_high
    leaves = w_o > 0.0 if low else w_o < 0.0
    return clip(theta_o, travel_low, travel_high), w_o if leaves | (low == high) else 0.0
