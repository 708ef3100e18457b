"""Low-pass, misfit and percentage error, by loops from their definitions."""

import math


def butterworth(cutoff, sample_rate):
    """Second-order Butterworth by the bilinear transform: b0 b1 b2, a1 a2 (a0 = 1).

    H(s) = 1/(s^2 + sqrt(2) s + 1) with s = (1 - z^-1)/((1 + z^-1) tan(pi f_c/f_s)).
    """
    t = math.tan(math.pi * cutoff / sample_rate)
    scale = 1 + math.sqrt(2) * t + t**2
    b = [t**2 / scale, 2 * t**2 / scale, t**2 / scale]
    a = [2 * (t**2 - 1) / scale, (1 - math.sqrt(2) * t + t**2) / scale]
    return b, a


def low_pass(signal, cutoff, sample_rate):
    """y_n = b0 x_n + b1 x_n-1 + b2 x_n-2 - a1 y_n-1 - a2 y_n-2, at rest at x_0 before."""
    b, a = butterworth(cutoff, sample_rate)
    x1 = x2 = y1 = y2 = signal[0]
    out = []
    for x in signal:
        y = b[0] * x + b[1] * x1 + b[2] * x2 - a[0] * y1 - a[1] * y2
        x1, x2 = x, x1
        y1, y2 = y, y1
        out.append(y)
    return out


def slope(signal, interval):
    """Central differences; one-sided at the ends."""
    last = len(signal) - 1
    return [
        (signal[min(n + 1, last)] - signal[max(n - 1, 0)])
        / (interval * (min(n + 1, last) - max(n - 1, 0)))
        for n in range(last + 1)
    ]


def misfit(measured, simulated, interval, slope_scale):
    """Eq. 2 of the paper, with its 1 A/s as ``slope_scale``."""
    total = 0.0
    for i, m, d in zip(measured, simulated, slope(measured, interval), strict=True):
        total += (i - m) ** 2 / math.sqrt(d**2 + slope_scale**2)
    return total


def error_percent(found, injected):
    """Err% of the paper, section 7.1, with ``injected`` in the place of k^."""
    total = 0.0
    for n in range(6):
        total += (found[n] - injected[n]) ** 2
    total += injected[5] * (found[6] - injected[6]) ** 2
    total += (found[7] - injected[7]) ** 2
    return 100 * math.sqrt(total)


def keys(x):
    """Keys (1981), eq. 15: the kernel of cubic convolution."""
    x = abs(x)
    if x < 1.0:
        return 1.5 * x**3 - 2.5 * x**2 + 1.0
    if x < 2.0:
        return -0.5 * x**3 + 2.5 * x**2 - 4.0 * x + 2.0
    return 0.0


def advanced(signal, shift):
    """A signal as it is ``shift`` samples later; before and after it, its ends go on."""
    last = len(signal) - 1
    out = []
    for n in range(last + 1):
        at = min(max(n + shift, -5.0), last + 5.0)
        around = range(math.floor(at) - 2, math.floor(at) + 4)
        out.append(sum(signal[min(max(k, 0), last)] * keys(at - k) for k in around))
    return out
