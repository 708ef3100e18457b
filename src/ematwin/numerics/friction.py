"""Dry friction, and friction whose bristles bend before they slide.

Borello and Dalla Vedova (2012), Int. J. Mechanics and Control 13(2), 37-48. ``act`` is the sum of
all torques but friction. At rest friction answers ``act`` up to the static torque; in motion the
dynamic torque opposes the speed; a step that would reverse the speed ends at exactly zero.

LuGre: Canudas de Wit, Olsson, Astrom and Lischinsky (1995), IEEE Trans. Automatic Control 40(3),
419-425. With the deflection z of the bristles, at a speed w,

    dz/dt = w - k |w| z / g(w),   T = k z + d(w) dz/dt,

where g is the torque in steady sliding and k the stiffness before it. The damping d fades with
speed: with a constant one LuGre adds energy (Barabanov and Ortega 2000, ibid. 45(4), 675-680).
"""

import math

from ematwin.numerics.compile import step
from ematwin.numerics.scalar import clip, fallen


@step
def friction_torque(w, act, t_static, t_dynamic):
    """Friction torque, N m: positive where it opposes positive motion."""
    held = clip(act, -t_static, t_static)
    return held if w == 0.0 else math.copysign(t_dynamic, w)


@step
def advance_speed(w, act, inertia, t_static, t_dynamic, dt):
    """Speed after one semi-implicit Euler step of a mass with dry friction."""
    return advance_mobile(w, act, 1.0 / inertia, t_static, t_dynamic, dt)


@step
def advance_mobile(w, act, mobility, t_static, t_dynamic, dt):
    """As `advance_speed`, by the inverse of the inertia, so that no step divides."""
    w_next = w + dt * mobility * (act - friction_torque(w, act, t_static, t_dynamic))
    # Borello's stop: a step that would pass through zero ends there, and the next one decides
    # from rest whether the static torque holds. Without it friction chatters about zero speed.
    return 0.0 if w * w_next < 0.0 else w_next


@step
def advance_through_rest(
    w, act, mobility, t_dynamic, act_rest, before_rest, mobility_rest, static_rest, dynamic_rest, dt
):
    """Speed after a step of a mass with dry friction, accurate for long steps.

    Where the speed reverses, the mass goes on from rest for the rest of the step; where it
    breaks loose, the time since it did is taken from how fast its torque grew. Ending such steps at
    zero, as `advance_speed` does, is an error of first order (derived here; docs/models.md,
    "Steps").

    ``act`` is the torque in the middle of the step, ``mobility`` the inverse of the inertia. Those
    named ``_rest`` hold from rest on, where less may move than before; ``before_rest`` is that
    torque in the middle of the step before. Gives the speed, the share of the step until the mass
    came to rest, 1 if it did not, and the acceleration (rad/s^2) with which it goes on.
    """
    rest = w == 0.0
    slowing = mobility * (math.copysign(t_dynamic, w) - act)
    slows = dt * slowing
    w_run = w - slows
    turns = w * w_run < 0.0
    pushed = math.copysign(1.0, act_rest)
    size = abs(act_rest)
    grown = pushed * (act_rest - before_rest)
    part = size - static_rest if rest else w
    share = part / (grown if rest else slows)
    share = 0.5 if rest & (grown <= 0.0) else share  # something else gave way: at the start
    time = clip(0.5 + share, 0.5, 1.5) if rest else 1.0 - share
    starting = mobility_rest * (act_rest - pushed * dynamic_rest) if size > static_rest else 0.0
    fresh = rest | turns
    w_next = time * dt * starting if fresh else w_run
    return w_next, share if turns else 1.0, starting if fresh else -slowing


@step
def loaded_friction(direction, load, t_unloaded, c_opposing, c_aiding):
    """Dynamic friction torque with a load, N m, before the friction fault.

    ``direction`` is the speed, or at rest the torque that would set the mass in motion. With
    ``c_opposing = 1/eta_o - 1`` and ``c_aiding = 1 - eta_a`` the load adds to the unloaded torque
    according to whether it opposes or aids the motion.
    """
    c = c_opposing if direction * load < 0.0 else c_aiding
    return t_unloaded + c * abs(load)


@step
def dithered_static(t_static, t_dynamic, ripple):
    """Static torque that a mean torque must pass when a ripple of this amplitude rides on it, N m.

    The peaks of the ripple break the mass loose before the mean reaches the static torque. Derived
    here: it brings the healthy monitor model a quarter closer to the reference model.
    """
    lowered = t_static - ripple
    return t_dynamic if lowered < t_dynamic else lowered


@step
def fading(w, w_stribeck):
    """Share of the excess of static friction, and of the damping, that is left at a speed."""
    x = w / w_stribeck
    return fallen(x * x)


@step
def sliding_torque(t_dynamic, static_ratio, fade):
    """Torque g in steady sliding, N m, with the share ``fade`` of the excess of static friction."""
    return t_dynamic * (1.0 + (static_ratio - 1.0) * fade)


@step
def advance_on_bristles(w, bent, act, mobility, sliding, stiffness, damping, dt):
    """Speed of a mass and deflection of its bristles (rad) after ``dt``.

    ``act`` is the sum of all torques but friction, ``sliding`` the torque g, ``mobility`` the
    inverse of the inertia. The deflection is advanced by backward Euler, which no speed makes
    unstable; then the speed by its torque.
    """
    slips = sliding + dt * stiffness * abs(w)
    after = (bent + dt * w) * sliding / slips if slips > 0.0 else 0.0
    torque = stiffness * after + damping * (after - bent) / dt
    return w + dt * mobility * (act - torque), after
