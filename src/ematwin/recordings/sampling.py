"""The time grid of a recording: its times tidied, and all columns at one constant rate.

Jittered times are interpolated by Akima's cubics (J. ACM 17, 1970), which do not overshoot at
steps of commands; on a sine of 100 samples a turn their error is 2e-5 (monotone cubics: 3e-4). A
lower rate is reached through a linear-phase low-pass, 80 dB down at the new Nyquist frequency.

A current of a brushless actuator is the mean over the interval that ends at its time. Such channels
are taken half the difference of the intervals earlier, so that they are such means afterwards.
"""

import math
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.numerics.signals import means as mean_of_each
from ematwin.recordings.recording import Recording, check_finite, check_increasing, is_regular

Arrays = dict[str, np.ndarray]
ABSURD = 1e12  # in any SI unit of a record: no recording holds that
_PASS = 0.8  # of the new Nyquist frequency: passed whole; above it the filter falls
_ATTENUATION = 80.0  # dB
_WHOLE = 1e-6  # a ratio of rates so close to an integer is one


def tidy_time(time: np.ndarray, what: object) -> tuple[np.ndarray, list[str]]:
    """Times (S,), s, that increase, and sentences on changes; ``what`` is for messages.

    Regular times that were written with few digits are put on the grid that they came from;
    calendar times are counted from the first. Raises `RecordError` if times are missing, fall or
    repeat.
    """
    if time.size < 2:
        raise RecordError(f"{what} holds {time.size} samples; a record needs at least two in time.")
    check_finite(time, f"{what}: ")
    if np.abs(time).max() > ABSURD:
        said = f"{what}: time runs from {time.min():.4g} to {time.max():.4g} s, which no clock does"
        raise RecordError(f"{said}. The file is damaged, or another channel was meant.")
    changed: list[str] = []
    if abs(time[0]) > 1e6:  # s: counted from somebody's calendar, not from the start
        changed.append(f"time is counted from its first sample, {time[0]:.6f} s")
        time = time - time[0]
    if is_regular(time):
        return time, changed
    grid = _grid_behind_rounding(time)
    if grid is not None:
        rate = (grid.size - 1) / (grid[-1] - grid[0])
        put = f"it was put on the even grid of {rate:.6g} Hz that it was rounded from"
        changed.append(f"time was written with too few digits; {put}")
        return grid, changed
    check_increasing(time, f"{what}: ")
    return time, changed


def gap_starts(time: np.ndarray) -> np.ndarray:
    """Indices of the samples after which samples are missing."""
    steps = np.diff(time)
    return np.flatnonzero(steps > 4.5 * np.median(steps))  # shorter ones are jitter


def _grid_behind_rounding(time: np.ndarray) -> np.ndarray | None:
    """The even grid that these times are roundings of; None if they are not.

    Rounding moves no two times further apart than one unit of their last digit. To know the rate,
    the record must span at least twenty such units, and a unit may hold at most fifty samples. One
    odd step in all is a row that was lost or repeated.
    """
    steps = np.diff(time)
    middle = float(np.median(steps))
    if np.count_nonzero(np.abs(steps - middle) > 0.25 * middle) == 1:
        return None

    centred = np.arange(time.size) - (time.size - 1) / 2.0
    step = 12.0 * float(centred @ time) / (time.size * (float(time.size) ** 2 - 1.0))
    grid = step * centred + time.mean()
    deviation = float(np.ptp(time - grid))
    unit = max(_decimal_unit(time), float(np.spacing(np.float32(np.abs(time).max()))))
    is_rounded = step > 0.0 and deviation <= 1.25 * unit  # of this grid, which is not the best
    shows_rate = unit <= 50.0 * step and 20.0 * unit <= time[-1] - time[0]
    return grid if is_rounded and shows_rate else None


def _decimal_unit(time: np.ndarray) -> float:
    """The largest power of ten that divides all times, s; 0 if there is none."""
    for digits in range(10):
        scaled = time * 10.0**digits
        slack = 1e-4 + 4.0 * float(np.spacing(np.abs(scaled).max()))
        if float(np.abs(scaled - np.round(scaled)).max()) <= slack:
            return 10.0**-digits
    return 0.0


def averaged(recording: Recording, rate: float, means: Collection[str]) -> Recording:
    """The recording at a rate of ``rate`` (Hz) or a little more; itself where it has no double.

    Channels in ``means`` hold means over the interval that ends at their time, and do so
    afterwards.
    """
    own = recording.sample_rate
    many = int(own / rate + _WHOLE)
    if many < 2:
        return recording
    said = f"samples were averaged from {own:.6g} to {own / many:.6g} Hz, as many as are compared"
    provenance = recording.provenance
    return recording.changed(
        time=recording.time[::many].copy(),
        provenance={**provenance, "changed": [*provenance.get("changed", []), said]},
        **{
            name: mean_of_each(values, many) if name in means else values[::many].copy()
            for name, values in recording.channels.items()
        },
    )


def to_constant_rate(
    time: np.ndarray, columns: Arrays, rate: float | None, what: object, means: Collection[str] = ()
) -> tuple[np.ndarray, Arrays, list[str]]:
    """Times and columns at a constant rate, Hz, and sentences on changes; None keeps the rate.

    ``time`` (S,), s, increases without gaps; finite ``columns`` (S,) are let go where the rate
    changes, to spare memory. ``means`` are of the interval that ends at the time of a sample.
    """
    changed: list[str] = []
    if not is_regular(time):
        grid, said = _even_grid(time)
        changed.append(said)
        time, columns = grid, _each(columns, partial(_akima, grid, time))
    own = (time.size - 1) / (time[-1] - time[0])
    if rate is None or abs(own / rate - 1.0) < _WHOLE:
        return time, columns, changed
    if rate > own:
        said = f"the rate was raised from {own:.6g} to {rate:.6g} Hz by interpolation"
        changed.append(f"{said}, which adds no information")
        grid = _grid(time, rate)
        return grid, _each(columns, partial(_akima, grid, time)), changed
    taps = _low_pass(own, rate)
    if taps.size > time.size:
        raise RecordError(
            f"{what} is too short to be brought to {rate:g} Hz: the low-pass needs {taps.size} "
            f"samples, the record has {time.size}. Keep its rate, or record for longer."
        )
    changed.append(
        f"the rate was lowered from {own:.6g} to {rate:.6g} Hz behind a low-pass without delay, "
        f"whole to {_PASS * rate / 2:.6g} Hz and down by {_ATTENUATION:g} dB at {rate / 2:.6g} Hz"
    )
    from scipy.interpolate import make_interp_spline

    grid = _grid(time, rate)
    moved = np.clip(grid - 0.5 * (1.0 / rate - 1.0 / own), time[0], time[-1])
    # after the low-pass values are smooth on the scale of their own samples
    quintic = partial(make_interp_spline, k=5)
    lowered: Arrays = {}
    for name in list(columns):
        smooth, at = _filtered(columns.pop(name), taps), moved if name in means else grid
        lowered[name] = _in_blocks(quintic, time, smooth, at)
    return grid, lowered, changed


def onto(
    time: np.ndarray, values: np.ndarray, wanted: np.ndarray, rate: float, is_mean: bool
) -> np.ndarray:
    """Values of one time base at the times of another; NaN where the first has none.

    A base that is much faster than ``rate`` (Hz, of ``wanted``) passes the low-pass first.
    """
    step = float(np.median(np.diff(time)))
    late = 0.0
    if 1.0 / step > 1.5 * rate and is_regular(time) and np.isfinite(values).all():
        values = _filtered(values, _low_pass(1.0 / step, rate))
        late = 0.5 * (1.0 / rate - step) if is_mean else 0.0
    finite = np.isfinite(values)
    if not finite.any():
        return np.full(wanted.shape, np.nan)
    moved = np.clip(wanted - late, time[0], time[-1])
    # between straight lines a NaN spreads to its neighbours and no further
    result = (_akima if finite.all() else np.interp)(moved, time, values)
    for n in gap_starts(time):
        result[(wanted > time[n]) & (wanted < time[n + 1])] = np.nan
    return np.asarray(result)


def _even_grid(time: np.ndarray) -> tuple[np.ndarray, str]:
    """Even times through uneven ones, and a sentence on them."""
    steps = np.diff(time)
    middle = float(np.median(steps))
    late = int((steps > 1.5 * middle).sum())
    # the median step is that of the clock where single samples are lost; else the mean is exact
    count = round((time[-1] - time[0]) / middle) if late else time.size - 1
    grid = np.linspace(time[0], time[-1], max(count, 1) + 1)
    spread = float(np.abs(steps - middle).max() / middle)
    lost = f"; single samples were missing {late} times" if late else ""
    said = f"uneven times (steps up to {100 * spread:.3g} % off the median{lost}) were brought to"
    return grid, f"{said} a constant {count / (time[-1] - time[0]):.6g} Hz by interpolation"


def _each(columns: Arrays, change: Callable[[np.ndarray], np.ndarray]) -> Arrays:
    """All columns changed; each is let go once it is."""
    return {name: change(columns.pop(name)) for name in list(columns)}


def _grid(time: np.ndarray, rate: float) -> np.ndarray:
    count = int(np.floor((time[-1] - time[0]) * rate * (1.0 + 1e-12) + 1e-9))
    if count < 1:
        raise InputError(
            f"The record lasts {time[-1] - time[0]:.4g} s, too short for two samples at {rate:g} "
            "Hz; choose a higher rate."
        )
    return np.asarray(time[0] + np.arange(count + 1) / rate)


def _low_pass(own: float, rate: float) -> np.ndarray:
    """Kaiser-windowed sinc, halfway down between `_PASS` and the whole new Nyquist frequency."""
    from scipy.signal import firwin, kaiserord

    count, beta = kaiserord(_ATTENUATION, (1.0 - _PASS) * rate / own)
    cutoff = 0.25 * (1.0 + _PASS) * rate
    return np.asarray(firwin(int(count) | 1, cutoff, window=("kaiser", beta), fs=own))


def _filtered(values: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Values behind a filter centred on each sample; the ends continue as point reflections."""
    from scipy.signal import oaconvolve

    padded = np.pad(values, taps.size // 2, mode="reflect", reflect_type="odd")
    return np.asarray(oaconvolve(padded, taps, mode="valid"))


def _akima(wanted: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Akima's cubics through the samples, at increasing times ``wanted`` within theirs."""
    if time.size < 3:
        return np.interp(wanted, time, values)
    from scipy.interpolate import Akima1DInterpolator

    return _in_blocks(partial(Akima1DInterpolator, extrapolate=True), time, values, wanted)


def _in_blocks(
    make: Callable[..., Any], time: np.ndarray, values: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """An interpolation made in pieces with overlap: its coefficients are many times the samples."""
    result = np.empty(wanted.shape)
    block = 1 << 16  # samples
    for first in range(0, time.size, block):
        stop = min(first + block, time.size)
        left = np.searchsorted(wanted, time[first]) if first else 0
        right = np.searchsorted(wanted, time[stop]) if stop < time.size else wanted.size
        if right > left:
            near = slice(max(first - 128, 0), min(stop + 128, time.size))  # samples on either side
            result[left:right] = make(time[near], values[near])(wanted[left:right])
    return result


def sampled(time: np.ndarray, values: np.ndarray, period: float) -> tuple[np.ndarray, float] | None:
    """Values (S,) at the times (S,) of the reads, s, and the period of the device's clock, s.

    Registers that a device refreshes by one clock a host reads by another: a serial-bus servo
    samples its encoder every 8 ms (``period``, as stated, s), and a read gives the latest sample.
    At 5 rad/s that is up to 40 mrad late, and no two reads are late alike. A motion is smooth, so
    period and phase of the clock are those with which the values, each at the time of its sample,
    lie best between their neighbours. None where they are as smooth without.
    """
    since = time - time[0]
    own, apart = period, 0.01 * period  # by which the clock of a device may be off
    reads = min(500, time.size)
    while True:
        span = since[reads - 1]
        steps = max(1, math.ceil(2.0 * apart * span / period**2))
        if steps > reads:  # so rare ones tell no clocks apart
            return None
        periods = own + np.linspace(-apart, apart, 2 * steps + 1)
        rough, own, ticks = _smoothest(since[:reads], values[:reads], periods)
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
