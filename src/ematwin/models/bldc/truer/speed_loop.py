"""Speed loop with an integral term, sampled, and late.

At each sample, with the speed error e = w_ref - omega_m of the controller,

    x <- x + k_i T e,   i_asked = (k_speed e + x)/(2 k_e),

which the drive is asked for ``delay`` later and until the next one (zero-order hold). The integral
stands still while the current limit is passed and e points beyond it. A sample time of zero is the
continuous loop, each step a sample. Textbook form of a sampled PI controller.
"""

from ematwin.numerics.compile import part
from ematwin.numerics.scalar import clip

SOON = 0.499  # of a step: a sample belongs to the nearest one


@part
def advance_speed_loop(
    asked, pending, integral, wait, late, command, theta_o, w_m, gain, c, truer, dt
):
    """The loop over a step: ``asked`` (A), ``pending``, ``integral``, ``wait`` and ``late`` after.

    ``wait`` is the time until the next sample, ``late`` until ``pending`` is asked for, s; ``gain``
    is that of the position loop, 1/s.
    """
    soon = SOON * dt
    asked = pending if late <= soon else asked
    error = clip(gain * (command - theta_o), -c.w_max, c.w_max) - w_m
    span = truer.sample_time if truer.sample_time > 0.0 else dt
    grown = integral + truer.integral_gain * span * error
    wish = (c.k_speed * error + grown) / (2.0 * c.k_e)
    beyond = (abs(wish) > c.i_max) & (wish * error > 0.0)
    due = wait <= soon
    pending = wish if due else pending
    integral = integral if beyond | (not due) else grown
    late = truer.delay if due else late
    wait = wait + span if due else wait
    asked = pending if late <= soon else asked
    return asked, pending, integral, wait - dt, late - dt
