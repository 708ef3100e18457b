"""From collected columns to a recording: the steps in their order.

Times are tidied (`timing`), saturated samples counted (`saturation`), all columns brought to one
time base, holes dealt with (`gaps`), and the whole brought to a constant rate (`resample`). Each
step adds what it did to the provenance.
"""

from collections.abc import Collection, Mapping
from datetime import timedelta
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.channel_map import ChannelMap
from ematwin.recordings.collect import Collected, derive
from ematwin.recordings.formats.base import RecordedFile
from ematwin.recordings.gaps import Policy, sound_samples
from ematwin.recordings.recording import Recording, label_text
from ematwin.recordings.resample import onto, to_constant_rate
from ematwin.recordings.saturation import saturation_warnings
from ematwin.recordings.timing import tidy_time

_MOVED = 1.0  # s: tidying moves times by less, unless it counts calendar times from the first


def cleaned(
    found: Collected,
    file: RecordedFile,
    channel_map: ChannelMap,
    *,
    inputs: Collection[str] = (),
    rate: float | None = None,
    gaps: Policy = "refuse",
    labels: Mapping[str, str] | None = None,
) -> Recording:
    """What was collected from a file, brought to what a recording is.

    Parameters
    ----------
    found : of the whole file, or of one motion in it
    inputs : channels that drive the model
    rate : float, Hz, or None: as recorded
    gaps : "refuse", "longest" or "mask"
    labels : of the recording

    Raises
    ------
    RecordError
        If times or values cannot be those of a recording.
    """
    what = f"{file.path} {label_text(labels or {})}".strip()
    start = found.start
    for key, raw in found.times.items():
        found.times[key], changed = tidy_time(raw, what)
        found.changed += changed
        moved = float(raw[0] - found.times[key][0])
        if start is not None and start is found.start and abs(moved) > _MOVED:
            start += timedelta(seconds=moved)
    by_column = {name: found.times[key] for name, key in found.bases.items()}
    currents = [one.name for one in channel_map.channels if one.unit == "A"]
    counts, warnings = saturation_warnings(found.columns, by_column, found.full_scales, currents)
    means = {one.name for one in channel_map.channels if one.is_mean}
    time = _bring_to_one_base(found, means, inputs, what)
    derive(found, channel_map)
    sound = sound_samples(time, found.columns, gaps, what, inputs)
    time, columns, changed = to_constant_rate(sound.time, sound.columns, rate, what, means)
    provenance: dict[str, Any] = {
        "source": "file",
        "file": file.path.name,
        "format": file.kind,
        "columns": found.channels,
        "assumed": found.assumed,
        "changed": found.changed + sound.changed + changed,
        "warnings": found.warnings + sound.warnings + warnings,
    }
    if file.metadata.get("provenance"):
        provenance["origin"] = file.metadata["provenance"]
    if counts:
        provenance["saturated_samples"] = counts
    if sound.masked:
        provenance["masked_s"] = [list(stretch) for stretch in sound.masked]
    in_order = [one for one in channel_map.channels if one.name in columns]
    return Recording(
        time,
        {one.name: columns.pop(one.name) for one in in_order},
        units={one.name: one.unit for one in in_order},
        labels=labels,
        start=start,
        source=file.path.name,
        provenance=provenance,
    )


def _bring_to_one_base(
    found: Collected, means: Collection[str], inputs: Collection[str], what: str
) -> np.ndarray:
    """All columns at the times of what was measured, the fastest if that has several bases."""
    columns, bases, times = found.columns, found.bases, found.times
    if len(times) == 1:
        return next(iter(times.values()))
    steps = {key: float(np.median(np.diff(time))) for key, time in times.items()}
    measured = [name for name in columns if name in means]
    measured = measured or [name for name in columns if name not in inputs] or list(columns)
    chosen = min((bases[name] for name in measured), key=steps.__getitem__)
    start = max(time[0] for time in times.values())
    stop = min(time[-1] for time in times.values())
    slack = 1e-9 + 0.5 * steps[chosen]
    inside = (times[chosen] >= start - slack) & (times[chosen] <= stop + slack)
    if inside.sum() < 2:
        raise RecordError(
            f"The channels mapped from {what} share no time: the last begins at {start:.6g} s, the "
            f"first ends at {stop:.6g} s. Map channels that were recorded together."
        )
    time = times[chosen][inside]
    leading = ", ".join(name for name in measured if bases[name] == chosen)
    for name, values in list(columns.items()):
        key = bases[name]
        if key == chosen:
            columns[name] = values[inside]
        else:
            columns[name] = onto(times[key], values, time, 1.0 / steps[chosen], name in means)
            found.changed.append(
                f"{name}, sampled every {steps[key]:.6g} s, was brought to the times of {leading}, "
                f"every {steps[chosen]:.6g} s, from {time[0]:.6g} to {time[-1]:.6g} s"
            )
        bases[name] = chosen
    return time
