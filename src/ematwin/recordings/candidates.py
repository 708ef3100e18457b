"""How well a channel of a file fits a channel of a recording, by its name and unit, and why."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from ematwin.errors import RecordError
from ematwin.recordings.channel import Channel
from ematwin.recordings.formats.base import last_part
from ematwin.recordings.match import meant
from ematwin.recordings.survey import Surveyed
from ematwin.recordings.units import bare, endings, unit_factor
from ematwin.recordings.words import Said, said_by

# How strongly a name speaks for a channel. Below `NAMED` it is worth a mention and no more.
OWN_NAME, IN_WORDS, NAMED, UNIT_ONLY = 4.0, 3.0, 2.0, 1.0
_DIMENSIONS = {"s": "time", "A": "current", "V": "voltage", "rad/s": "speed", "m/s": "speed",
               "rad": "position", "m": "position", "N*m": "load"}  # fmt: skip
_PROBE = 1.0  # V: less is no voltage of a motor
_WITH_PLACE = ("position", "speed")  # what both shafts have


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
        if one.is_text or not one.samples:
            continue
        if fits(one.unit, channel) is False:
            continue
        score, reason = _fit(one, channel, channels, names)
        if score > 0.0:
            found.append(Candidate(one.name, score, reason))
    return sorted(found, key=lambda one: -one.score)


def fits(unit: str, channel: Channel) -> bool | None:
    """Whether a unit is of the kind of a channel; None where there is no unit."""
    if not unit:
        return None
    try:
        unit_factor(unit, channel.unit, channel.name)
    except RecordError:
        return False
    return True


def _fit(
    one: Surveyed, channel: Channel, channels: Sequence[Channel], names: Collection[str]
) -> tuple[float, str]:
    own, rank = meant(one.name, channels, names)
    if own is not None and own.name == channel.name:
        what = "it has that name" if rank == 0 else "its name is one that files use for it"
        return OWN_NAME, what
    if own is not None:
        return 0.0, ""
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
    if "command" in wanted.quantities or "load" in wanted.quantities or not wanted.place:
        # they are held on one shaft; a name that names the other shaft means something else
        if said.place and said.place not in (wanted.place, channel.side or said.place):
            return 0.0, ""
        if said.place == "bus":
            return 0.0, ""
    elif said.place != wanted.place:
        if said.place or wanted.place == "bus":
            return 0.0, ""
        return min(score, NAMED), f"{because}, but not of which shaft"
    return score, because


def _by_quantity(said: Said, wanted: Said, dimension: str, text: str) -> tuple[float, str]:
    """How well the quantities of two names agree; ``dimension`` is what the unit says, or ""."""
    told = set(said.quantities)
    goal = set(wanted.quantities)
    if "command" in goal:
        # a set point of the position may say so; one of anything else is another channel
        if "command" not in told or told - {"command", "position"}:
            return 0.0, ""
        return IN_WORDS, f"“{text}” is a word for what is commanded"
    if not goal or "command" in told or ("error" in told) != ("error" in goal):
        return 0.0, ""
    told -= {"position"} if "error" in goal else set()
    quantity = next(iter(goal))
    if quantity == "load" and told - {"load", "torque"}:
        return 0.0, ""
    if quantity == "load" and told == {"torque"}:
        return UNIT_ONLY, f"“{text}” may be the motor's own torque as well"
    if quantity in told:
        # a name that holds two quantities, such as "motor torque current", says less
        clear = not (told - goal - {"position", "load", "torque"})
        return (IN_WORDS if clear else NAMED), f"“{text}” is a word for a {quantity}"
    if told:
        return 0.0, ""
    if not dimension or dimension != quantity:
        return 0.0, ""
    if said.phase:
        return IN_WORDS, f"“{text}” names the phase and its unit is that of a {quantity}"
    if said.place:
        return IN_WORDS, f"“{text}” names the place and its unit is that of a {quantity}"
    return UNIT_ONLY, f"its unit is that of a {quantity}, and nothing else speaks for it"


def _largest(one: Surveyed, channel: Channel) -> float:
    """Largest magnitude, SI; infinite where no unit is stated."""
    if not one.unit:
        return math.inf
    return max(abs(one.low), abs(one.high)) * unit_factor(one.unit, channel.unit, one.name)


def _wanted(channel: Channel) -> Said:
    """What a name would say that means this channel."""
    said = said_by(channel.name)
    quantities = set(said.quantities)
    for whole in ("command", "error"):
        if whole in quantities:
            quantities = {whole}
    place = said.place or (channel.side or "" if quantities & set(_WITH_PLACE) else "")
    if quantities & {"command", "load"}:
        place = channel.side or ""
    return Said(frozenset(quantities), place, said.phase)


def _without_unit(one: Surveyed) -> str:
    text = bare(last_part(one.name))
    if one.unit_from != "name":
        return text
    return next((stem for stem, unit in endings(text) if unit == one.unit), text)
