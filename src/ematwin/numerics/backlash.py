"""Backlash between motor and output, three ways, all on the motor shaft.

``half_gap`` is half the backlash: the output can lag or lead the motor by that much.

- `play`: the hysteresis operator of a massless output that moves only when it is pushed.
- `contact_torque`: two masses with a stiff, damped contact (reference model).
- `advance_rigid_play`: two masses with a rigid, inelastic contact (monitor model). Its limit for
  a light output held by friction is `play`; it takes steps ten times as long as the stiff contact
  allows.
"""

import math

from ematwin.numerics.compile import step
from ematwin.numerics.friction import advance_mobile, advance_through_rest
from ematwin.numerics.scalar import clip

_CLOSED = 1e-12  # rad, on the motor shaft


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
    theta_m, w_m, theta_o, w_o, act_m, before_m, act_o, mobility_m, mobility_o, mobility_both,
    share_o, ts_m, td_m, ts_o, td_o, half_gap, dt,
):  # fmt: skip
    """Advance two masses with rigid contact by ``dt``.

    ``act_m`` and ``act_o`` act in the middle of the step, ``before_m`` acted on the motor in the
    step before. ``mobility`` is the inverse of an inertia, of the motor, the output and both;
    ``share_o`` is the share of the output in the inertia of both. Gives ``theta_m, w_m, theta_o,
    w_o``; the acceleration of the motor at the end of the step, rad/s^2; by how much an impact
    changed its speed; and the share of the step that was left after it, 0 without one.

    Both masses first move freely. Where that would close the gap beyond its width they meet: from
    then on they have one speed, which keeps their momentum (inelastic impact, and rolling on
    together), and share all torques and both frictions. Where they come to rest together and the
    motor turns back from the face that it pushed, it goes on alone and static friction holds the
    output. Positions move with the mean of the speeds before and after. An output that flies freely
    hardly ever reverses; it is not followed through rest.
    """
    free_m = advance_mobile(w_m, act_m, mobility_m, ts_m, td_m, dt)
    free_o = advance_mobile(w_o, act_o, mobility_o, ts_o, td_o, dt)
    half = 0.5 * dt
    theta_o_free = theta_o + half * (w_o + free_o)
    before = clip(theta_m - theta_o, -half_gap, half_gap)
    twist = theta_m + half * (w_m + free_m) - theta_o_free
    # two that come to rest together go on together, if they do
    rest = (free_m == 0.0) & (free_o == 0.0) & (abs(abs(before) - half_gap) < _CLOSED)
    apart = (abs(twist) <= half_gap) & (not rest)
    # In contact the output lies on the face that it was pushed to: no drift of the gap.
    face = math.copysign(half_gap, twist)
    # the share of the step until they meet; a gap of mere rounding is none
    rolls = apart | (abs(face - before) < _CLOSED)
    met = 0.0 if rolls else (face - before) / (twist - before)
    left = dt - met * dt
    w_met = w_m + met * (free_m - w_m)
    jump = 0.0 if apart else share_o * (w_o + met * (free_o - w_o) - w_met)
    w = w_met + jump
    theta_met = theta_m + met * half * (w_m + w_met)
    joint = 0.0 if apart else 1.0
    leaves = twist * w > 0.0
    after = 0.0 if leaves else joint
    slower = mobility_both - mobility_m
    w_next, share, gains = advance_through_rest(
        w, act_m + joint * act_o, mobility_m + joint * slower, td_m + joint * td_o,
        act_m + after * act_o, before_m + after * act_o, mobility_m + after * slower,
        ts_m + after * ts_o, td_m + after * td_o, left,
    )  # fmt: skip
    theta_m_next = theta_met + 0.5 * left * (w + w_next)
    parts = leaves & (share < 1.0)
    w_o_next = 0.0 if parts else w_next
    theta_o_next = theta_met - face + 0.5 * left * share * w if parts else theta_m_next - face
    theta_o_next = theta_o_free if apart else theta_o_next
    theta_o_next = clip(theta_o_next, theta_m_next - half_gap, theta_m_next + half_gap)
    return (
        theta_m_next, w_next, theta_o_next, free_o if apart else w_o_next,
        gains, jump, 0.0 if rolls else 1.0 - met,
    )  # fmt: skip


@step
def stop_at_ends(theta_o, w_o, travel_low, travel_high):
    """Inelastic end stops: the output rests on the stop it has reached."""
    w_o = 0.0 if (theta_o <= travel_low) & (w_o < 0.0) else w_o
    w_o = 0.0 if (theta_o >= travel_high) & (w_o > 0.0) else w_o
    return clip(theta_o, travel_low, travel_high), w_o
