"""A proposed channel map: which channel of a file is which, why, and open questions.

Nothing is chosen silently. Two channels that are equally likely, or a unit that nobody states and
that several would fit, become questions, and stand in the map as comments.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import tomli_w

from ematwin.recordings.channel import Channel, with_time
from ematwin.recordings.matching import (
    IN_WORDS,
    NAMED,
    Candidate,
    Needs,
    candidates,
    unmet,
)
from ematwin.recordings.survey import Survey, Surveyed
from ematwin.recordings.units import unit_factor
from ematwin.showing import markup
from ematwin.showing.frames import frame_of_rows

HEADINGS = ("taken for", "channel", "unit", "because")
_ALIKE = 0.5  # difference of scores up to which two channels are equally likely
_SAME_SHAFT, _OTHER_SHAFT = (0.5, 2.0), 5.0  # span over that of the command


@dataclass(frozen=True)
class Entry:
    """One line of a proposed map.

    Attributes
    ----------
    column : channel of the recording
    channel : name in the file
    unit : of the file's numbers; "" where nobody states one and it is left open
    unit_from : "file", "name", "plausibility"; "channel" of a ratio, which has no unit; or ""
    reasons : sentences
    units : the units that are left, where ``unit`` is open
    """

    column: str
    channel: str
    unit: str
    unit_from: str
    reasons: tuple[str, ...]
    units: tuple[str, ...] = ()

    @property
    def is_open(self) -> bool:
        """Whether its unit is left to the user."""
        return not self.unit_from

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "channel": self.channel,
            "unit": self.unit or None,
            "unit_from": self.unit_from or None,
            "reasons": list(self.reasons),
            **({"units": list(self.units)} if self.is_open else {}),
        }


@dataclass(frozen=True)
class Question:
    """A choice that the file leaves open.

    Attributes
    ----------
    sentence : the question, and how to answer it
    lines : lines of the map to choose from
    needed : whether there is no recording without an answer
    """

    sentence: str
    lines: tuple[str, ...] = ()
    needed: bool = False


@dataclass(frozen=True)
class Proposal:
    """A proposed map.

    Attributes
    ----------
    kind : of actuator
    entries : by channel of the recording
    questions : open ones
    unused : names of the channels of the file that are not used
    check : doubts about a recording read with this map, or why it is refused
    refused : whether a recording read with this map would be refused
    """

    kind: str
    entries: Mapping[str, Entry]
    questions: tuple[Question, ...] = ()
    unused: tuple[str, ...] = ()
    check: tuple[str, ...] = ()
    refused: bool = False

    @property
    def is_complete(self) -> bool:
        """Whether a recording can be read with it as it stands."""
        return not self.refused and not any(one.needed for one in self.questions)

    @property
    def sentence(self) -> str:
        """Whether it is complete."""
        state = "is complete" if self.is_complete else "needs an answer to what is open"
        return f"The map for the kind {self.kind} {state}."

    @property
    def rows(self) -> list[list[str]]:
        """Cells for people, below `HEADINGS`."""
        return [
            [name, one.channel, one.unit or f"{' or '.join(one.units)}?", " ".join(one.reasons)]
            for name, one in self.entries.items()
        ]

    def columns(self) -> dict[str, dict[str, Any]]:
        """The settled part of the map, as `ematwin.read` takes it."""
        return {
            name: _values(entry.channel, entry.unit)
            for name, entry in self.entries.items()
            if not entry.is_open
        }

    def as_toml(self) -> str:
        """The map as a file, with the reasons as comments; open lines are commented out."""
        lines = [
            f"# Channels of a recording of the kind {self.kind}, proposed by ematwin channels."
        ]
        if self.questions:
            lines.append("# What is open stands below: remove the # of the line that is right.")
        lines += ["", "[columns]"]
        for name, entry in self.entries.items():
            lines += [f"# {sentence}" for sentence in entry.reasons]
            if entry.is_open:
                lines += [f"# {_line(name, entry.channel, unit)}" for unit in entry.units]
            else:
                lines.append(_line(name, entry.channel, entry.unit))
        for question in self.questions:
            if question.lines:
                lines += ["", f"# {question.sentence}"]
                lines += [f"# {line}" for line in question.lines]
        return "\n".join(lines) + "\n"

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each channel of the map; needs pandas."""
        return frame_of_rows(
            (
                {"column": name, "channel": one.channel, "unit": one.unit or None,
                 "unit_from": one.unit_from or None, "because": " ".join(one.reasons)}
                for name, one in self.entries.items()
            ),
            "column",
        )  # fmt: skip

    to_dataframe = to_frame

    def _repr_html_(self) -> str:
        """Whether it is complete, then the map and open questions, in a notebook."""
        return "".join(
            [
                markup.verdict(self.sentence, "healthy" if self.is_complete else "changed"),
                markup.table(HEADINGS, self.rows),
                *(markup.note(f"Open: {one.sentence}") for one in self.questions),
                *(markup.note(f"Warning: {text}") for text in self.check),
            ]
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "kind": self.kind,
            "columns": {name: entry.as_dict() for name, entry in self.entries.items()},
            "questions": [one.sentence for one in self.questions],
            "unused": list(self.unused),
            "check": list(self.check),
            "complete": self.is_complete,
        }


def _values(channel: str, unit: str) -> dict[str, str]:
    return {"channel": channel, **({"unit": unit} if unit else {})}


def _line(name: str, channel: str, unit: str) -> str:
    """``command = { channel = "Setpoint", unit = "deg" }``."""
    values = _values(channel, unit)
    inside = ", ".join(tomli_w.dumps({key: value}).strip() for key, value in values.items())
    return f"{name} = {{ {inside} }}"


def _lines(name: str, channels: Iterable[Surveyed]) -> tuple[str, ...]:
    return tuple(_line(name, one.name, one.unit) for one in channels)


def propose(
    found: Survey, channels: Sequence[Channel], needs: Needs, kind: str, command: str
) -> Proposal:
    """Make a map from names, stated units and the values of the channels.

    Units that are not stated stay open (`ematwin.models.proposing` settles some).

    Parameters
    ----------
    found : Survey
    channels : of the kind of actuator
    needs : groups of channels; of each group at least one whole alternative must be there
    kind : of actuator
    command : name of the channel that is commanded
    """
    names = [one.name for one in found.channels]
    known = {one.name: one for one in with_time(channels)}
    ranked = {
        name: candidates(one, found.channels, tuple(known.values()), names)
        for name, one in known.items()
    }
    if found.has_times:
        ranked["time"] = []
    questions: list[Question] = []
    chosen = _chosen(ranked, found, known, command, questions)
    taken = {one.name for one in chosen.values()}
    entries = {}
    for name, one in chosen.items():
        also = [c for c in ranked[name] if c.score >= IN_WORDS and c.name not in taken]
        entries[name] = _entry(known[name], found[one.name], one, also)
    questions += _missing(needs, channels, entries, ranked, questions, found)
    unused = tuple(name for name in names if name not in taken)
    return Proposal(kind, entries, tuple(questions), unused)


def _chosen(
    ranked: Mapping[str, list[Candidate]],
    found: Survey,
    channels: Mapping[str, Channel],
    command: str,
    questions: list[Question],
) -> dict[str, Candidate]:
    """The channels that are clear; those that are not are added to the questions."""
    wanted: dict[str, list[str]] = {}  # channel of the file -> what it may be, equally well
    for name, all_of in ranked.items():
        if not all_of or all_of[0].score < NAMED:
            if all_of and channels[name].unit == "N*m":
                listed = " or ".join(f"“{one.name}”" for one in all_of)
                said = f"{listed} may be the {name}, or the motor's own torque: the name does not "
                lines = _lines(name, (found[one.name] for one in all_of))
                questions.append(Question(f"{said}tell which.", lines))
            continue
        best = [one for one in all_of if one.score >= all_of[0].score - _ALIKE]
        if len(best) > 1:
            listed = " and ".join(f"“{one.name}”" for one in best[:4])
            more = f" and {len(best) - 4} more" if len(best) > 4 else ""
            questions.append(
                Question(
                    f"{listed}{more} are equally likely to be {name}: neither name nor unit tells "
                    "which.",
                    _lines(name, (found[one.name] for one in best)),
                )
            )
        else:
            wanted.setdefault(best[0].name, []).append(name)
    for file_name, may_be in wanted.items():
        top = max(ranked[name][0].score for name in may_be)
        wanted[file_name] = [name for name in may_be if ranked[name][0].score >= top - _ALIKE]
    chosen = {one[0]: ranked[one[0]][0] for one in wanted.values() if len(one) == 1}
    for file_name, may_be in wanted.items():
        if len(may_be) == 1:
            continue
        free = [name for name in may_be if name not in chosen]
        beside = chosen.get(command)
        shaft = beside and _by_span(
            found[file_name], free, channels, found[beside.name], channels[command]
        )
        if shaft:
            name, reason = shaft
            chosen[name] = replace(ranked[name][0], reason=reason, score=IN_WORDS)
            continue
        questions.append(
            Question(
                f"“{file_name}” is equally likely to be {' or '.join(may_be)}: its name does not "
                "tell which.",
                tuple(line for name in may_be for line in _lines(name, [found[file_name]])),
            )
        )
    return {name: chosen[name] for name in ranked if name in chosen}


def _by_span(
    one: Surveyed,
    wanted: Sequence[str],
    channels: Mapping[str, Channel],
    beside: Surveyed,
    command: Channel,
) -> tuple[str, str] | None:
    """Which shaft an angle is of, by how far it moves beside the command; None: not clear."""
    if not (one.unit and beside.unit and wanted and command.side is not None):
        return None
    if channels[wanted[0]].unit != command.unit:
        return None
    span, commanded = (
        (each.high - each.low) * unit_factor(each.unit, command.unit, each.name)
        for each in (one, beside)
    )
    if not (span > 0.0 and commanded > 0.0):
        return None
    ratio = span / commanded
    same = [name for name in wanted if channels[name].side == command.side]
    others = [name for name in wanted if channels[name].side not in (command.side, None)]
    if _SAME_SHAFT[0] < ratio < _SAME_SHAFT[1] and len(same) == 1:
        return same[0], (
            f"it moves {ratio:.2g} times as far as the command, so it is of the same shaft"
        )
    if ratio > _OTHER_SHAFT and len(others) == 1:
        return others[0], (
            f"it moves {ratio:.3g} times as far as the command, so it is of the other shaft"
        )
    return None


def _entry(
    channel: Channel, one: Surveyed, candidate: Candidate, also: Sequence[Candidate]
) -> Entry:
    reasons = [f"{channel.meaning[:1].upper()}{channel.meaning[1:]}: {candidate.reason}."]
    if also:
        listed = " and ".join(f"“{other.name}”" for other in also)
        reasons.append(f"By its words {listed} would do as well, but less plainly: check it.")
    if one.unit:
        where = "the file" if one.unit_from == "file" else "its name"
        reasons.append(f"The unit, {one.unit}, is stated by {where}.")
    if one.missing:
        reasons.append(f"{one.missing} of its {one.samples} samples are missing.")
    if one.is_constant and channel.name != "load":
        reasons.append(f"It is {one.low:g} throughout.")
    if channel.name == "load":
        reasons.append(
            "Its sign cannot be told: where it is positive with positive motion, add sign = -1."
        )
    unit_from = one.unit_from or ("" if channel.unit else "channel")  # a ratio has none
    return Entry(channel.name, one.name, one.unit, unit_from, tuple(reasons))


def _missing(
    needs: Needs,
    channels: Sequence[Channel],
    entries: Mapping[str, Entry],
    ranked: Mapping[str, list[Candidate]],
    asked: Sequence[Question],
    found: Survey,
) -> list[Question]:
    """Questions on needed channels for which there is no name."""
    questions = []
    for group, wanted in unmet(needs, channels, entries):
        lines = [
            line for name in wanted for line in _lines(name, (found[c.name] for c in ranked[name]))
        ]
        alternatives = " or ".join(" with ".join(part) for part in group)
        lead = f"Needed and not found for certain: {alternatives}; "
        starts = tuple(f"{name} =" for name in wanted)
        if any(line.startswith(starts) for one in asked for line in one.lines):
            questions.append(Question(f"{lead}see above", needed=True))
        else:
            where = f"name it in the map.{' These have the right unit.' if lines else ''}"
            questions.append(Question(lead + where, tuple(dict.fromkeys(lines)), needed=True))
    if not ranked.get("time", [()]) and not found.has_times:
        questions.append(
            Question(
                "No channel looks like time: name it in the map, or give the rate.",
                ('sample_rate = "20 kHz"',),
                needed=True,
            )
        )
    return questions


def rate_of(found: Survey, entry: Entry | None) -> float | None:
    """Samples per second that a proposed time channel gives, Hz; None where it is not known."""
    if entry is None or entry.is_open:
        return None
    one = found[entry.channel]
    span = unit_factor(entry.unit, "s", entry.channel) * (one.high - one.low)
    rate = (one.samples - 1) / span if span > 0.0 else math.nan
    return rate if np.isfinite(rate) else None
