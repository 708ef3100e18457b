"""Samples that are missing or saturated: refused, cut off, filled and listed, or counted.

Without a declared full scale, a current is taken for saturated at its extreme value if it
stays there for runs of samples, and so often that a smooth peak in steps of the converter cannot
explain it: such a peak visits the last step about as often as the one below.
"""

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.collect import Collected
from ematwin.recordings.sampling import gap_starts
from ematwin.showing.text import capital

Policy = Literal["refuse", "longest", "mask"]
_Holes = Mapping[str, list[tuple[int, int]]]  # by column, as of `runs`
_LONGEST_BRIDGE = 0.005  # s: over so short a time an input is taken for a straight line


def make_sound(found: Collected, policy: Policy, inputs: Collection[str]) -> None:
    """Deal with gaps in time and stretches of NaN of columns on one time base.

    ``policy`` "refuse" raises `RecordError`; "longest" keeps the longest stretch without a hole;
    "mask" fills holes with straight lines and lists them, so that the comparison can leave them
    out. ``inputs`` drive the model, and must be known throughout.
    """
    time, what = found.time, found.name
    for name, values in found.columns.items():
        if not np.isfinite(values).any():
            raise RecordError(
                f"{what}: column {name} holds no value at all. Leave it out of the map, or map "
                "the channel that was recorded."
            )
    starts = gap_starts(time)
    if starts.size > max(3, time.size // 100):
        steps = np.diff(time)
        raise RecordError(
            f"{what}: time has no constant rate: its steps run from {steps.min():.4g} to "
            f"{steps.max():.4g} s, and {starts.size} are far longer than the median of "
            f"{np.median(steps):.4g} s. Record or export it with a fixed step."
        )
    columns = found.columns.items()
    holes = {name: some for name, values in columns if (some := runs(~np.isfinite(values)))}
    if not starts.size and not holes:
        return
    if policy == "refuse":
        raise RecordError(_refusal(found, starts, holes))
    said = _longest(found, starts) if policy == "longest" else _mask(found, starts, holes, inputs)
    found.changed.append(said)
    found.warnings.append(sentence(said))


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of true values as (first, one past the last)."""
    edges = np.flatnonzero(np.diff(np.r_[False, flags, False]))
    return [(a, b) for a, b in edges.reshape(-1, 2).tolist()]


def _refusal(found: Collected, starts: np.ndarray, holes: _Holes) -> str:
    time = found.time
    if starts.size:
        n = int(starts[np.argmax(np.diff(time)[starts])])
        many = f"{starts.size} gaps, the longest" if starts.size > 1 else "a gap"
        where = f"from {time[n]:.6g} to {time[n + 1]:.6g} s (after sample {n})"
        said = f"{found.name} has {many} of {time[n + 1] - time[n]:.4g} s {where}"
    else:
        name, some = max(holes.items(), key=lambda item: max(b - a for a, b in item[1]))
        first, stop = max(some, key=lambda run: run[1] - run[0])
        many = f"{len(some)} stretches, the longest" if len(some) > 1 else "a stretch"
        many += f" of {stop - first} samples from {time[first]:.6g} to {time[stop - 1]:.6g} s"
        if stop - first == 1:
            many = f"{len(some)} samples, the first" if len(some) > 1 else "one sample"
            many += f" at {time[first]:.6g} s"
        said = f"{found.name}: column {name} has no values in {many} (sample {first} on)"
        if others := [other for other in holes if other != name]:
            said += f"; so have {', '.join(others)}"
    advice = 'Take the longest sound stretch with gaps="longest", or fill and mask with gaps="mask"'
    return f"{said}. {advice}."


def _longest(found: Collected, starts: np.ndarray) -> str:
    time = found.time
    good = np.all([np.isfinite(values) for values in found.columns.values()], axis=0)
    edges = pairwise([0, *(int(n) + 1 for n in starts), time.size])
    stretches = [(left + a, left + b) for left, end in edges for a, b in runs(good[left:end])]
    first, stop = max(stretches, key=lambda run: time[run[1] - 1] - time[run[0]], default=(0, 0))
    if stop - first < 2:
        said = f"{found.name} has no two consecutive samples at which all columns have values"
        raise RecordError(f"{said}. Leave the column with the holes out of the map.")
    found.columns = {name: values[first:stop].copy() for name, values in found.columns.items()}
    found.time = time[first:stop].copy()
    taken = f"{time[first]:.6g} to {time[stop - 1]:.6g} s of {time[0]:.6g} to {time[-1]:.6g} s"
    return f"only the longest stretch without holes was taken, {taken}"


def _mask(found: Collected, starts: np.ndarray, holes: _Holes, inputs: Collection[str]) -> str:
    time, columns, what = found.time, found.columns, found.name
    filled = [("time and all columns", int(n), int(n) + 1) for n in starts]
    for name, some in holes.items():
        filled += [(name, max(a - 1, 0), min(b, time.size - 1)) for a, b in some]
        known = np.isfinite(columns[name])
        columns[name][~known] = np.interp(time[~known], time[known], columns[name][known])
    for name, a, b in filled:
        if name not in columns.keys() - {*inputs} and time[b] - time[a] > _LONGEST_BRIDGE:
            raise RecordError(
                f"{what}: {name} cannot be masked from {time[a]:.6g} to {time[b]:.6g} s: what the "
                f"command did meanwhile is unknown, and {_LONGEST_BRIDGE * 1e3:g} ms is the "
                'longest that is bridged. Take the longest sound stretch with gaps="longest".'
            )
    between = np.zeros(time.size - 1, dtype=bool)  # from a sample to the next
    for _, a, b in filled:
        between[a:b] = True
    masked = [[float(time[a]), float(time[b])] for a, b in runs(between)]
    total = sum(stop - start for start, stop in masked)
    if total > 0.5 * (time[-1] - time[0]):
        raise RecordError(
            f"{what}: {total:.4g} s of {time[-1] - time[0]:.4g} s would be masked, more than half. "
            "Record again, or leave the column with the holes out of the map."
        )
    found.masked = masked
    said = f"{len(masked)} stretches without values, {total:.4g} s in all"
    return f"{said}, were filled with straight lines and masked"


def sentence(text: str) -> str:
    """A part of a sentence as a whole one."""
    return f"{capital(text)}."


def saturated(
    values: np.ndarray, full_scale: tuple[float, float] | None = None
) -> tuple[np.ndarray, list[float]]:
    """Flags (S,) of saturated samples, and the values at which the channel (S,) stopped.

    ``full_scale`` is the lowest and highest value of the converter; None looks for them.
    """
    if full_scale is not None:
        margin = 0.0005 * (full_scale[1] - full_scale[0])
        low, high = values <= full_scale[0] + margin, values >= full_scale[1] - margin
        limits = [float(x) for one, x in zip((low, high), full_scale, strict=True) if one.any()]
        return low | high, limits
    flags, limits = np.zeros(values.shape, dtype=bool), []
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    for sign in (1.0, -1.0):
        signed = values if sign > 0.0 else -values
        extreme = float(np.nanmax(signed, initial=-np.inf))
        below = signed[signed < extreme]
        if extreme < 0.05 * largest or extreme == 0.0 or below.size == 0:
            continue  # no limit so close to zero; nor is a constant, which another check refuses
        held = np.zeros(values.shape, dtype=bool)
        for start, stop in runs(signed == extreme):
            if stop - start >= 3:  # samples at a limit
                held[start:stop] = True
        next_count = int((below == below.max()).sum())
        if held.sum() >= max(8, 5 * next_count):
            flags |= held
            limits.append(sign * extreme)
    return flags, limits


def warn_of_saturation(found: Collected, currents: Sequence[str]) -> dict[str, int]:
    """Number of saturated samples by current; a warning for each that has some."""
    counts: dict[str, int] = {}
    for name in (name for name in currents if name in found.columns):
        flags, limits = saturated(found.columns[name], found.full_scales.get(name))
        some = runs(flags)
        if not some:
            continue
        counts[name] = int(flags.sum())
        stopped = " and ".join(f"{limit:.4g}" for limit in limits)
        found.warnings.append(
            f"{name} sits at {stopped} A for {counts[name]} samples in {len(some)} runs, the "
            f"first at {found.times[found.bases[name]][some[0][0]]:.6g} s: the sensor or its "
            "converter is saturated, and faults found from it are doubtful."
        )
    return counts
