"""Recordings in files, for the channels of a given kind of actuator.

Each step adds to the provenance. `ematwin.models.reading` gives the public `read`, which knows the
kinds.

In a table of motions a new one begins where time falls back or a label changes. Labels are the
columns that do not change within a motion, such as condition, run and motion. A column with a unit
is a label where it stays the same through each motion; a load that steps within one is a signal
that nobody mapped.
"""

from collections.abc import Collection, Mapping, Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Any, TypeVar, get_args

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.quantities import parse_quantity
from ematwin.recordings.channel import Channel, ChannelMap, Columns, with_time
from ematwin.recordings.cleaning import Policy, make_sound, sentence, warn_of_saturation
from ematwin.recordings.collect import Collected, Needs, collect, derive, is_met
from ematwin.recordings.formats.base import Progress, RecordedFile, open_file
from ematwin.recordings.formats.csv_dialect import ROUTINE
from ematwin.recordings.recording import Recording, check_increasing
from ematwin.recordings.sampling import onto, sampled, tidy_time, to_constant_rate
from ematwin.recordings.words import unit_beside

Choice = Mapping[str, Sequence[str]]  # label to the values that are wanted
_SHORTEST = 20  # samples of a motion
_Motion = TypeVar("_Motion", Recording, Collected)


def read_file(
    path: Any,
    channels: Sequence[Channel],
    columns: Columns = None,
    *,
    needs: Needs = (),
    inputs: Collection[str] = (),
    own: bool = False,
    resample_to: float | str | None = None,
    gaps: Policy = "refuse",
    split: bool = False,
    where: Choice | Sequence[Choice] | None = None,
    progress: Progress | None = None,
) -> list[Recording]:
    """Read the recordings in a file; options and errors not named here as of `ematwin.read`.

    ``channels`` are of the kind of actuator, of which ``inputs`` drive the model. ``own`` reads a
    file that ematwin wrote as it is, whatever its channels; else if it has those that it ``needs``.
    """
    channel_map = ChannelMap.of(columns, channels)
    if gaps not in (known := get_args(Policy)):
        raise InputError(f"gaps must be {', '.join(known)}; received {gaps!r}.")
    if isinstance(resample_to, str):
        resample_to = parse_quantity(resample_to, "Hz", "resample_to")
    if resample_to is not None and not (np.isfinite(resample_to) and resample_to > 0.0):
        raise InputError(f"resample_to must be a positive number of Hz, received {resample_to}.")
    with open_file(path, **channel_map.csv.model_dump(exclude_none=True)) as file:
        is_complete = own or all(is_met(group, file.names) for group in needs)
        if file.metadata and columns is None and is_complete:
            return fitting([_as_written(file, channel_map.channels, resample_to, progress)], where)
        found = collect(file, channel_map, needs, progress)
        if not split and where is None:
            _check_single(found)
            return [_cleaned(found, inputs, resample_to, gaps)]
        chosen = fitting(_motions(found), where)
        for one in chosen:
            samples = min(time.size for time in one.times.values())
            if samples == 1:
                for time in found.times.values():
                    check_increasing(time, f"{found.name}: ")
            if samples < _SHORTEST:
                raise RecordError(
                    f"{one.name}: a motion of {samples} samples is too short; at least "
                    f"{_SHORTEST} are needed. Remove it, or check the column of time."
                )
        return [_cleaned(one, inputs, resample_to, gaps) for one in chosen]


def assumptions(recording: Recording) -> list[str]:
    """Assumptions made in reading that a user must see: not how a usual text table is written."""
    said = recording.provenance.get("assumed", [])
    return [sentence(text) for text in said if not text.startswith(ROUTINE)]


def _cleaned(
    found: Collected, inputs: Collection[str], rate: float | None, gaps: Policy
) -> Recording:
    """Collected columns of a file, or of one motion in it, as a recording."""
    file, channels, start = found.file, found.map.channels, found.start
    for key, raw in found.times.items():
        found.times[key], changed = tidy_time(raw, found.name)
        found.changed += changed
        moved = float(raw[0] - found.times[key][0])
        # by less than 1 s, unless calendar times are counted from the first
        if start is not None and start is found.start and abs(moved) > 1.0:
            start += timedelta(seconds=moved)
    counts = warn_of_saturation(found, [one.name for one in channels if one.unit == "A"])
    means = {one.name for one in channels if one.is_mean}
    found.time = _bring_to_one_base(found, means, inputs)
    derive(found, found.time)
    make_sound(found, gaps, inputs)
    for channel in channels:
        if not channel.refreshed or channel.name not in found.columns:
            continue
        moved_to = sampled(found.time, found.columns[channel.name], channel.refreshed)
        if moved_to is not None:  # each read was a sample of before
            found.columns[channel.name], period = moved_to
            late = f"{channel.name} is read up to {1e3 * period:.3g} ms after it was sampled"
            put = "it was brought to the times of the reads"
            found.changed.append(f"{late}, as its steps show; {put}")
    time, columns, changed = to_constant_rate(found.time, found.columns, rate, found.name, means)
    provenance: dict[str, Any] = {
        "source": "file", "file": file.given.name, "format": file.kind,
        "columns": found.channels, "assumed": found.assumed, "changed": found.changed + changed,
        "warnings": found.warnings,
    }  # fmt: skip
    if file.metadata.get("provenance"):
        provenance["origin"] = file.metadata["provenance"]
    if counts:
        provenance["saturated_samples"] = counts
    if found.masked:
        provenance["masked_s"] = found.masked
    in_order = [one for one in channels if one.name in columns]
    return Recording(
        time, {one.name: columns.pop(one.name) for one in in_order},
        units={one.name: one.unit for one in in_order}, labels=found.labels, start=start,
        source=file.given.name, provenance=provenance,
    )  # fmt: skip


def _bring_to_one_base(
    found: Collected, means: Collection[str], inputs: Collection[str]
) -> np.ndarray:
    """All columns at the times of the measured channels, the fastest of several bases."""
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
            f"The channels mapped from {found.name} share no time: the last begins at "
            f"{start:.6g} s, the first ends at {stop:.6g} s. Map channels "
            "that were recorded together."
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


def _as_written(
    file: RecordedFile, channels: Sequence[Channel], rate: float | None, progress: Progress | None
) -> Recording:
    """A recording that ematwin wrote, bit for bit; only the rate is changed, if asked for."""
    units: dict[str, str] = dict(file.metadata.get("units", {}))
    if "time" not in file.names:
        told = f"{file.path} has no channel for time; it has {', '.join(file.names)}"
        raise RecordError(f"{told}. Rename or add the column.")
    known = {channel.name: channel for channel in with_time(channels)}
    # another kind may mean something else by a name
    checked = file.names if set(file.names) <= set(known) else ("time",)
    for name in checked:
        unit, si_unit = units.get(name, known[name].unit), known[name].unit
        if unit != si_unit:
            said = f"{file.path} gives {name} in {unit}; a recording holds it in {si_unit}"
            raise RecordError(f"{said}. Convert it.")
    values = file.read(file.names, progress)
    time = values.pop("time")
    unknown = {"source": "file", "file": file.given.name}
    provenance = dict(file.metadata.get("provenance") or unknown)
    if rate is not None:
        means = file.metadata.get("means", [one.name for one in channels if one.is_mean])
        time, values, changed = to_constant_rate(time, values, rate, file.path, means)
        provenance["changed"] = [*provenance.get("changed", []), *changed]
    start = file.metadata.get("start")
    return Recording(
        time, values, units=units, labels=file.metadata.get("labels"),
        start=None if start is None else datetime.fromisoformat(start), source=file.given.name,
        provenance=provenance,
    )  # fmt: skip


def _motions(found: Collected) -> list[Collected]:
    """The motions of a file; one, where its channels have several time bases."""
    if len(found.times) > 1:
        return [found]
    key, time = next(iter(found.times.items()))
    labels = _labels(found, key, time.size)
    starts = np.r_[True, np.diff(time) < 0.0]
    measured = []  # the file, or brackets in the name, state a unit
    for name in labels:
        if found.file.stated_unit(name) or unit_beside(name):
            measured.append(name)
        else:
            starts[1:] |= _changes(labels[name])
    for name in measured:
        if np.any(_changes(labels[name]) & ~starts[1:]):
            del labels[name]
    labelled = np.any([_changes(text) for text in labels.values()], axis=0)
    falls = np.flatnonzero((np.diff(time) < 0.0) & ~labelled) + 1
    if falls.size:  # a table of motions, or a clock that was set?
        said = f"a new motion begins wherever time falls back, first at sample {falls[0]}"
        found.assumed.append(said)
    parts = []
    for first, end in pairwise(np.r_[np.flatnonzero(starts), time.size].tolist()):
        own = {name: str(text[first]) for name, text in labels.items()}
        parts.append(found.part(slice(first, end), own))
    return parts


def _check_single(found: Collected) -> None:
    """Raise `RecordError` if a table that is read as one recording holds several motions."""
    if len(found.times) > 1:
        return
    time = next(iter(found.times.values()))
    falls = np.flatnonzero(np.diff(time) < 0.0) + 1
    if falls.size and np.diff(np.r_[0, falls, time.size]).min() >= _SHORTEST:
        raise RecordError(
            f"{found.file.path} holds {falls.size + 1} motions: time falls back to "
            f"{time[falls[0]]:.6g} s at sample {falls[0]}. Read it with split=True, "
            "which gives a recording for each."
        )


def fitting(motions: Sequence[_Motion], where: Choice | Sequence[Choice] | None) -> list[_Motion]:
    """The motions that fit a choice of labels or one of several, in their order; all for None.

    Raises `InputError` if a motion has no such label, `RecordError` if none fits a choice.
    """
    if where is None:
        return list(motions)
    wanted: set[int] = set()
    for choice in [where] if isinstance(where, Mapping) else where:
        chosen = {id(motion) for motion in motions if _fits(motion, choice)}
        if not chosen:
            given = ", ".join(f"{key} = {' or '.join(v)}" for key, v in choice.items())
            names = dict.fromkeys(name for motion in motions for name in motion.labels)
            known = {n: dict.fromkeys(m.labels[n] for m in motions if n in m.labels) for n in names}
            there = "; ".join(f"{name} {', '.join(list(v)[:20])}" for name, v in known.items())
            said = f"None of the {len(motions)} motions has {given or 'anything to read'}"
            raise RecordError(f"{said}; there are {there or 'none'}. Correct the choice.")
        wanted |= chosen
    return [motion for motion in motions if id(motion) in wanted]


def _fits(motion: Any, where: Choice) -> bool:
    for name, values in where.items():
        if name not in motion.labels:
            there = ", ".join(motion.labels) or "none"
            raise InputError(
                f"{motion.source} has no label {name!r}; it has {there}. Correct the name."
            )
        if motion.labels[name] not in values:
            return False
    return True


def _labels(found: Collected, key: str, rows: int) -> dict[str, np.ndarray]:
    """The columns of a file that are labels, (S,) arrays of texts."""
    texts: dict[str, np.ndarray] = {}
    for name in found.file.names:
        if name in found.names or found.file.time_base(name) != key:
            continue
        text = np.array(found.file.texts(name))
        if text.size == rows and int(np.sum(_changes(text))) * _SHORTEST <= text.size:
            texts[name] = text  # it stays as it is for many rows, as no signal does
    return texts


def _changes(text: np.ndarray) -> Any:
    """Whether each row but the first differs from the one before it."""
    return text[1:] != text[:-1]
