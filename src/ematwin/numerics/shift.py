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
        on_before = 0.5 * t * (t * (2.0 - t) - 1.0)
        on_here = 1.0 + 0.5 * t * t * (3.0 * t - 5.0)
        on_after = 0.5 * t * (1.0 + t * (4.0 - 3.0 * t))
        on_beyond = 0.5 * t * t * (t - 1.0)
        # within the row without looking for its ends, in vectors
        first = min(max(1 - whole, 0), last + 1)
        stop = max(min(last - 1 - whole, last + 1), first)
        here = row[first + whole : stop + whole]
        before, after = row[first + whole - 1 :], row[first + whole + 1 :]
        beyond, found = row[first + whole + 2 :], rows[b, first:stop]
        for n in range(len(here)):
            found[n] = (on_before * before[n] + on_here * here[n]) + (
                on_after * after[n] + on_beyond * beyond[n]
            )
        for start, end in ((0, first), (stop, last + 1)):
            for n in range(start, end):
                place = n + whole
                rows[b, n] = (
                    on_before * row[min(max(place - 1, 0), last)]
                    + on_here * row[min(max(place, 0), last)]
                    + on_after * row[min(max(place + 1, 0), last)]
                    + on_beyond * row[min(max(place + 2, 0), last)]
                )
