"""Rows as they are some samples later, by cubic convolution. Keys (1981), IEEE Trans. ASSP 29."""

import math

import numpy as np

from ematwin.numerics.compile import loop


def advanced(rows: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The rows (B, K), changed in place: as they are ``shift`` (B,) samples later.

    NaN where that is no finite number. The ends repeat the first and the last sample.
    """
    known, most = np.isfinite(shift), rows.shape[1]
    shift_rows(rows, np.clip(np.where(known, shift, 0.0), -most, most), np.empty(most))
    rows[~known] = np.nan
    return rows


@loop
def shift_rows(rows, shift, row):
    """Change ``rows`` (B, K), each to ``shift`` (B,) samples later; ``row`` (K,) is overwritten."""
    last = rows.shape[1] - 1
    for b in range(rows.shape[0]):
        for n in range(last + 1):
            row[n] = rows[b, n]
        whole = math.floor(shift[b])
        t = shift[b] - whole
        for n in range(last + 1):
            place = n + whole
            before = row[min(max(place - 1, 0), last)]
            here = row[min(max(place, 0), last)]
            after = row[min(max(place + 1, 0), last)]
            beyond = row[min(max(place + 2, 0), last)]
            curve = 2.0 * before - 5.0 * here + 4.0 * after - beyond
            curve += t * (3.0 * (here - after) + beyond - before)
            rows[b, n] = here + 0.5 * t * (after - before + t * curve)
