"""Signals through a second-order filter, and some samples earlier or later.

Shifts are by cubic convolution: Keys (1981), IEEE Trans. ASSP 29.
"""

import math

import numpy as np

from ematwin.numerics.compile import loop, plain, step
from ematwin.numerics.scalar import biquad


def advanced(rows: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The rows (B, K), changed in place: as they are ``shift`` (B,) samples later.

    NaN where that is no finite number. The ends repeat the first and the last sample.
    """
    last = rows.shape[1] - 1
    for row, later in zip(rows, shift, strict=True):
        if not math.isfinite(later):
            row[:] = np.nan
            continue
        later = min(max(later, -last - 1.0), last + 1.0)
        whole = math.floor(later)
        at = np.arange(whole, whole + last + 1)
        before, here, after, beyond = (row[np.clip(at + n, 0, last)] for n in (-1, 0, 1, 2))
        on_before, on_here, on_after, on_beyond = plain(cubic)(later - whole)
        row[:] = (on_before * before + on_here * here) + (on_after * after + on_beyond * beyond)
    return rows


@step
def cubic(t):
    """Weights of the samples before, at, after and beyond a place ``t`` behind the second one."""
    return (
        0.5 * t * (t * (2.0 - t) - 1.0),
        1.0 + 0.5 * t * t * (3.0 * t - 5.0),
        0.5 * t * (1.0 + t * (4.0 - 3.0 * t)),
        0.5 * t * t * (t - 1.0),
    )


def compare(
    rows: np.ndarray, target: np.ndarray, roots: np.ndarray, starts: np.ndarray, stride: int,
    shift: np.ndarray,
) -> None:  # fmt: skip
    """Change rows (B, N, K) to weighted residuals, as if each came ``shift`` (B,) samples later.

    A row has every so many samples from each start (N,) on. It is compared with the target (S,) as
    it is ``shift`` samples before, times the roots (S,) of the weights there, which are linear
    between samples. A target has all of its samples, where a row may have few; beyond its ends
    nothing counts, for nothing was recorded there. NaN where a shift is no finite number.
    """
    known, most = np.isfinite(shift), target.size
    earlier = np.clip(np.where(known, -shift, 0.0), -most, most)
    ahead = 2 + math.ceil(float(np.max(np.abs(earlier), initial=0.0)))
    compare_rows(
        rows, _columns(target, ahead, stride, target[0], target[-1]),
        _columns(roots, ahead, stride, 0.0, 0.0), ahead + starts, earlier,
    )  # fmt: skip
    rows[~known] = np.nan


def _columns(signal: np.ndarray, more: int, count: int, before: float, behind: float) -> np.ndarray:
    """(count, M): every so many samples of a signal (S,) from each of the first ones on.

    ``more`` samples are put ``before`` and ``behind`` it.
    """
    last = more + -(signal.size + 2 * more) % count
    longer = np.pad(signal, (more, last), constant_values=(before, behind))
    return np.ascontiguousarray(longer.reshape(-1, count).T)


@loop
def compare_rows(rows, target, roots, starts, shift):
    """Change ``rows`` as `compare` does, by columns; the target is taken ``shift`` (B,) later."""
    stride, count = target.shape[0], rows.shape[2]
    for b in range(rows.shape[0]):
        whole = math.floor(shift[b])
        t = shift[b] - whole
        on_before, on_here, on_after, on_beyond = cubic(t)
        for n in range(rows.shape[1]):
            at, row = starts[n] + whole, rows[b, n]
            before = target[(at - 1) % stride, (at - 1) // stride :]
            here = target[at % stride, at // stride :]
            after = target[(at + 1) % stride, (at + 1) // stride :]
            beyond = target[(at + 2) % stride, (at + 2) // stride :]
            root = roots[at % stride, at // stride :]
            next_root = roots[(at + 1) % stride, (at + 1) // stride :]
            for k in range(count):
                expected = (on_before * before[k] + on_here * here[k]) + (
                    on_after * after[k] + on_beyond * beyond[k]
                )
                row[k] = (row[k] - expected) * ((1.0 - t) * root[k] + t * next_root[k])


@loop
def second_order(taps, state, signal):
    """Filter a signal (S,) in place: ``b0 b1 b2 a1 a2`` of ``taps``, direct form II transposed.

    ``state`` (2,) holds the state before, and afterwards that after it.
    """
    low_pass = taps[0], taps[1], taps[2], taps[3], taps[4]
    z1, z2 = state[0], state[1]
    for n in range(signal.size):
        signal[n], z1, z2 = biquad(signal[n], z1, z2, low_pass)
    state[0], state[1] = z1, z2
