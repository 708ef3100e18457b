"""From the channels of a file to columns in SI: matched, read once, converted in place.

`match` takes the channels that have the name of one of a recording; a proposed map
(`ematwin.models.proposing`) takes those that words and units speak for as well.
"""

from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings import words
from ematwin.recordings.channel import PHASES, Channel, ChannelMap, MappedChannel, channel_called
from ematwin.recordings.formats.base import Progress, RecordedFile
from ematwin.recordings.recording import label_text
from ematwin.recordings.sampling import ABSURD
from ematwin.recordings.survey import unit_and_stem
from ematwin.showing.text import listed

Needs = Sequence[Sequence[Sequence[str]]]
"""Groups of channels; of each group at least one whole alternative must be there."""

Matched = dict[str, tuple[str, MappedChannel]]
"""Full name in the file and entry of the map, by channel of the recording, time first."""


class MissingChannelError(RecordError):
    """A file has no channel that a kind of actuator needs."""


def match(
    file: RecordedFile, channel_map: ChannelMap, needs: Needs
) -> tuple[Matched, list[str], list[str]]:
    """Find the channels of a recording in a file; also sentences on assumptions, and warnings.

    Channels that the map does not name are found by their own name or alias, with or without a
    unit. Beside a map an optional channel that is ambiguous, of another unit, or another form of a
    quantity that the map gives is left out with a warning. Raises `MissingChannelError` if there is
    none of a needed channel; `RecordError` if one is ambiguous, or there is none of a name in the
    map.
    """
    channels, mapped = channel_map.channels, channel_map.columns
    found = {
        column: (words.find_channel(file.names, entry.channel, file.path), entry)
        for column, entry in mapped.items()
    }
    closed = {*mapped, *channel_map.without, *(["time"] if channel_map.sample_rate else [])}
    by_name = {name: many for name, many in _by_name(file, channels).items() if name not in closed}
    missing = (name for _, names in unmet(needs, channels, mapped) for name in names)
    needed = {"time", *missing} if mapped else by_name.keys()
    for column in [name for name in by_name if name in needed]:
        name, *others = by_name.pop(column)
        if others:
            several = words.first_names([name, *others])
            raise RecordError(
                f"{file.path} has several channels for {column}: {several}. "
                f'Map one of them, such as {column}="{name}".'
            )
        found[column] = (name, MappedChannel(channel=name))
    added, warnings = _optional(found, by_name, file, channel_map, needs)
    said = f"beside the map, these were found by their names: {', '.join(added)}"
    found |= added
    _check_complete(file, channel_map, needs, found)
    used = [c.name for c in channels if c.name in found and c.stands_in_for not in found]
    return {name: found[name] for name in used}, [said] if added else [], warnings


def _by_name(file: RecordedFile, channels: Sequence[Channel]) -> dict[str, list[str]]:
    """The names in the file that mean a channel most plainly, by channel."""
    best: dict[str, tuple[float, list[str]]] = {}
    for name in file.names:
        column, score = words.named(name, channels, file.names)
        if score == words.A_CLOCK and file.base_time(file.time_base(name)) is not None:
            continue  # the format itself gives times
        known, alike = best.get(column, (score, []))
        if column and score >= known:
            best[column] = (score, [*alike, name] if score == known else [name])
    return {column: names for column, (_, names) in best.items()}


def _optional(
    found: Matched, by_name: Mapping[str, Sequence[str]], file: RecordedFile,
    channel_map: ChannelMap, needs: Needs,
) -> tuple[Matched, list[str]]:  # fmt: skip
    """Channels that are neither needed nor mapped, by their own names; warnings of the others."""
    channels, used = channel_map.channels, {name for name, _ in found.values()}
    closed = with_derived(channels, found)
    for group in needs:  # a map that gives phases gives no equivalent current
        form = {name: channel_map.channel(name).unit for part in group for name in part}
        given = {form[name] for name in form if name in found}
        closed |= {name for name, unit in form.items() if unit in given}
    added: Matched = {}
    warnings = []
    for column, (name, *others) in by_name.items():
        if column in closed or used & {name, *others}:
            continue
        stated, why = file.stated_unit(name) or words.unit_beside(name), ""
        if others:
            several = words.first_names([name, *others])
            why = f"{file.given.name} has several channels for it, {several}"
        elif stated and not words.fits(stated, channel_map.channel(column).unit):
            why = f"{name} is in {stated}"
        if why:
            warnings.append(f"{column} was left out: {why}. Map it where it is needed.")
        else:
            added[column] = (name, MappedChannel(channel=name))
    return added, warnings


def with_derived(channels: Sequence[Channel], present: Collection[str]) -> set[str]:
    """The channels that are there, and those that follow from them."""
    return {*present, *(one.name for one in channels if one.follows_from(present))}


def is_met(group: Sequence[Sequence[str]], present: Collection[str]) -> bool:
    """Whether one whole alternative of a group of needs is there."""
    return any(all(name in present for name in alternative) for alternative in group)


def unmet(
    needs: Needs, channels: Sequence[Channel], present: Collection[str]
) -> list[tuple[Sequence[Sequence[str]], list[str]]]:
    """The groups of needs without a whole alternative, each with the names that are missing."""
    there = with_derived(channels, present)
    return [
        (group, list(dict.fromkeys(name for part in group for name in part if name not in there)))
        for group in needs
        if not is_met(group, there)
    ]


def _check_complete(
    file: RecordedFile, channel_map: ChannelMap, needs: Needs, found: Mapping[str, object]
) -> None:
    for group, missing in unmet(needs, channel_map.channels, found):
        wanted = [channel_map.channel(name) for name in missing]
        for name in file.names:  # refused for its unit, such as error_kg for a position error
            for stem, unit in words.suffixes(words.bare(words.last_part(name))):
                channel = channel_called(stem, wanted)
                if channel is not None and len(unit) > 1 and words.is_unit(unit):
                    what = f"{channel.name} (channel {name!r} of {file.path})"
                    words.unit_factor(unit, channel.unit, what)
        meaning = f" ({wanted[0].meaning})" if len(group) == 1 == len(group[0]) else ""
        lacking = (listed([name for name in part if name not in found]) for part in group)
        raise MissingChannelError(
            f"{file.path} has no channel for {', nor for '.join(lacking)}{meaning}; "
            f"it has {words.first_names(file.names)}. Map it, such as {wanted[0].name}="
            f'"{_likely(file, wanted[0])}".'
        )


def _likely(file: RecordedFile, channel: Channel) -> str:
    """The channel of a file for which words speak most, for messages; an example if none do."""
    best, likely = words.UNIT_ONLY, f"Channel 1 [{words.example(channel.unit)}]"
    for name in file.names:
        unit, _, stem = unit_and_stem(file, name)
        if not unit or words.fits(unit, channel.unit):
            score, _ = words.by_words(stem, unit, channel) or (0.0, "")
            best, likely = (score, name) if score > best else (best, likely)
    return likely


@dataclass
class Collected:
    """Columns in SI on their time bases, and the account of their conversion."""

    file: RecordedFile
    map: ChannelMap
    names: list[str]  # of the channels of the file that were used
    assumed: list[str]  # sentences for the provenance, as `changed` and `warnings`
    warnings: list[str]
    changed: list[str] = field(default_factory=list)
    labels: dict[str, str] = field(default_factory=dict)  # of a motion in a table of motions
    columns: dict[str, np.ndarray] = field(default_factory=dict)  # (S,), SI, by channel
    bases: dict[str, str] = field(default_factory=dict)  # key of the time base, by channel
    times: dict[str, np.ndarray] = field(default_factory=dict)  # (S,), s, by time base
    # (S,), s, of all columns, once they are on one base
    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)  # account, by channel
    # lowest and highest value that the converter gives, by channel
    full_scales: dict[str, tuple[float, float]] = field(default_factory=dict)
    start: datetime | None = None  # the moment from which time is counted
    masked: list[list[float]] = field(default_factory=list)  # [start, stop], s, of filled stretches

    @property
    def source(self) -> str:
        """Name of the file."""
        return self.file.given.name

    @property
    def name(self) -> str:
        """File and labels, for messages."""
        return f"{self.file.given} {label_text(self.labels)}".strip()

    def part(self, rows: slice, labels: dict[str, str]) -> "Collected":
        """Some rows of it; all its channels have one time base."""
        shared = ("file", "map", "columns", "times")
        rest = {name: deepcopy(one) for name, one in vars(self).items() if name not in shared}
        return Collected(**rest | {
            "file": self.file, "map": self.map, "labels": labels,
            "columns": {name: values[rows] for name, values in self.columns.items()},
            "times": {key: time[rows] for key, time in self.times.items()},
        })  # fmt: skip


def collect(
    file: RecordedFile, channel_map: ChannelMap, needs: Needs, progress: Progress | None = None
) -> Collected:
    """Read the channels of a file that are mapped or found by name (see `match`).

    Raises `RecordError` if one is missing or ambiguous, holds no numbers, or has another unit.
    """
    matched, assumed, warnings = match(file, channel_map, needs)
    uses = [name for name, _ in matched.values()]
    result = Collected(file, channel_map, list(dict.fromkeys(uses)), [], warnings)
    raw = file.read(result.names, progress)
    result.assumed += [*file.assumed, *assumed]  # reading may add to the file's
    carried = dict(zip(PHASES, (f"current_{one}" for one in channel_map.phase_order), strict=True))
    for column, (name, entry) in matched.items():
        values = raw[name].copy() if uses.count(name) > 1 else raw.pop(name)
        _add(result, channel_map.channel(carried.get(column, column)), name, entry, values)
    if channel_map.phase_order != "abc":
        said = ", ".join(f"the channel mapped as {old} is {new}" for old, new in carried.items())
        result.changed.append(f"phase order {channel_map.phase_order}: {said}")
    silent = [
        f"{column} in {account['unit']}"
        for column, account in result.channels.items()
        if account["unit_from"] == "assumed"
    ]
    if silent:
        said = "neither the map nor the file states a unit, so SI was taken"
        result.assumed.append(f"{said}: {', '.join(silent)}")
    _find_times(result)
    derive(result)
    return result


def derive(found: Collected, time: np.ndarray | None = None) -> None:
    """Add the channels that follow from others of one time base; drop those that stood in.

    ``time`` (S,) belongs to all columns, once they have one: channels may follow from it.
    """
    channels = found.map.channels
    columns = found.columns if time is None else found.columns | {"time": time}
    for channel in [one for one in channels if one.follows_from(columns)]:
        derivation = channel.derived
        assert derivation is not None
        sources = derivation.sources
        keys = [found.bases.get(source, next(iter(found.bases.values()))) for source in sources]
        if len(set(keys)) > 1:
            if channel.is_mean:
                raise RecordError(
                    f"{' and '.join(sources)} were sampled at different times "
                    f"({' and '.join(keys)}), so {channel.name} cannot be derived from them. "
                    f"Give {channel.name} as well."
                )
            continue  # until all are on one base
        found.columns[channel.name] = derivation.compute(*(columns[s] for s in sources))
        found.bases[channel.name] = keys[0]
        found.channels[channel.name] = {"derived": derivation.formula}
        found.changed.append(f"{channel.name} was derived as {derivation.formula}")
    for channel in channels:
        if channel.stands_in_for in found.columns:
            found.columns.pop(channel.name, None)
            found.bases.pop(channel.name, None)


def _add(
    found: Collected, channel: Channel, name: str, entry: MappedChannel, values: np.ndarray
) -> None:
    """Convert the values of a channel in place, and add them with their account."""
    unit, source = _unit(found, channel, name, entry)
    what = f"{channel.name} (channel {name!r} of {found.file.path})"
    factor = words.unit_factor(unit, channel.unit, what)
    if entry.unwrap:
        values = np.unwrap(values, period=2.0 * np.pi / (factor * abs(entry.scale)))
    if entry.side is not None and entry.side != channel.side:
        assert found.map.gear_ratio is not None
        # angles and speeds of the output are smaller than the motor's, a torque larger
        up = (entry.side == "output") != (channel.unit == "N*m")
        factor *= found.map.gear_ratio if up else 1.0 / found.map.gear_ratio
    factor *= entry.sign
    if (most := entry.full_scale) is not None:
        low, high = sorted(factor * (end + entry.offset) for end in (-most, most))
        found.full_scales[channel.name] = (low, high)
    if factor * entry.scale != 1.0:
        values *= factor * entry.scale
    if entry.offset != 0.0:
        values += factor * entry.offset
    absurd = np.flatnonzero(np.isfinite(values) & (np.abs(values) > ABSURD))
    if absurd.size:
        raise RecordError(
            f"{what} reaches {values[absurd[0]]:.3g} {channel.unit} at sample {absurd[0]}, which "
            "nothing does. The file is damaged, or another channel was meant."
        )
    account = entry.model_dump(exclude={"channel", "unit"}, exclude_defaults=True)
    found.channels[channel.name] = {"channel": name, "unit": unit, "unit_from": source} | account
    found.columns[channel.name] = values
    found.bases[channel.name] = found.file.time_base(name)


def _unit(found: Collected, channel: Channel, name: str, entry: MappedChannel) -> tuple[str, str]:
    """The unit of a channel and who states it: map, file, name, or nobody (SI is assumed)."""
    file, stated, chosen = found.file, found.file.stated_unit(name), entry.unit
    beside = words.beside(entry.channel)[1]  # "Phase A [mA]" in the map for the channel "Phase A"
    if chosen is None and entry.channel != name and words.fits(beside, channel.unit):
        chosen = beside
    if chosen is not None:
        if stated and stated != chosen:
            said = f"The map gives {channel.name} in {chosen}, the file in {stated}"
            found.warnings.append(f"{said}; the map was followed.")
        return chosen, "map"
    if stated:
        # a scale leads from the unit of the file (volts of a probe) to another one
        return (stated, "file") if entry.scale == 1.0 else (channel.unit, "scale")
    is_own = channel_called(words.bare(words.last_part(name)), found.map.channels) is not None
    # current_a is phase a, no current in A
    unit = (words.beside(name) if is_own else words.unit_in_name(name, channel.unit, file.names))[1]
    if words.fits(unit, channel.unit):
        return unit, "name"
    if other := words.unit_beside(name):  # which is refused, unless a scale leads from it
        return (other, "name") if entry.scale == 1.0 else (channel.unit, "scale")
    return channel.unit, "assumed"


def _find_times(found: Collected) -> None:
    """Times of each base: from the sample rate, the time channel, or the file's own base."""
    file, rate = found.file, found.map.sample_rate
    time, key_of_time = found.columns.pop("time", None), found.bases.pop("time", None)
    lengths = {name: values.size for name, values in found.columns.items()}
    if rate is not None:
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{name} {size}" for name, size in lengths.items())
            said = f"With sample_rate all channels of {file.path} must be equally long"
            raise RecordError(f"{said}; they have {told} samples.")
        found.changed.append(f"time was counted from a rate of {rate:g} Hz")
    for column, key in found.bases.items():
        if key in found.times:
            continue
        if rate is not None:
            found.times[key] = np.arange(lengths[column]) / rate
        elif key != key_of_time and (own := file.base_time(key)) is not None:
            found.times[key], found.start = own, file.start
        elif time is None:
            raise RecordError(
                f"{file.path} has no channel for time, and its format gives none for "
                f"{column}; it has {words.first_names(file.names)}. "
                'Map it, such as time="t [ms]", or give sample_rate.'
            )
        elif time.size != lengths[column]:
            said = f"{column} of {file.path} has {lengths[column]} samples, time has {time.size}"
            raise RecordError(f"{said}. Map channels that were sampled together.")
        else:
            found.times[key] = time
            found.start = file.clocks.get(found.channels["time"]["channel"])
    if any(length.size == 0 for length in found.times.values()):
        raise RecordError(f"{file.path} holds no rows; nothing was recorded. Leave it out.")
