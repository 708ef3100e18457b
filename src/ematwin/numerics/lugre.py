"""LuGre friction: bristles bend before they slide.

Canudas de Wit, Olsson, Astrom and Lischinsky (1995), IEEE Trans. Automatic Control 40(3), 419-425.
With the deflection z of the bristles, at a speed w,

    dz/dt = w - k |w| z / g(w),   T = k z + d(w) dz/dt,

where g is the torque in steady sliding and k the stiffness before it. The damping d fades with
speed: with a constant one LuGre adds energy (Barabanov and Ortega 2000, ibid. 45(4), 675-680).
"""

import math

from ematwin.numerics.compile import step


@step
def fading(w, w_stribeck):
    """Share of the excess of static friction, and of the damping, that is left at a speed."""
    x = w / w_stribeck
    return math.exp(-x * x)


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
