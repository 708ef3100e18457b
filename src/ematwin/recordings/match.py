"""Which channel of a file is which: by the map, else by name, alias and unit in the name."""

from collections.abc import Collection, Sequence

from ematwin.errors import RecordError
from ematwin.recordings.channel import Channel, channel_called, derivable
from ematwin.recordings.channel_map import ChannelMap, MappedChannel
from ematwin.recordings.formats.base import RecordedFile, find_channel, last_part
from ematwin.recordings.units import bare, endings, example, is_other_unit, suffixes, unit_factor

Needs = Sequence[Sequence[Sequence[str]]]
"""Groups of channels; of each group at least one whole alternative must be there."""


class MissingChannelError(RecordError):
    """A file has no channel that a kind of actuator needs."""


def match(
    file: RecordedFile, channel_map: ChannelMap, needs: Needs
) -> dict[str, tuple[str, MappedChannel]]:
    """Name of a channel -> its full name in the file and its entry of the map, time first.

    Channels that the map does not name are found by their own name or alias, with or without a
    unit: all of them if the map names none, else only time and what is needed and not mapped.

    Raises
    ------
    MissingChannelError
        If there is none of a needed channel.
    RecordError
        If a channel is ambiguous, or there is none of that name in the map.
    """
    found = {
        column: (find_channel(file.names, entry.channel, file.path), entry)
        for column, entry in channel_map.columns.items()
    }
    for column, name in _by_name(file, channel_map, _wanted(channel_map, needs)).items():
        found[column] = (name, MappedChannel(channel=name))
    for channel in channel_map.channels:
        if channel.stands_in_for in found:
            found.pop(channel.name, None)
    _check_complete(file, channel_map, needs, found)
    return {one.name: found[one.name] for one in channel_map.channels if one.name in found}


def _wanted(channel_map: ChannelMap, needs: Needs) -> list[Channel]:
    """The channels that are looked for by name."""
    mapped = channel_map.columns
    known = [one for one in channel_map.channels if one.name not in mapped]
    if channel_map.sample_rate is not None:
        known = [one for one in known if one.name != "time"]
    if not mapped:
        return known
    present = with_derived(channel_map.channels, mapped)
    open_ones = {
        name
        for group in needs
        if not is_met(group, present)
        for alternative in group
        for name in alternative
    }
    return [one for one in known if one.name == "time" or one.name in open_ones]


def _by_name(
    file: RecordedFile, channel_map: ChannelMap, wanted: Sequence[Channel]
) -> dict[str, str]:
    """Name of a channel -> full name in the file, of those that are wanted.

    Where several fit, the plain name goes first, then an alias or a unit in brackets, then a unit
    behind an underscore.
    """
    ranked: dict[str, dict[int, list[str]]] = {}
    for name in file.names:
        channel, rank = meant(name, channel_map.channels, file.names)
        if channel is not None and channel in wanted:
            ranked.setdefault(channel.name, {}).setdefault(rank, []).append(name)
    found = {}
    for column, by_rank in ranked.items():
        names = by_rank[min(by_rank)]
        if len(names) > 1:
            raise RecordError(
                f"{file.path} has several channels for {column}: {_listed(names)}. "
                f'Map one of them, such as {column}="{names[0]}".'
            )
        found[column] = names[0]
    return found


def meant(
    name: str, channels: Sequence[Channel], names: Collection[str]
) -> tuple[Channel | None, int]:
    """The channel that a name in a file means, and how plainly it says so (0: to the letter)."""
    texts = dict.fromkeys((bare(last_part(name)), bare(name)))
    for text in texts:
        channel = channel_called(text, channels)
        if channel is not None:
            return channel, 0 if name == channel.name else 1
    for text in texts:
        for stem, _ in endings(text):
            channel = channel_called(stem, channels)
            if channel is None:
                continue
            if any(own == stem for own, _ in suffixes(text, channel.unit, names)):
                return channel, 2
    return None, 3


def with_derived(channels: Sequence[Channel], present: Collection[str]) -> set[str]:
    """The channels that are there, and those that follow from them."""
    return {*present, *(channel.name for channel in derivable(channels, present))}


def is_met(group: Sequence[Sequence[str]], present: Collection[str]) -> bool:
    """Whether one whole alternative of a group of needs is there."""
    return any(all(name in present for name in alternative) for alternative in group)


def _check_complete(
    file: RecordedFile, channel_map: ChannelMap, needs: Needs, found: Collection[str]
) -> None:
    present = with_derived(channel_map.channels, found)
    for group in needs:
        if is_met(group, present):
            continue
        missing = [name for part in group for name in part if name not in present]
        for channel in (channel_map.channel(name) for name in missing):
            _refuse_odd_unit(file, channel)
        first = channel_map.channel(missing[0])
        meaning = f" ({first.meaning})" if len(group) == 1 == len(group[0]) else ""
        raise MissingChannelError(
            f"{file.path} has no channel for {', nor for '.join(map(_joined, group))}{meaning}; "
            f"it has {_listed(file.names)}. "
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


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:12])
    return f"{shown} and {len(names) - 12} more" if len(names) > 12 else shown or "no channels"
