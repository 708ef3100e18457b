"""Missing samples: gaps in time and stretches without values. Refused, cut off or masked."""

from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.recordings.timing import gap_starts

Policy = Literal["refuse", "longest", "mask"]
POLICIES = ("refuse", "longest", "mask")
LONGEST_BRIDGE = 0.005  # s: over so short a time an input is taken for a straight line
MOST_MASKED = 0.5  # of the record


@dataclass
class Sound:
    """Samples without holes.

    Attributes
    ----------
    time : (S,) array, s
    columns : dict of (S,) arrays
    masked : list of (start, stop), s: stretches that were filled by straight lines
    changed, warnings : sentences for the provenance
    """

    time: np.ndarray
    columns: dict[str, np.ndarray]
    masked: list[tuple[float, float]] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def check_policy(policy: str) -> None:
    """Raise `InputError` unless ``policy`` is one of `POLICIES`."""
    if policy not in POLICIES:
        raise InputError(f"gaps must be {', '.join(POLICIES)}; received {policy!r}.")


def sound_samples(
    time: np.ndarray,
    columns: dict[str, np.ndarray],
    policy: Policy,
    what: object,
    inputs: Collection[str] = (),
) -> Sound:
    """Deal with gaps and NaN stretches as ``policy`` says.

    Parameters
    ----------
    policy : "refuse"; "longest" keeps the longest stretch without a hole; "mask" fills holes with
        straight lines and lists them, so that the comparison can leave them out
    what : file, or motion in it, for messages
    inputs : columns that drive the model: what they did meanwhile cannot be left open

    Raises
    ------
    RecordError
        If there are holes and they are refused, or nothing sound is left.
    """
    for name, values in columns.items():
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
    holes = {name: runs(~np.isfinite(values)) for name, values in columns.items()}
    holes = {name: found for name, found in holes.items() if found}
    if not starts.size and not holes:
        return Sound(time, columns)
    if policy == "refuse":
        raise RecordError(_refusal(time, starts, holes, what))
    if policy == "longest":
        return _longest(time, columns, starts, what)
    return _masked(time, columns, starts, holes, what, inputs)


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of true values as (first, one past the last)."""
    if not flags.any():
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _refusal(
    time: np.ndarray, starts: np.ndarray, holes: dict[str, list[tuple[int, int]]], what: object
) -> str:
    advice = (
        'Take the longest sound stretch with gaps="longest", or fill and mask with gaps="mask".'
    )
    if starts.size:
        n = int(starts[np.argmax(np.diff(time)[starts])])
        many = f"{starts.size} gaps, the longest" if starts.size > 1 else "a gap"
        return (
            f"{what} has {many} of {time[n + 1] - time[n]:.4g} s from {time[n]:.6g} to "
            f"{time[n + 1]:.6g} s (after sample {n}). {advice}"
        )
    name, found = max(holes.items(), key=lambda item: max(b - a for a, b in item[1]))
    first, stop = max(found, key=lambda run: run[1] - run[0])
    others = [other for other in holes if other != name]
    many = f"{len(found)} stretches, the longest" if len(found) > 1 else "a stretch"
    also = f"; so have {', '.join(others)}" if others else ""
    return (
        f"{what}: column {name} has no values in {many} of {stop - first} samples from "
        f"{time[first]:.6g} to {time[stop - 1]:.6g} s (sample {first} on){also}. {advice}"
    )


def _longest(
    time: np.ndarray, columns: dict[str, np.ndarray], starts: np.ndarray, what: object
) -> Sound:
    good = np.ones(time.size, dtype=bool)
    for values in columns.values():
        good &= np.isfinite(values)
    cuts = [0, *(int(n) + 1 for n in starts), time.size]
    stretches = [
        (left + a, left + b) for left, right in pairwise(cuts) for a, b in runs(good[left:right])
    ]
    first, stop = max(stretches, key=lambda run: time[run[1] - 1] - time[run[0]], default=(0, 0))
    if stop - first < 2:
        raise RecordError(
            f"{what} has no two consecutive samples at which all columns have values. "
            "Leave the column with the holes out of the map."
        )
    said = (
        f"only the longest stretch without holes was taken, {time[first]:.6g} to "
        f"{time[stop - 1]:.6g} s of {time[0]:.6g} to {time[-1]:.6g} s"
    )
    kept = {name: values[first:stop].copy() for name, values in columns.items()}
    return Sound(time[first:stop].copy(), kept, changed=[said], warnings=[_sentence(said)])


def _masked(
    time: np.ndarray,
    columns: dict[str, np.ndarray],
    starts: np.ndarray,
    holes: dict[str, list[tuple[int, int]]],
    what: object,
    inputs: Collection[str],
) -> Sound:
    bridged = [("time and all columns", int(n), int(n) + 1) for n in starts]
    bridged += [
        (name, max(a - 1, 0), min(b, time.size - 1))
        for name in inputs
        for a, b in holes.get(name, [])
    ]
    for name, a, b in bridged:
        if time[b] - time[a] > LONGEST_BRIDGE:
            raise RecordError(
                f"{what}: {name} cannot be masked from {time[a]:.6g} to {time[b]:.6g} s: what the "
                f"command did meanwhile is unknown, and {LONGEST_BRIDGE * 1e3:g} ms is the longest "
                'that is bridged. Take the longest sound stretch with gaps="longest".'
            )
    for name, found in holes.items():
        missing = ~np.isfinite(columns[name])
        known = ~missing
        columns[name][missing] = np.interp(time[missing], time[known], columns[name][known])
        bridged += [(name, max(a - 1, 0), min(b, time.size - 1)) for a, b in found]
    masked = _united([(float(time[a]), float(time[b])) for _, a, b in bridged])
    total = sum(stop - start for start, stop in masked)
    if total > MOST_MASKED * (time[-1] - time[0]):
        raise RecordError(
            f"{what}: {total:.4g} s of {time[-1] - time[0]:.4g} s would be masked, more than half. "
            "Record again, or leave the column with the holes out of the map."
        )
    said = (
        f"{len(masked)} stretches without values, {total:.4g} s in all, were filled with straight "
        "lines and masked"
    )
    return Sound(time, columns, masked, [said], [_sentence(said)])


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _united(stretches: list[tuple[float, float]]) -> list[tuple[float, float]]:
    united: list[tuple[float, float]] = []
    for start, stop in sorted(stretches):
        if united and start <= united[-1][1]:
            united[-1] = (united[-1][0], max(stop, united[-1][1]))
        else:
            united.append((start, stop))
    return united
