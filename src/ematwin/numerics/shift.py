"""Rows as they are some samples later, by cubic convolution. Keys (1981), IEEE Trans. ASSP 29."""

import math

import numpy as np

from ematwin.numerics.compile import loop


def advanced(rows: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Rows (B, K) as they are ``shift`` (B,) samples later; NaN where that is no finite number.

    The ends repeat the first and the last sample.
    """
    known = np.isfinite(shift)
    found = np.empty_like(rows)
    shift_rows(rows, np.clip(np.where(known, shift, 0.0), -rows.shape[1], rows.shape[1]), found)
    found[~known] = np.nan
    return found


@loop
def shift_rows(rows, shift, found):
    """Fill ``found`` (B, K) with ``rows`` (B, K), each ``shift`` (B,) samples later."""
    last = rows.shape[1] - 1
    for b in range(rows.shape[0]):
        whole = math.floor(shift[b])
        t = shift[b] - whole
        for n in range(last + 1):
            place = n + whole
            before = rows[b, min(max(place - 1, 0), last)]
            here = rows[b, min(max(place, 0), last)]
            after = rows[b, min(max(place + 1, 0), last)]
            beyond = rows[b, min(max(place + 2, 0), last)]
            curve = 2.0 * before - 5.0 * here + 4.0 * after - beyond
            curve += t * (3.0 * (here - after) + beyond - before)
            found[b, n] = here + 0.5 * t * (after - before + t * curve)
