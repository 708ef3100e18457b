"""Registers that a device refreshes by one clock, and a host reads by another.

A serial-bus servo samples its encoder every 8 ms. A read gives the latest sample, whose age is
anything up to 8 ms: at 5 rad/s that is up to 40 mrad, and no two reads are late alike. A motion is
smooth, so period and phase of the device's clock are those with which the values, each at the time
of its sample, lie best between their neighbours.
"""

import math

import numpy as np


def sampled(time: np.ndarray, values: np.ndarray, period: float) -> tuple[np.ndarray, float] | None:
    """Values (S,) at the times (S,) of the reads, s, and the period of the clock, s.

    ``period`` is as stated, s. None where the values show no such clock: they are as smooth
    without.
    """
    since = time - time[0]
    own, apart = period, 0.01 * period  # by which the clock of a device may be off
    reads = min(500, time.size)
    while True:
        span = since[reads - 1]
        steps = max(1, math.ceil(2.0 * apart * span / period**2))
        if steps > reads:  # so rare ones tell no clocks apart
            return None
        rough, own, ticks = _smoothest(
            since[:reads], values[:reads], own + np.linspace(-apart, apart, 2 * steps + 1)
        )
        if reads == time.size:
            break
        apart /= steps  # to the periods beside it
        reads = min(4 * reads, time.size)
    if rough >= 0.8 * float(_roughness(time, values)):  # by chance it falls by a few per cent
        return None
    ticks, first = np.unique(ticks, return_index=True)
    return np.interp(since, ticks, values[first]), own


def _smoothest(
    time: np.ndarray, values: np.ndarray, periods: np.ndarray
) -> tuple[float, float, np.ndarray]:
    """The least roughness over clocks, with its period and the times (S,) of its samples."""
    phases = np.linspace(0.0, 1.0, 16, endpoint=False)[:, None]  # of a period that are tried
    best = (math.inf, 0.0, time)
    for own in periods.tolist():
        ticks = own * (phases + np.floor(time / own - phases))
        rough = _roughness(ticks, values)
        n = int(np.argmin(rough))
        best = min(best, (float(rough[n]), own, ticks[n]), key=lambda one: one[0])
    return best


def _roughness(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean distance (...) of values (S,) at times (..., S) from a line through their neighbours."""
    before, here, after = time[..., :-2], time[..., 1:-1], time[..., 2:]
    share = (here - before) / np.maximum(after - before, 1e-9)
    away = np.abs(np.diff(values)[:-1] - share * (values[2:] - values[:-2]))
    ordinary = np.percentile(away, 99.0, axis=-1, keepdims=True)  # false reads are beyond
    return np.minimum(away, ordinary).mean(axis=-1)
