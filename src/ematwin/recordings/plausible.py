"""Units that nobody states, by what is plausible: each is tried, and what remains is told.

A unit is ruled out if the numbers would be of a size that no actuator has, or if the kind's own
check of the recording refuses it. Where several remain, the question stays open.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from itertools import product

from ematwin.errors import EmatwinError
from ematwin.recordings.channel import Channel
from ematwin.recordings.proposal import Entry, Proposal, Question
from ematwin.recordings.recording import Recording
from ematwin.recordings.survey import Survey, Surveyed
from ematwin.recordings.units import unit_factor

Check = Callable[[Recording], list[str]]
_MOST_TRIES = 96  # combinations of units
# Units met on test benches, the likeliest first.
_UNITS = {
    "s": ("s", "ms", "us"), "A": ("A", "mA"), "V": ("V", "mV"), "rad": ("rad", "deg"),
    "rad/s": ("rad/s", "rpm", "deg/s"), "m": ("m", "mm", "um"), "N*m": ("N*m", "mN*m"),
    "m/s": ("m/s", "mm/s"),
}  # fmt: skip
# Sizes that test benches of such actuators meet, SI: of the sampling interval for time, of the
# largest magnitude else. Wide, so that they rule out only what is absurd.
_SIZES = {
    "s": (1e-6, 0.05), "A": (0.02, 2e3), "V": (0.1, 2e3), "rad": (2e-3, 1e5),
    "rad/s": (0.02, 1e4), "m": (2e-5, 10.0), "N*m": (0.02, 1e5), "m/s": (1e-5, 20.0),
}  # fmt: skip


def settled(
    proposal: Proposal,
    found: Survey,
    channels: Mapping[str, Channel],
    recording: Recording | None,
    check: Check,
    needed: Collection[str] = (),
) -> Proposal:
    """The proposal with units that plausibility tells, and questions on those that it does not.

    Parameters
    ----------
    proposal : Proposal, with open units
    channels : by name, time among them
    recording : read with SI in place of what is open; None where it cannot be read
    check : of the kind: sentences on a recording; raises `RecordError` if it cannot be what it says
    needed : names of the channels without which there is no recording
    """
    open_ones = [name for name, entry in proposal.entries.items() if entry.is_open]
    left = {name: _of_size(found[proposal.entries[name].channel], channels[name])
            for name in open_ones}  # fmt: skip
    refusals: dict[tuple[str, str], str] = {}
    if recording is not None:
        left = _unrefused(left, recording, channels, check, refusals)
    entries = dict(proposal.entries)
    questions = list(proposal.questions)
    for name in open_ones:
        entries[name] = _closed(entries[name], found, channels[name], left[name], refusals)
        if entries[name].is_open:
            several = " or ".join(entries[name].units)
            questions.append(
                Question(
                    f"The unit of “{entries[name].channel}” ({name}) is stated nowhere, and "
                    f"{several} are equally plausible.",
                    needed=name in needed or name == "time",
                )
            )
    return replace(proposal, entries=entries, questions=tuple(questions))


def _of_size(one: Surveyed, channel: Channel) -> list[str]:
    """The units with which a channel has a usual size; all of them if none does."""
    units = _UNITS.get(channel.unit, (channel.unit,))
    size = _size(one, channel)
    low, high = _SIZES.get(channel.unit, (0.0, math.inf))
    usual = [
        unit for unit in units if low <= size * unit_factor(unit, channel.unit, one.name) <= high
    ]
    return usual or list(units)


def _size(one: Surveyed, channel: Channel) -> float:
    """The largest magnitude of a channel; the sampling interval of time."""
    if channel.name == "time":
        return (one.high - one.low) / max(one.samples - 1, 1)
    return max(abs(one.low), abs(one.high))


def _unrefused(
    left: Mapping[str, list[str]],
    recording: Recording,
    channels: Mapping[str, Channel],
    check: Check,
    refusals: dict[tuple[str, str], str],
) -> dict[str, list[str]]:
    """The units that some combination keeps which the kind does not refuse."""
    tried = 0
    kept: dict[str, set[str]] = {name: set() for name in left}
    for combination in _combinations(left):
        tried += 1
        if tried > _MOST_TRIES:
            return dict(left)
        try:
            check(_in_units(recording, combination, channels))
        except EmatwinError as error:
            for pair in combination.items():
                refusals.setdefault(pair, str(error))
            continue
        for name, unit in combination.items():
            kept[name].add(unit)
    if not any(kept.values()):
        return dict(left)  # it is refused for another reason
    return {name: [unit for unit in units if unit in kept[name]] for name, units in left.items()}


def _combinations(left: Mapping[str, list[str]]) -> Iterator[dict[str, str]]:
    """Every choice of units, with one unit for the channels of a series such as three phases."""
    groups: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for name, units in left.items():
        stem = name[:-2] if name[-2:] in ("_a", "_b", "_c", "_d", "_q") else name
        groups.setdefault((stem, tuple(units)), []).append(name)
    for choice in product(*(key[1] for key in groups)):
        yield {
            name: unit
            for members, unit in zip(groups.values(), choice, strict=True)
            for name in members
        }


def _in_units(
    recording: Recording, units: Mapping[str, str], channels: Mapping[str, Channel]
) -> Recording:
    """A recording whose numbers were taken for SI, taken for other units."""
    scaled = {}
    for name, unit in units.items():
        values = recording.time if name == "time" else recording.channels.get(name)
        if values is not None:
            scaled[name] = values * unit_factor(unit, channels[name].unit, name)
    for name, account in recording.provenance.get("columns", {}).items():
        derived = channels[name].derived
        if "derived" in account and derived is not None:
            sources = (scaled.get(one, recording.channels[one]) for one in derived.sources)
            scaled[name] = derived.compute(*sources)
    return recording.changed(**scaled)


def _closed(
    entry: Entry,
    found: Survey,
    channel: Channel,
    units: list[str],
    refusals: Mapping[tuple[str, str], str],
) -> Entry:
    """The entry with its unit, where one is left, and why."""
    one = found[entry.channel]
    if one.low == 0.0 == one.high:
        reason = "No unit is stated; it is zero throughout, so none matters."
        return replace(entry, unit=channel.unit, unit_from="plausibility",
                       reasons=(*entry.reasons, reason))  # fmt: skip
    if len(units) != 1:
        return replace(entry, units=tuple(units))
    unit = units[0]
    size = _size(one, channel)
    others = [other for other in _UNITS.get(channel.unit, ()) if other != unit]
    because = next(
        (refusals[entry.column, other] for other in others if (entry.column, other) in refusals),
        "",
    )
    taken = f"No unit is stated; {unit} was taken ({_as_si(size, unit, channel)})"
    if because:
        reason = f"{taken}: another would be refused, because “{_first_sentence(because)}”."
    else:
        told = " and ".join(f"in {other} {_as_si(size, other, channel)}" for other in others)
        reason = f"{taken}: it would be {told}, which is not usual."
    return replace(entry, unit=unit, unit_from="plausibility", reasons=(*entry.reasons, reason))


def _as_si(size: float, unit: str, channel: Channel) -> str:
    number = f"{size * unit_factor(unit, channel.unit, channel.name):.4g} {channel.unit}"
    return f"a sample every {number}" if channel.name == "time" else f"up to {number}"


def _first_sentence(text: str) -> str:
    head, mark, _ = text.partition(". ")
    return head.rstrip(".") if mark else text.rstrip(".")
