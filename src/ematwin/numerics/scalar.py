"""Scalar functions that vectorise where the standard ones do not.

``math.sin`` stops the lanes from vectorising; ``math.floor`` gives an integer, which costs two
conversions; ``min`` and ``max`` test for NaN twice. Together these made a step of the monitor
model 1.3 times slower (docs/speed.md).
"""

import math

import numpy as np

from ematwin.numerics.compile import step

ROOT_3 = math.sqrt(3.0)
THIRD_TURN = 2.0 * math.pi / 3.0
_PER_PI = 1.0 / math.pi
# pi in two parts (Cody and Waite): a count of half turns times the first is exact
_PI_HIGH = 3.140625
_PI_LOW = 9.6765358979323846e-4


@step
def clip(x, low, high):
    """``x`` limited to [low, high]; NaN stays NaN."""
    x = low if x < low else x
    return high if x > high else x


@step
def sincos(x):
    """Sine and cosine of ``x`` in rad.

    The angle is reduced to a quarter turn either way, where polynomials of degree 13 and 12 err by
    less than 4e-12 (`tests/unit/numerics/test_scalar.py`): interpolated in r^2 at Chebyshev points,
    sine less r over r^3, cosine less 1 over r^2.
    """
    halves = np.floor(x * _PER_PI + 0.5)
    r = (x - halves * _PI_HIGH) - halves * _PI_LOW
    r2 = r * r
    s = -2.503674500842829547e-8 + r2 * 1.550250902793809009e-10
    s = -1.984126870905615070e-4 + r2 * (2.755712317437327274e-6 + r2 * s)
    s = r + r * r2 * (-0.1666666666665846713 + r2 * (8.333333330940365208e-3 + r2 * s))
    c = -2.753434319498821427e-7 + r2 * 2.004383886760728344e-9
    c = -1.388888719655378210e-3 + r2 * (2.480129421017002438e-5 + r2 * c)
    c = 1.0 + r2 * (-0.4999999999987745335 + r2 * (4.166666663090179977e-2 + r2 * c))
    way = 0.5 * halves
    way = 1.0 - 4.0 * (way - np.floor(way))  # -1 after an odd number of half turns
    return way * s, way * c


@step
def fallen(x):
    """exp(-x) for x >= 0, to 1e-11 of it; less than 1e-13 beyond 30.

    The series of a 256th of x, squared eight times.
    """
    y = -clip(x, 0.0, 30.0) / 256.0
    e = 1.0 / 120.0 + y * (1.0 / 720.0 + y * (1.0 / 5040.0 + y * (1.0 / 40320.0)))
    e = 1.0 + y * (1.0 + y * (1.0 / 2.0 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y * e))))
    e = (e * e) * (e * e)
    e = (e * e) * (e * e)
    e = (e * e) * (e * e)
    return (e * e) * (e * e)


@step
def fifth(square):
    """sin 5x over sin x by sin^2 x; cos 5x over cos x by cos^2 x (Chebyshev polynomials)."""
    return 5.0 - square * (20.0 - 16.0 * square)


@step
def seventh(square):
    """sin 7x over sin x by sin^2 x; less cos 7x over cos x by cos^2 x."""
    return 7.0 - square * (56.0 - square * (112.0 - 64.0 * square))


@step
def lag(x, towards, time, dt):
    """First-order lag with a time constant (s), by backward Euler; 0 follows at once."""
    return (time * x + dt * towards) / (time + dt)


@step
def biquad(x, z1, z2, taps):
    """Output of a second-order filter and its next state, by ``b0 b1 b2 a1 a2``.

    Direct form II transposed.
    """
    b0, b1, b2, a1, a2 = taps
    y = b0 * x + z1
    return y, b1 * x - a1 * y + z2, b2 * x - a2 * y
