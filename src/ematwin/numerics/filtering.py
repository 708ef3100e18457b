"""The recursion of a second-order filter."""

from ematwin.numerics.compile import loop


@loop
def second_order(taps, state, signal):
    """Filter a signal (S,) in place: ``b0 b1 b2 a1 a2`` of ``taps``, direct form II transposed.

    ``state`` (2,) holds the state before, and afterwards that after it.
    """
    b0, b1, b2, a1, a2 = taps[0], taps[1], taps[2], taps[3], taps[4]
    z1 = state[0]
    z2 = state[1]
    for n in range(signal.size):
        x = signal[n]
        y = b0 * x + z1
        z1 = b1 * x - a1 * y + z2
        z2 = b2 * x - a2 * y
        signal[n] = y
    state[0] = z1
    state[1] = z2
