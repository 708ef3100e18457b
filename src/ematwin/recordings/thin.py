"""Fewer points of a long trace that look the same: the least and the largest of each stretch."""

import numpy as np


def extremes(values: np.ndarray, points: int) -> np.ndarray:
    """Indices (P,), increasing, P <= ``points``, of a trace (S,) whose line looks like the whole.

    Each of ``points / 2`` stretches gives its least and its largest value, so that no spike is
    lost, as it would be if every n-th sample were taken; the first and the last sample stay.
    NaN counts as missing: a stretch of nothing else gives none.

    References
    ----------
    Jugel, Jerzak, Hackenbroich and Markl (2014), Proc. VLDB Endow. 7(10), 797-808: what min and max
    of a column of pixels keep.
    """
    count = values.size
    if count <= points:
        return np.arange(count)
    width = -(-count // max(points // 2 - 1, 1))
    stretches = -(-count // width)
    padded = np.full(stretches * width, np.nan)
    padded[:count] = values
    whole = padded.reshape(stretches, width)
    start = np.arange(stretches) * width
    known = np.isfinite(whole)
    least = start + np.where(known, whole, np.inf).argmin(1)
    largest = start + np.where(known, whole, -np.inf).argmax(1)
    some = known.any(1)
    return np.unique(np.concatenate([[0], least[some], largest[some], [count - 1]]))
