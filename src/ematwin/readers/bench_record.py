"""A record from a recording of a test bench: the steps in their order.

Channels are read and converted (`collect`), times tidied (`timing`), saturated samples counted
(`saturation`), all brought to one time base, holes dealt with (`gaps`), and the whole to a
constant rate (`resample`). Each step adds what it did to the provenance.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.readers.collect import collect
from ematwin.readers.column_map import ColumnMap
from ematwin.readers.gaps import Policy, sound_samples
from ematwin.readers.recording import Progress, Recording
from ematwin.readers.resample import CURRENTS, onto, to_constant_rate
from ematwin.readers.saturation import saturation_warnings
from ematwin.readers.timing import tidy_time
from ematwin.signals.record import Record


def record_of_bench(
    recording: Recording,
    column_map: ColumnMap,
    rate: float | None,
    gaps: Policy,
    progress: Progress | None,
) -> Record:
    """A recording of somebody else, brought to what a record is.

    Parameters
    ----------
    recording : open
    column_map : which channel is which column
    rate : float, Hz, or None: as recorded
    gaps : "refuse", "longest" or "mask"
    progress : called with the share read

    Raises
    ------
    RecordError
        If a column is missing or holds what a record cannot.
    """
    path = recording.path
    found = collect(recording, column_map, progress)
    for key in found.times:
        found.times[key], changed = tidy_time(found.times[key], path)
        found.changed += changed
    by_column = {name: found.times[key] for name, key in found.bases.items()}
    counts, warnings = saturation_warnings(found.columns, by_column, found.full_scales)
    time, columns = _one_base(found.columns, found.bases, found.times, found.changed, path)
    sound = sound_samples(time, columns, gaps, path)
    time, columns, changed = to_constant_rate(sound.time, sound.columns, rate, path)
    provenance: dict[str, Any] = {
        "source": "file",
        "file": path.name,
        "format": recording.kind,
        "columns": found.channels,
        "assumed": found.assumed,
        "changed": found.changed + sound.changed + changed,
        "warnings": found.warnings + sound.warnings + warnings,
    }
    if recording.metadata.get("provenance"):
        provenance["origin"] = recording.metadata["provenance"]
    if counts:
        provenance["saturated_samples"] = counts
    if sound.masked:
        provenance["masked_s"] = [list(stretch) for stretch in sound.masked]
    return record_in({"time": time, **columns}, provenance, path)


def _one_base(
    columns: dict[str, np.ndarray],
    bases: dict[str, str],
    times: dict[str, np.ndarray],
    changed: list[str],
    path: Path,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """All columns at the times of the currents, the fastest if they have several bases."""
    if len(times) == 1:
        return next(iter(times.values())), columns
    steps = {key: float(np.median(np.diff(time))) for key, time in times.items()}
    chosen = min((bases[name] for name in CURRENTS if name in columns), key=steps.__getitem__)
    start = max(time[0] for time in times.values())
    stop = min(time[-1] for time in times.values())
    slack = 1e-9 + 0.5 * steps[chosen]
    inside = (times[chosen] >= start - slack) & (times[chosen] <= stop + slack)
    if inside.sum() < 2:
        raise RecordError(
            f"The channels mapped from {path} share no time: the last begins at {start:.6g} s, the "
            f"first ends at {stop:.6g} s. Map channels that were recorded together."
        )
    time = times[chosen][inside]
    aligned: dict[str, np.ndarray] = {}
    for name, values in columns.items():
        key = bases[name]
        if key == chosen:
            aligned[name] = values[inside]
        else:
            aligned[name] = onto(times[key], values, time, 1.0 / steps[chosen], name in CURRENTS)
            changed.append(
                f"{name}, sampled each {steps[key]:.6g} s, was brought to the times of the "
                f"currents, each {steps[chosen]:.6g} s, from {time[0]:.6g} to {time[-1]:.6g} s"
            )
    return time, aligned


def record_in(values: dict[str, np.ndarray], provenance: dict[str, Any], path: Path) -> Record:
    """A `Record` of these columns; what it refuses is said of the file."""
    try:
        return Record(**values, provenance=provenance)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from None
