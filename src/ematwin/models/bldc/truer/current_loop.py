"""Current loop with an integral term, sampled, and late; pulse-width modulation by its mean.

At each sample, with the error e = i_ref - i of the current of the pair,

    u_asked = clip(k_p e + x, -V, V),   x <- x + k_i T e,

which stands across the pair from ``delay`` later on until the next answer (zero-order hold), and is
shared by its legs: (V + u)/2 and (V - u)/2. The integral stands still while the supply limits the
voltage and e points beyond it. Textbook form of a sampled PI controller.

The loop sees half of the difference of the pair's currents. Commutation passes the current of one
leg on to the next, which has none: the flux linkage of the pair, L_p i_p - L_n i_n, begins with
that of the leg which both pairs share, whatever the diode of the third leg does meanwhile. Hence
the loop sees its current fall to L_shared/(L_shared + L_new), one half in a healthy motor (derived
here). A comparator, which sees the shared leg, does not let it fall.

Dead time and switches take a voltage that has the sign of the current (`left_of_voltage`).
"""

from ematwin.models.bldc.truer.speed_loop import SOON
from ematwin.numerics.compile import part
from ematwin.numerics.scalar import clip

_SMALL = 0.1  # A: below it dead time takes less, as the ripple changes the sign of the current


@part
def advance_current_loop(
    voltage, pending, integral, wait, late, i_ref, i_seen, supply, truer, dt
):  # fmt: skip
    """The loop over a step: ``voltage``, ``pending``, ``integral`` (V), ``wait``, ``late`` after.

    ``wait`` is the time until the next sample, ``late`` until ``pending`` is applied, s.
    """
    soon = SOON * dt
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
