"""Which channel of a file is which channel of a recording.

`candidates` scores every channel of a file for one of a recording, with the reason. `match`, which
reading calls, takes those that have its name; a proposed map (`ematwin.models.proposing`) takes
those that words and units speak for as well, and asks where two are equally likely.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from ematwin.errors import RecordError
from ematwin.recordings import units
from ematwin.recordings.channel import TIME, Channel, channel_called, derivable, plain
from ematwin.recordings.channel_map import ChannelMap, MappedChannel
from ematwin.recordings.formats.base import RecordedFile
from ematwin.recordings.names import Said, find_channel, first_names, last_part, said_by
from ematwin.recordings.survey import Surveyed, unit_and_stem
from ematwin.showing.text import listed

Needs = Sequence[Sequence[Sequence[str]]]
"""Groups of channels; of each group at least one whole alternative must be there."""

# How strongly a name speaks for a channel. From `A_CLOCK` on it is the channel's own name; below
# `NAMED` it is worth a mention and no more.
UNIT_ONLY, NAMED, IN_WORDS, A_CLOCK, BEFORE_A_UNIT, ALIAS, OWN_NAME = map(float, range(1, 8))
_CLOCKS = ("zeit", "zeitstempel", "timestamp", "time_stamp", "uhrzeit", "datetime")
_DIMENSIONS = {"s": "time", "A": "current", "V": "voltage", "rad/s": "speed", "m/s": "speed",
               "rad": "position", "m": "position", "N*m": "load"}  # fmt: skip


class MissingChannelError(RecordError):
    """A file has no channel that a kind of actuator needs."""


@dataclass(frozen=True)
class Candidate:
    """A channel of the file that may be one of the recording."""

    name: str  # in the file
    score: float  # how strongly name and unit speak for it
    reason: str = ""  # a part of a sentence


@dataclass
class Matched:
    """Channels of a recording with their full names in the file and their entries of the map."""

    channels: dict[str, tuple[str, MappedChannel]]  # by channel of the recording, time first
    assumed: list[str] = field(default_factory=list)  # sentences for the provenance
    warnings: list[str] = field(default_factory=list)


def match(file: RecordedFile, channel_map: ChannelMap, needs: Needs) -> Matched:
    """Find the channels of a recording in a file.

    Channels that the map does not name are found by their own name or alias, with or without a
    unit. Beside a map an optional channel that is ambiguous, of another unit, or another form of a
    quantity that the map gives is left out with a warning. Raises `MissingChannelError` if there is
    none of a needed channel; `RecordError` if one is ambiguous, or there is none of a name in the
    map.
    """
    channels, mapped = channel_map.channels, channel_map.columns
    found = {
        column: (find_channel(file.names, entry.channel, file.path), entry)
        for column, entry in mapped.items()
    }
    result = Matched(found)
    closed = {*mapped, *channel_map.without, *([TIME.name] if channel_map.sample_rate else [])}
    by_name = {name: many for name, many in _by_name(file, channels).items() if name not in closed}
    missing = (name for _, names in unmet(needs, channels, mapped) for name in names)
    needed = {TIME.name, *missing} if mapped else by_name.keys()
    for column in [name for name in by_name if name in needed]:
        name, *others = by_name.pop(column)
        if others:
            raise RecordError(
                f"{file.path} has several channels for {column}: {first_names([name, *others])}. "
                f'Map one of them, such as {column}="{name}".'
            )
        found[column] = (name, MappedChannel(channel=name))
    _add_optional(result, by_name, file, channel_map, needs)
    for channel in channels:
        if channel.stands_in_for in found:
            found.pop(channel.name, None)
    _check_complete(file, channel_map, needs, found)
    result.channels = {c.name: found[c.name] for c in channels if c.name in found}
    return result


def _by_name(file: RecordedFile, channels: Sequence[Channel]) -> dict[str, list[str]]:
    """The names in the file that mean a channel most plainly, by channel."""
    best: dict[str, tuple[float, list[str]]] = {}
    for name in file.names:
        column, score = named(name, channels, file.names)
        if score == A_CLOCK and file.base_time(file.time_base(name)) is not None:
            continue  # the format itself gives times
        if column and score >= best.get(column, (score, []))[0]:
            alike = best[column][1] if column in best and best[column][0] == score else []
            best[column] = (score, [*alike, name])
    return {column: names for column, (_, names) in best.items()}


def _add_optional(
    result: Matched, by_name: Mapping[str, Sequence[str]], file: RecordedFile,
    channel_map: ChannelMap, needs: Needs,
) -> None:  # fmt: skip
    """Add channels that are neither needed nor mapped, by their own names."""
    found, channels = result.channels, channel_map.channels
    used = {name for name, _ in found.values()}
    forms = [[(name, channel_map.channel(name).unit) for part in group for name in part]
             for group in needs]  # fmt: skip
    otherwise = {  # a map that gives phases gives no equivalent current
        name
        for form in forms for name, unit in form
        if unit in (other for key, other in form if key in found)
    }  # fmt: skip
    otherwise |= with_derived(channels, found)
    added = []
    for column, (name, *others) in by_name.items():
        if column in otherwise or used & {name, *others}:
            continue
        stated, why = file.stated_unit(name), ""
        if others:
            why = f"{file.given.name} has several channels for it, {first_names([name, *others])}"
        elif stated and not units.fits(stated, channel_map.channel(column).unit):
            why = f"{name} is in {stated}"
        if why:
            result.warnings.append(f"{column} was left out: {why}. Map it where it is needed.")
        else:
            found[column] = (name, MappedChannel(channel=name))
            added.append(column)
    if added:
        said = f"beside the map, these were found by their names: {', '.join(added)}"
        result.assumed.append(said)


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
        wanted = [channel_map.channel(name) for name in missing]
        for name in file.names:  # refused for its unit, such as error_kg for a position error
            for stem, unit in units.suffixes(units.bare(last_part(name))):
                channel = channel_called(stem, wanted)
                if channel is not None and len(unit) > 1 and units.is_unit(unit):
                    what = f"{channel.name} (channel {name!r} of {file.path})"
                    units.unit_factor(unit, channel.unit, what)
        meaning = f" ({wanted[0].meaning})" if len(group) == 1 == len(group[0]) else ""
        raise MissingChannelError(
            f"{file.path} has no channel for {', nor for '.join(map(listed, group))}{meaning}; "
            f"it has {first_names(file.names)}. Map it, such as {wanted[0].name}="
            f'"{_likely(file, wanted[0])}".'
        )


def _likely(file: RecordedFile, channel: Channel) -> str:
    """The channel of a file for which words speak most, for messages; an example if none do."""
    best, likely = UNIT_ONLY, f"Channel 1 [{units.example(channel.unit)}]"
    for name in file.names:
        one = Surveyed(name, *unit_and_stem(file, name))
        if not one.unit or units.fits(one.unit, channel.unit):
            score, _ = _by_words(one, channel) or (0.0, "")
            best, likely = (score, name) if score > best else (best, likely)
    return likely


def named(name: str, channels: Sequence[Channel], names: Collection[str]) -> tuple[str, float]:
    """The channel whose name or alias this is, with or without a unit, and the score; "" if none.

    ``names`` are of all channels of the file.
    """
    texts = dict.fromkeys((units.bare(last_part(name)), units.bare(name)))
    for text in texts:
        channel = channel_called(text, channels)
        if channel is not None:
            return channel.name, OWN_NAME if name == channel.name else ALIAS
    for text in texts:
        for stem, unit in units.suffixes(text, names):
            channel = channel_called(stem, channels)
            if channel is not None and units.fits(unit, channel.unit):
                return channel.name, BEFORE_A_UNIT
    stems = (
        stem for text in texts for stem in (text, units.unit_in_name(text, TIME.unit, names)[0])
    )
    return (TIME.name, A_CLOCK) if any(plain(stem) in _CLOCKS for stem in stems) else ("", 0.0)


def candidates(
    channel: Channel, surveyed: Sequence[Surveyed], channels: Sequence[Channel]
) -> list[Candidate]:
    """The channels of a file that may be ``channel``, the likeliest first."""
    names = [one.name for one in surveyed]
    found = []
    for one in surveyed:
        if one.is_text or not one.samples or (one.unit and not units.fits(one.unit, channel.unit)):
            continue
        own, score = named(one.name, channels, names)
        is_own = score == OWN_NAME
        if own == channel.name:
            said = "it has that name" if is_own else "its name is one that files use for it"
            found.append(Candidate(one.name, score, said))
        elif not own and (by_words := _by_words(one, channel)):
            found.append(Candidate(one.name, *by_words))
    return sorted(found, key=lambda one: -one.score)


def _by_words(one: Surveyed, channel: Channel) -> tuple[float, str] | None:
    """How strongly the words and the unit of a name speak for a channel, and why."""
    text = one.stem
    said, wanted = said_by(text), _wanted(channel)
    if said.other or said.phase != wanted.phase:
        return None
    if channel.unit == "V" and not said.quantities and one.unit:
        most = max(abs(one.low), abs(one.high)) * units.unit_factor(
            one.unit, channel.unit, one.name
        )
        if most < 1.0:
            return None  # V: more likely what a probe makes of a current
    found = _by_quantity(said, wanted, _DIMENSIONS.get(channel.unit, "") if one.unit else "", text)
    if found is None:
        return None
    if wanted.quantities & {"command", "load"} or not wanted.place:
        # they are held on one shaft; a name that names the other shaft means something else
        elsewhere = said.place and said.place not in (wanted.place, channel.side or said.place)
        return None if elsewhere or said.place == "bus" else found
    if said.place == wanted.place:
        return found
    if said.place or wanted.place == "bus":
        return None
    return min(found[0], NAMED), f"{found[1]}, but not of which shaft"


def _by_quantity(said: Said, wanted: Said, dimension: str, text: str) -> tuple[float, str] | None:
    """How well the quantities of two names agree; ``dimension`` is of the unit, or ""."""
    words, goal = set(said.quantities), set(wanted.quantities)
    if "command" in goal:
        # a set point of the position may say so; one of anything else is another channel
        if "command" not in words or words - {"command", "position"}:
            return None
        return IN_WORDS, f"“{text}” is a word for what is commanded"
    if not goal or "command" in words or ("error" in words) != ("error" in goal):
        return None
    words -= {"position"} if "error" in goal else set()
    quantity = next(iter(goal))
    if quantity == "load" and words - {"load", "torque"}:
        return None
    if quantity == "load" and words == {"torque"}:
        return UNIT_ONLY, f"“{text}” may be the motor's own torque as well"
    if quantity in words:
        # a name that holds two quantities, such as "motor torque current", says less
        clear = not (words - goal - {"position", "load", "torque"})
        return (IN_WORDS if clear else NAMED), f"“{text}” is a word for a {quantity}"
    if words or dimension != quantity:
        return None
    for part, what in ((said.phase, "phase"), (said.place, "place")):
        if part:
            return IN_WORDS, f"“{text}” names the {what} and its unit is that of a {quantity}"
    return UNIT_ONLY, f"its unit is that of a {quantity}, and nothing else speaks for it"


def _wanted(channel: Channel) -> Said:
    """The words of a name that means this channel."""
    said = said_by(channel.name)
    quantities = set(said.quantities)
    for whole in ("command", "error"):
        if whole in quantities:
            quantities = {whole}
    place = said.place
    if quantities & {"command", "load"}:
        place = channel.side or ""
    elif quantities & {"position", "speed"}:
        place = place or channel.side or ""
    return Said(frozenset(quantities), place, said.phase)
