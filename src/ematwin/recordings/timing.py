"""Times of a recording: checked, and freed of the rounding with which they were written."""

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.recording import REGULARITY

ABSURD = 1e12  # in any SI unit of a record: no recording holds that
GAP = 4.5  # steps longer than this many ordinary ones are a gap, not jitter
_EPOCH = 1e6  # s: later times are counted from somebody's calendar, not from the start
_FINEST_DECIMAL = 10


def tidy_time(time: np.ndarray, what: object) -> tuple[np.ndarray, list[str]]:
    """Times that increase, and sentences on what was changed.

    Times that are regular but for the digits with which they were written are put on the grid
    that they came from; calendar times are counted from the first.

    Parameters
    ----------
    time : (S,) array, s
    what : file, or motion in it, for messages

    Raises
    ------
    RecordError
        If times are missing, fall or repeat.
    """
    if time.size < 2:
        raise RecordError(f"{what} holds {time.size} samples; a record needs at least two in time.")
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        raise RecordError(
            f"{what}: time is NaN or infinite in {bad.size} samples, the first is sample {bad[0]}. "
            "Remove those rows, or give sample_rate in place of the time channel."
        )
    if np.abs(time).max() > ABSURD:
        raise RecordError(
            f"{what}: time runs from {time.min():.4g} to {time.max():.4g} s, which no clock does. "
            "The file is damaged, or another channel was meant."
        )
    changed: list[str] = []
    if abs(time[0]) > _EPOCH:
        changed.append(f"time is counted from its first sample, {time[0]:.6f} s")
        time = time - time[0]
    steps = np.diff(time)
    if is_regular(time, steps):
        return time, changed
    grid = _grid_behind_rounding(time)
    if grid is not None:
        rate = (grid.size - 1) / (grid[-1] - grid[0])
        changed.append(
            f"time was written with too few digits; it was put on the even grid of {rate:.6g} Hz "
            "that it was rounded from"
        )
        return grid, changed
    falls = np.flatnonzero(steps <= 0.0)
    if falls.size:
        n = int(falls[0]) + 1
        how = "repeats" if steps[n - 1] == 0.0 else "falls"
        raise RecordError(
            f"{what}: time must increase, but {how} at {falls.size} places: sample {n} "
            f"({time[n]:.6g} s) follows {time[n - 1]:.6g} s. Sort the record, drop duplicates, or "
            "give sample_rate in place of the time channel."
        )
    return time, changed


def is_regular(time: np.ndarray, steps: np.ndarray | None = None) -> bool:
    """Whether times (s) are as even as a `Recording` wants them."""
    steps = np.diff(time) if steps is None else steps
    mean = (time[-1] - time[0]) / (time.size - 1)
    slack = REGULARITY * mean + 4.0 * float(np.spacing(np.abs(time).max()))
    return bool(mean > 0.0 and steps.min() >= mean - slack and steps.max() <= mean + slack)


def gap_starts(time: np.ndarray) -> np.ndarray:
    """Indices of the samples after which samples are missing."""
    steps = np.diff(time)
    return np.flatnonzero(steps > GAP * np.median(steps))


def _grid_behind_rounding(time: np.ndarray) -> np.ndarray | None:
    """The even grid of which these times are roundings; None if they are not.

    Rounding moves no time further than one unit of its last digit. To know the rate, the record
    must span at least twenty such units, and a unit may hold at most fifty samples.
    """
    centred = np.arange(time.size) - (time.size - 1) / 2.0
    step = 12.0 * float(centred @ time) / (time.size * (float(time.size) ** 2 - 1.0))
    grid = step * centred
    grid += time.mean()
    deviation = float(np.abs(time - grid).max())
    unit = max(_decimal_unit(time), float(np.spacing(np.float32(np.abs(time).max()))))
    if not step > 0.0 or deviation > 1.01 * unit:
        return None
    if unit > 50.0 * step or 20.0 * unit > time[-1] - time[0]:
        return None
    return grid


def _decimal_unit(time: np.ndarray) -> float:
    """The largest power of ten of which all times are multiples, s; 0 if there is none."""
    for digits in range(_FINEST_DECIMAL):
        scaled = time * 10.0**digits
        slack = 1e-4 + 4.0 * float(np.spacing(np.abs(scaled).max()))
        if float(np.abs(scaled - np.round(scaled)).max()) <= slack:
            return 10.0**-digits
    return 0.0
