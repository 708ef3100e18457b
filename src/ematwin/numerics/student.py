"""Quantiles of Student's t.

`scipy.special.stdtrit` gives the same, and takes as long to import as a motion takes to judge.
"""

import math

import numpy as np


def student_quantile(probability: float, freedom: int) -> float:
    """The value that Student's t with a whole number of degrees of freedom keeps below.

    ``probability`` is in (0, 1). Found by bisection of the finite series in theta = atan(t/sqrt(n))
    (Abramowitz and Stegun 1964, 26.7.3 and 26.7.4).
    """
    low, high = -0.5 * math.pi, 0.5 * math.pi
    for _ in range(60):
        theta = 0.5 * (low + high)
        if _below(theta, freedom) < probability:
            low = theta
        else:
            high = theta
    return math.sqrt(freedom) * math.tan(0.5 * (low + high))


def _below(theta: float, freedom: int) -> float:
    """Probability of less than sqrt(n) tan(theta)."""
    odd = freedom % 2
    k = np.arange(1 + odd, freedom - 1, 2)
    powers = math.cos(theta) ** 2 * k / (k + 1.0)
    series = math.sin(theta) * (1.0 + float(np.cumprod(powers).sum()))
    if odd:
        inner = theta + (series * math.cos(theta) if freedom > 1 else 0.0)
        return 0.5 + inner / math.pi
    return 0.5 + 0.5 * series
