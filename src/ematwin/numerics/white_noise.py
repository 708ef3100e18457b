"""How noisy a trace is: the white noise on it, apart from how it moves."""

import math

import numpy as np

from ematwin.numerics.quantiles import median

_ORDER = 4  # a trace that is sampled well is a cubic over five samples
_NORMAL = 0.6745  # median size of a normal variable, in standard deviations


def white_noise(trace: np.ndarray) -> float:
    """Standard deviation of the white noise on a trace (S,), in its unit.

    By differences of the fourth order, whose variance is 70 times that of the noise, and their
    median, so that corners and commutations do not count (von Neumann, Kent, Bellinson and Hart
    1941, Ann. Math. Stat. 12, 153-162; Hampel 1974, J. Am. Stat. Assoc. 69, 383-393). 0 for a trace
    of fewer than five samples.
    """
    if trace.size <= _ORDER:
        return 0.0
    gain = math.comb(2 * _ORDER, _ORDER)
    return median(np.abs(np.diff(trace, _ORDER))) / (_NORMAL * math.sqrt(gain))
