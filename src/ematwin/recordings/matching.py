"""Which channel of a file is which channel of a recording: by the map, by name, or by its words.

`match` is sure and serves reading: the map, then a channel's own name or alias. `candidates` ranks
everything else that name and unit would allow, with reasons, for a proposed map.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from ematwin.errors import RecordError
from ematwin.recordings.channel import Channel, channel_called, derivable
from ematwin.recordings.channel_map import ChannelMap, MappedChannel
from ematwin.recordings.formats.base import RecordedFile
from ematwin.recordings.names import (
    AS_A_CLOCK,
    TO_THE_LETTER,
    Said,
    find_channel,
    last_part,
    listed,
    meant,
    said_by,
)
from ematwin.recordings.survey import Surveyed
from ematwin.recordings.units import (
    bare,
    endings,
    example,
    fits,
    is_other_unit,
    unit_factor,
)

Needs = Sequence[Sequence[Sequence[str]]]
"""Groups of channels; of each group at least one whole alternative must be there."""

# How strongly a name speaks for a channel. Below `NAMED` it is worth a mention and no more.
OWN_NAME, IN_WORDS, NAMED, UNIT_ONLY = 4.0, 3.0, 2.0, 1.0
_DIMENSIONS = {"s": "time", "A": "current", "V": "voltage", "rad/s": "speed", "m/s": "speed",
               "rad": "position", "m": "position", "N*m": "load"}  # fmt: skip
_PROBE = 1.0  # V: less is no voltage of a motor
_ON_BOTH_SHAFTS = {"position", "speed"}


class MissingChannelError(RecordError):
    """A file has no channel that a kind of actuator needs."""


@dataclass
class Matched:
    """Channels of a recording with their full names in the file and their entries of the map.

    Attributes
    ----------
    channels : by channel of the recording, time first
    assumed, warnings : sentences for the provenance
    """

    channels: dict[str, tuple[str, MappedChannel]]
    assumed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def match(file: RecordedFile, channel_map: ChannelMap, needs: Needs) -> Matched:
    """Find the channels of a recording in a file.

    Channels that the map does not name are found by their own name or alias, with or without a
    unit. Beside a map an optional channel that is ambiguous or of another unit is left out, with a
    warning, and so is another form of a quantity that the map gives.

    Raises
    ------
    MissingChannelError
        If there is none of a needed channel.
    RecordError
        If a channel is ambiguous, or there is none of that name in the map.
    """
    mapped = channel_map.columns
    found = {
        column: (find_channel(file.names, entry.channel, file.path), entry)
        for column, entry in mapped.items()
    }
    result = Matched(found)
    open_ones = [
        one for one in channel_map.channels
        if one.name not in mapped and one.name not in channel_map.without
        and not (one.name == "time" and channel_map.sample_rate is not None)
    ]  # fmt: skip
    wanted = _needed(open_ones, channel_map, needs) if mapped else open_ones
    by_name = _by_name(file, channel_map, wanted)
    for column, names in by_name.items():
        if len(names) > 1:
            raise RecordError(
                f"{file.path} has several channels for {column}: {listed(names)}. "
                f'Map one of them, such as {column}="{names[0]}".'
            )
        found[column] = (names[0], MappedChannel(channel=names[0]))
    if mapped:
        _add_optional(result, file, channel_map, needs, [o for o in open_ones if o not in wanted])
    for channel in channel_map.channels:
        if channel.stands_in_for in found:
            found.pop(channel.name, None)
    _check_complete(file, channel_map, needs, found)
    result.channels = {c.name: found[c.name] for c in channel_map.channels if c.name in found}
    return result


def _needed(open_ones: Sequence[Channel], channel_map: ChannelMap, needs: Needs) -> list[Channel]:
    """Time, and needed channels that are not mapped."""
    groups = unmet(needs, channel_map.channels, channel_map.columns)
    names = {"time", *(name for _, missing in groups for name in missing)}
    return [one for one in open_ones if one.name in names]


def _by_name(
    file: RecordedFile, channel_map: ChannelMap, wanted: Sequence[Channel]
) -> dict[str, list[str]]:
    """The names in the file that mean a wanted channel most plainly, by channel."""
    ranked: dict[str, dict[int, list[str]]] = {}
    for name in file.names:
        channel, rank = meant(name, channel_map.channels, file.names)
        if rank == AS_A_CLOCK and file.base_time(file.time_base(name)) is not None:
            continue  # the format itself gives times
        if channel is not None and channel in wanted:
            ranked.setdefault(channel.name, {}).setdefault(rank, []).append(name)
    return {column: by_rank[min(by_rank)] for column, by_rank in ranked.items()}


def _add_optional(
    result: Matched,
    file: RecordedFile,
    channel_map: ChannelMap,
    needs: Needs,
    optional: Sequence[Channel],
) -> None:
    """Add channels that are neither needed nor mapped, by their own names."""
    found = result.channels
    present = with_derived(channel_map.channels, found)
    given = {  # quantities of which a map gives one form: phases, or one equivalent current
        (n, channel_map.channel(name).unit)
        for n, group in enumerate(needs) for part in group for name in part if name in found
    }  # fmt: skip
    said_otherwise = {
        name
        for n, group in enumerate(needs) for part in group for name in part
        if (n, channel_map.channel(name).unit) in given
    }  # fmt: skip
    used = {name for name, _ in found.values()}
    added = []
    for column, names in _by_name(file, channel_map, optional).items():
        channel = channel_map.channel(column)
        if column in present or column in said_otherwise or used.intersection(names):
            continue
        stated = file.stated_unit(names[0])
        if len(names) > 1:
            why = f"{file.given.name} has several channels for it, {listed(names)}"
        elif stated and not fits(stated, channel.unit):
            why = f"{names[0]} is in {stated}"
        else:
            found[column] = (names[0], MappedChannel(channel=names[0]))
            added.append(column)
            continue
        result.warnings.append(f"{column} was left out: {why}. Map it where it is needed.")
    if added:
        result.assumed.append(
            f"beside the map, these were found by their names: {', '.join(added)}"
        )


def with_derived(channels: Sequence[Channel], present: Collection[str]) -> set[str]:
    """The channels that are there, and those that follow from them."""
    return {*present, *(channel.name for channel in derivable(channels, present))}


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
        for channel in (channel_map.channel(name) for name in missing):
            _refuse_odd_unit(file, channel)
        first = channel_map.channel(missing[0])
        meaning = f" ({first.meaning})" if len(group) == 1 == len(group[0]) else ""
        raise MissingChannelError(
            f"{file.path} has no channel for {', nor for '.join(map(_joined, group))}{meaning}; "
            f"it has {listed(file.names)}. "
            f'Map it, such as {first.name}="Channel 1 [{example(first.unit)}]".'
        )


def _refuse_odd_unit(file: RecordedFile, channel: Channel) -> None:
    """Raise if a name would fit but for its unit, such as ``error_kg`` for a position error."""
    for name in file.names:
        for stem, unit in endings(bare(last_part(name))):
            if channel_called(stem, (channel,)) is not None and is_other_unit(unit):
                unit_factor(unit, channel.unit, f"{channel.name} (channel {name!r} of {file.path})")


def _joined(names: Sequence[str]) -> str:
    *head, last = names
    return f"{', '.join(head)} and {last}" if head else last


@dataclass(frozen=True)
class Candidate:
    """A channel of the file that may be one of the recording.

    Attributes
    ----------
    name : in the file
    score : how strongly name and unit speak for it
    reason : a part of a sentence
    """

    name: str
    score: float
    reason: str


def candidates(
    channel: Channel,
    surveyed: Sequence[Surveyed],
    channels: Sequence[Channel],
    names: Collection[str],
) -> list[Candidate]:
    """The channels of a file that may be ``channel``, the likeliest first."""
    found = []
    for one in surveyed:
        if one.is_text or not one.samples or (one.unit and not fits(one.unit, channel.unit)):
            continue
        score, reason = _fit(one, channel, channels, names)
        if score > 0.0:
            found.append(Candidate(one.name, score, reason))
    return sorted(found, key=lambda one: -one.score)


def _fit(
    one: Surveyed, channel: Channel, channels: Sequence[Channel], names: Collection[str]
) -> tuple[float, str]:
    own, rank = meant(one.name, channels, names)
    if own is not None and rank < AS_A_CLOCK:
        if own.name != channel.name:
            return 0.0, ""
        to_the_letter = rank == TO_THE_LETTER
        return OWN_NAME, (
            "it has that name" if to_the_letter else "its name is one that files use for it"
        )
    text = _without_unit(one)
    said, wanted = said_by(text), _wanted(channel)
    if said.other or said.phase != wanted.phase:
        return 0.0, ""
    if channel.unit == "V" and not said.quantities and _largest(one, channel) < _PROBE:
        return 0.0, ""  # more likely what a probe makes of a current
    dimension = _DIMENSIONS.get(channel.unit, "") if one.unit else ""
    score, because = _by_quantity(said, wanted, dimension, text)
    if not score:
        return 0.0, ""
    if wanted.quantities & {"command", "load"} or not wanted.place:
        # they are held on one shaft; a name that names the other shaft means something else
        elsewhere = said.place and said.place not in (wanted.place, channel.side or said.place)
        if elsewhere or said.place == "bus":
            return 0.0, ""
    elif said.place != wanted.place:
        if said.place or wanted.place == "bus":
            return 0.0, ""
        return min(score, NAMED), f"{because}, but not of which shaft"
    return score, because


def _by_quantity(said: Said, wanted: Said, dimension: str, text: str) -> tuple[float, str]:
    """How well the quantities of two names agree; ``dimension`` is of the unit, or ""."""
    named, goal = set(said.quantities), set(wanted.quantities)
    if "command" in goal:
        # a set point of the position may say so; one of anything else is another channel
        if "command" not in named or named - {"command", "position"}:
            return 0.0, ""
        return IN_WORDS, f"“{text}” is a word for what is commanded"
    if not goal or "command" in named or ("error" in named) != ("error" in goal):
        return 0.0, ""
    named -= {"position"} if "error" in goal else set()
    quantity = next(iter(goal))
    if quantity == "load" and named - {"load", "torque"}:
        return 0.0, ""
    if quantity == "load" and named == {"torque"}:
        return UNIT_ONLY, f"“{text}” may be the motor's own torque as well"
    if quantity in named:
        # a name that holds two quantities, such as "motor torque current", says less
        clear = not (named - goal - {"position", "load", "torque"})
        return (IN_WORDS if clear else NAMED), f"“{text}” is a word for a {quantity}"
    if named or dimension != quantity:
        return 0.0, ""
    for part, what in ((said.phase, "phase"), (said.place, "place")):
        if part:
            return IN_WORDS, f"“{text}” names the {what} and its unit is that of a {quantity}"
    return UNIT_ONLY, f"its unit is that of a {quantity}, and nothing else speaks for it"


def _largest(one: Surveyed, channel: Channel) -> float:
    """Largest magnitude, SI; infinite where no unit is stated."""
    if not one.unit:
        return math.inf
    return max(abs(one.low), abs(one.high)) * unit_factor(one.unit, channel.unit, one.name)


def _wanted(channel: Channel) -> Said:
    """The words of a name that means this channel."""
    said = said_by(channel.name)
    quantities = set(said.quantities)
    for whole in ("command", "error"):
        if whole in quantities:
            quantities = {whole}
    place = said.place or (channel.side or "" if quantities & _ON_BOTH_SHAFTS else "")
    if quantities & {"command", "load"}:
        place = channel.side or ""
    return Said(frozenset(quantities), place, said.phase)


def _without_unit(one: Surveyed) -> str:
    text = bare(last_part(one.name))
    if one.unit_from != "name":
        return text
    return next((stem for stem, unit in endings(text) if unit == one.unit), text)
