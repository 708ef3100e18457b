"""Quantiles and median of values.

`numpy.quantile` and `numpy.median` give the same and load `numpy.ma` for it, which takes longer
than all that is asked of them here.
"""

from collections.abc import Sequence

import numpy as np


def quantiles(values: np.ndarray, shares: Sequence[float]) -> np.ndarray:
    """Quantiles (Q,) of values (N,), linear between them."""
    places = np.asarray(shares) * (len(values) - 1)
    return np.interp(places, np.arange(len(values)), np.sort(values))


def median(values: np.ndarray) -> float:
    """The middle one of values (N,), the mean of the two in the middle, or NaN if one is NaN."""
    middle = (len(values) - 1) // 2, len(values) // 2
    parted = np.partition(values, (*middle, len(values) - 1))
    return float("nan") if np.isnan(parted[-1]) else float(0.5 * parted[list(middle)].sum())
