"""Sampled loops of the reference model: speed and current, each with an integral term, and late.

Speed loop.
At each sample, with the speed error e = w_ref - omega_m of the controller,

    x <- x + k_i T e,   i_asked = (k_speed e + x)/(2 k_e),

which the drive is asked for ``delay`` later and until the next one (zero-order hold). The integral
stands still while the current limit is passed and e points beyond it. A sample time of zero is the
continuous loop, each step a sample. Textbook form of a sampled PI controller.

Current loop, with pulse-width modulation by its mean.
At each sample, with the error e = i_ref - i of the current of the pair,

    u_asked = clip(k_p e + x, -V, V),   x <- x + k_i T e,

which stands across the pair from ``delay`` later on until the next answer (zero-order hold), and is
shared by its legs: (V + u)/2 and (V - u)/2. The integral stands still while the supply limits the
voltage and e points beyond it. Textbook form of a sampled PI controller.

The loop sees half of the difference of the pair's currents. Commutation passes the current of one
leg on to the next, which has none: the flux linkage of the pair, L_p i_p - L_n i_n, begins with
the current of the leg in both pairs, whatever the diode of the third leg does meanwhile. Hence
the loop sees its current fall to L_shared/(L_shared + L_new), one half in a healthy motor (derived
here). A comparator, which sees the shared leg, does not let it fall.

Dead time and switches take a voltage that has the sign of the current (`left_of_voltage`).
"""

from ematwin.numerics.compile import part
from ematwin.numerics.scalar import clip

_SOON = 0.499  # of a step: a sample belongs to the nearest one
_SMALL = 0.1  # A: below it dead time takes less, as the ripple changes the sign of the current


@part
def advance_speed_loop(
    asked, pending, integral, wait, late, command, theta_o, w_m, gain, c, truer, dt
):
    """The loop over a step: ``asked`` (A), ``pending``, ``integral``, ``wait`` and ``late`` after.

    ``wait`` is the time until the next sample, ``late`` until ``pending`` is asked for, s; ``gain``
    of the position loop in 1/s.
    """
    soon = _SOON * dt
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


@part
def advance_current_loop(
    voltage, pending, integral, wait, late, i_ref, i_seen, supply, truer, dt
):  # fmt: skip
    """The loop over a step: ``voltage``, ``pending``, ``integral`` (V), ``wait``, ``late`` after.

    ``wait`` is the time until the next sample, ``late`` until ``pending`` is applied, s.
    """
    soon = _SOON * dt
    voltage = pending if late <= soon else voltage
    error = i_ref - i_seen
    wish = truer.current_gain * error + integral
    within = clip(wish, -supply, supply)
    grows = (within == wish) | ((wish - within) * error < 0.0)
    grown = integral + truer.current_integral * truer.current_sample * error
    due = wait <= soon
    pending = within if due else pending
    integral = grown if due & grows else integral
    late = truer.current_delay if due else late
    wait = wait + truer.current_sample if due else wait
    voltage = pending if late <= soon else voltage
    return voltage, pending, integral, wait - dt, late - dt


@part
def left_of_voltage(voltage, i, truer):
    """Voltage across the pair after what dead time and switches take, V."""
    return voltage - truer.lost_voltage * clip(i / _SMALL, -1.0, 1.0)
