"""Saturated samples: a current that sits at the end of its converter's range.

Without a declared full scale, a current is taken for saturated at its own extreme value if it
stays there for runs of samples, and so often that a smooth peak in steps of the converter cannot
explain it: such a peak visits the last step about as often as the one below.
"""

from collections.abc import Sequence

import numpy as np

from ematwin.recordings.gaps import runs

_SHORTEST_RUN = 3  # samples
_FEWEST = 8  # samples in such runs, altogether
_OVER_NEXT = 5.0  # times as often as the value next to the extreme
_AT_REST = 0.05  # of the largest magnitude: an extreme so close to zero is no limit
_FULL = 0.999  # of a declared full scale


def saturated(
    values: np.ndarray, full_scale: tuple[float, float] | None = None
) -> tuple[np.ndarray, list[float]]:
    """Flags (S,) of saturated samples, and the values at which the channel stopped.

    Parameters
    ----------
    values : (S,) array; NaN is never saturated
    full_scale : lowest and highest value that the converter gives, or None: look for them
    """
    flags = np.zeros(values.shape, dtype=bool)
    limits: list[float] = []
    if full_scale is not None:
        margin = 0.5 * (1.0 - _FULL) * (full_scale[1] - full_scale[0])
        low, high = values <= full_scale[0] + margin, values >= full_scale[1] - margin
        for found, limit in ((low, full_scale[0]), (high, full_scale[1])):
            if found.any():
                flags |= found
                limits.append(float(limit))
        return flags, limits
    if not np.isfinite(values).any():
        return flags, limits
    largest = float(np.nanmax(np.abs(values)))
    for sign in (1.0, -1.0):
        signed = values if sign > 0.0 else -values
        extreme = float(np.nanmax(signed))
        if extreme < _AT_REST * largest or extreme == 0.0:
            continue
        at_limit = signed == extreme
        if at_limit.sum() < _FEWEST:
            continue
        held = np.zeros(values.shape, dtype=bool)
        for start, stop in runs(at_limit):
            if stop - start >= _SHORTEST_RUN:
                held[start:stop] = True
        below = signed[signed < extreme]
        if below.size == 0:  # constant: another check speaks of that
            continue
        next_count = int((below == below.max()).sum())
        if held.sum() >= max(_FEWEST, _OVER_NEXT * next_count):
            flags |= held
            limits.append(sign * extreme)
    return flags, limits


def saturation_warnings(
    columns: dict[str, np.ndarray],
    times: dict[str, np.ndarray],
    full_scales: dict[str, tuple[float, float]],
    currents: Sequence[str],
) -> tuple[dict[str, int], list[str]]:
    """Number of saturated samples by current, and a sentence for each that has some.

    Parameters
    ----------
    columns, times : dict of (S,) arrays, A and s, by channel
    full_scales : dict of lowest and highest value, A, where declared
    currents : names of the channels that are currents
    """
    counts: dict[str, int] = {}
    sentences: list[str] = []
    for name in (name for name in currents if name in columns):
        flags, limits = saturated(columns[name], full_scales.get(name))
        found = runs(flags)
        if not found:
            continue
        counts[name] = int(flags.sum())
        stopped = " and ".join(f"{limit:.4g}" for limit in limits)
        sentences.append(
            f"{name} sits at {stopped} A for {counts[name]} samples in {len(found)} runs, the "
            f"first at {times[name][found[0][0]]:.6g} s: the sensor or its converter is "
            "saturated, and faults found from it are doubtful."
        )
    return counts, sentences
