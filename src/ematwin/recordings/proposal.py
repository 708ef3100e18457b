"""Proposal: a channel map with the reasons for each channel, and the questions that are open.

Nothing is chosen silently: two channels that are equally likely become a question, which stands in
the map as comments. `ematwin.models.proposing` finds units that nobody states.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import tomli_w

from ematwin.recordings.channel import Channel, with_time
from ematwin.recordings.collect import Needs, unmet
from ematwin.recordings.survey import Candidate, Survey, Surveyed, candidates
from ematwin.recordings.words import IN_WORDS, NAMED, fits, named, unit_factor
from ematwin.showing.results import frame, html
from ematwin.showing.text import capital

HEADINGS = ("taken for", "channel", "unit", "because")


@dataclass(frozen=True)
class Entry:
    """One line of a proposed map."""

    column: str  # channel of the recording
    channel: str  # name in the file
    unit: str  # of the file's numbers; "" where nobody states one and it is left open
    unit_from: str  # "file", "name", "plausibility"; "channel" of a ratio, which has no unit; or ""
    reasons: tuple[str, ...]  # sentences
    units: tuple[str, ...] = ()  # the units that are left, where ``unit`` is open

    @property
    def is_open(self) -> bool:
        """Whether its unit is left to the user."""
        return not self.unit_from

    @property
    def lines(self) -> tuple[str, ...]:
        """``command = { channel = "Setpoint", unit = "deg" }``, for each unit that is left."""
        return tuple(_line(self.column, self.channel, one) for one in self.units or (self.unit,))

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "channel": self.channel, "unit": self.unit or None,
            "unit_from": self.unit_from or None, "reasons": list(self.reasons),
            **({"units": list(self.units)} if self.is_open else {}),
        }  # fmt: skip


@dataclass(frozen=True)
class Question:
    """A choice that the file leaves open."""

    sentence: str  # the question, and how to answer it
    lines: tuple[str, ...] = ()  # lines of the map to choose from
    needed: bool = False  # whether there is no recording without an answer


@dataclass(frozen=True)
class Proposal:
    """A proposed map."""

    kind: str  # of actuator
    entries: Mapping[str, Entry]  # by channel of the recording
    questions: tuple[Question, ...] = ()  # open ones
    unused: tuple[str, ...] = ()  # names of the channels of the file that are not used
    check: tuple[str, ...] = ()  # doubts about a recording read with this map, or why it is refused
    refused: bool = False  # whether a recording read with this map would be refused
    # samples per second that its channel of time gives, Hz; None where there is none
    rate: float | None = None

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
        units = (one.unit or f"{' or '.join(one.units)}?" for one in self.entries.values())
        told = zip(self.entries.items(), units, strict=True)
        return [[name, one.channel, unit, " ".join(one.reasons)] for (name, one), unit in told]

    def columns(self) -> dict[str, dict[str, Any]]:
        """The settled part of the map, as `ematwin.read` takes it."""
        settled = {name: one for name, one in self.entries.items() if not one.is_open}
        return {name: values(one.channel, one.unit) for name, one in settled.items()}

    def as_toml(self) -> str:
        """The map as a file, with the reasons as comments; open lines are commented out."""
        text = [f"# Channels of a recording of the kind {self.kind}, proposed by ematwin channels."]
        if self.questions:
            text.append("# What is open stands below: remove the # of the line that is right.")
        text += ["", "[columns]"]
        for entry in self.entries.values():
            text += [f"# {sentence}" for sentence in entry.reasons]
            text += [f"# {line}" if entry.is_open else line for line in entry.lines]
        for question in (one for one in self.questions if one.lines):
            text += ["", *(f"# {line}" for line in (question.sentence, *question.lines))]
        return "\n".join(text) + "\n"

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each channel of the map; needs pandas."""
        rows = (
            {"column": name, "channel": one.channel, "unit": one.unit or None,
             "unit_from": one.unit_from or None, "because": " ".join(one.reasons)}
            for name, one in self.entries.items()
        )  # fmt: skip
        return frame(rows, "column")

    to_dataframe = to_frame

    def _repr_html_(self) -> str:
        """Whether it is complete, then the map and open questions, in a notebook."""
        notes = [f"Open: {one.sentence}" for one in self.questions]
        notes += [f"Warning: {text}" for text in self.check]
        grade = "healthy" if self.is_complete else "changed"
        return html(self.sentence, HEADINGS, self.rows, notes, grade=grade)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "kind": self.kind, "complete": self.is_complete,
            "columns": {name: entry.as_dict() for name, entry in self.entries.items()},
            "questions": [one.sentence for one in self.questions],
            "unused": list(self.unused), "check": list(self.check),
        }  # fmt: skip


def values(channel: str, unit: str) -> dict[str, str]:
    """An entry of a channel map; "" is no unit."""
    return {"channel": channel, **({"unit": unit} if unit else {})}


def _line(column: str, channel: str, unit: str) -> str:
    told = (tomli_w.dumps({key: one}).strip() for key, one in values(channel, unit).items())
    return f"{column} = {{ {', '.join(told)} }}"


class Draft:
    """A proposal in the making: which channels are clear, and which have to be asked for."""

    def __init__(
        self, found: Survey, channels: Sequence[Channel], needs: Needs, command: str
    ) -> None:
        self.found, self.needs, self.command = found, needs, command
        self.channels = {one.name: one for one in with_time(channels)}
        known = tuple(self.channels.values())
        self.ranked = {one.name: candidates(one, found.channels, known) for one in known}
        if found.has_times:
            self.ranked["time"] = []
        self.entries: dict[str, Entry] = {}
        self.questions: list[Question] = []
        self._assign()
        self._ask_of_wrong_units()
        self._ask_for_missing()

    def _assign(self) -> None:
        """Enter the channels that are clear; ask where two are equally likely."""
        may_be: dict[str, list[str]] = {}  # by channel of the file
        for column, ranked in self.ranked.items():
            best = [one.name for one in ranked if one.score == ranked[0].score]
            if not best:
                continue
            if ranked[0].score < NAMED:
                if self.channels[column].unit == "N*m":
                    listed = " or ".join(f"“{name}”" for name in best)
                    said = "or the motor's own torque: the name does not tell which."
                    self._ask(f"{listed} may be the {column}, {said}", [column], best)
            elif len(best) == 1:
                may_be.setdefault(best[0], []).append(column)
            else:
                listed = " and ".join(f"“{name}”" for name in best[:4])
                more = f" and {len(best) - 4} more" if len(best) > 4 else ""
                said = f"are equally likely to be {column}: neither name nor unit tells which."
                self._ask(f"{listed}{more} {said}", [column], best)
        for name, columns in may_be.items():
            top = max(self.ranked[column][0].score for column in columns)
            may_be[name] = [one for one in columns if self.ranked[one][0].score == top]
        chosen = {one[0]: self.ranked[one[0]][0] for one in may_be.values() if len(one) == 1}
        command = chosen.get(self.command)
        for name, columns in may_be.items():
            if len(columns) == 1:
                continue
            shaft = command and self._by_span(name, columns, self.found[command.name])
            if shaft:
                chosen[shaft[0]] = replace(self.ranked[shaft[0]][0], reason=shaft[1])
            else:
                said = f"{' or '.join(columns)}: its name does not tell which."
                self._ask(f"“{name}” is equally likely to be {said}", columns, [name])
        taken = {one.name for one in chosen.values()}
        for column in (name for name in self.ranked if name in chosen):
            plain = [one.name for one in self.ranked[column] if one.score >= IN_WORDS]
            also = [name for name in plain if name not in taken]
            self.entries[column] = self._entry(column, chosen[column], also)

    def _ask(self, sentence: str, columns: Sequence[str], names: Sequence[str]) -> None:
        units = {name: self.found[name].unit for name in names}
        lines = (_line(column, *one) for column in columns for one in units.items())
        self.questions.append(Question(sentence, tuple(lines)))

    def _ask_of_wrong_units(self) -> None:
        """Ask for the unit of what has the name of a channel, and a unit of another kind."""
        names = [one.name for one in self.found.channels]
        for one in self.found.channels:
            own, _ = named(one.name, tuple(self.channels.values()), names)
            if own and one.unit and not fits(one.unit, unit := self.channels[own].unit):
                said = f"“{one.name}” has the name of {own}, which is in {unit} and not in"
                advice = "correct the unit, or name another channel in the map."
                line = _line(own, one.name, unit)
                self.questions.append(Question(f"{said} {one.unit}: {advice}", (line,)))

    def _by_span(
        self, name: str, columns: Sequence[str], command: Surveyed
    ) -> tuple[str, str] | None:
        """Which shaft an angle is of, by how far it moves beside the command; None: not clear."""
        one, own = self.found[name], self.channels[self.command]
        is_known = one.unit and command.unit and own.side
        if not is_known or self.channels[columns[0]].unit != own.unit:
            return None
        span = (one.high - one.low) * unit_factor(one.unit, own.unit, one.name)
        factor = unit_factor(command.unit, own.unit, command.name)
        commanded = factor * (command.high - command.low)
        if not (span > 0.0 and commanded > 0.0):
            return None
        ratio, sides = span / commanded, {name: self.channels[name].side for name in columns}
        same = [name for name, side in sides.items() if side == own.side]
        others = [name for name, side in sides.items() if side not in (own.side, None)]
        said = f"it moves {ratio:.3g} times as far as the command, so it is of the"
        if 0.5 < ratio < 2.0 and len(same) == 1:
            return same[0], f"{said} same shaft"
        return (others[0], f"{said} other shaft") if ratio > 5.0 and len(others) == 1 else None

    def _entry(self, column: str, chosen: Candidate, also: Sequence[str]) -> Entry:
        channel, one = self.channels[column], self.found[chosen.name]
        reasons = [f"{capital(channel.meaning)}: {chosen.reason}."]
        if also:
            listed = " and ".join(f"“{name}”" for name in also)
            reasons.append(f"By its words {listed} would do as well, but less plainly: check it.")
        if one.unit:
            where = "the file" if one.unit_from == "file" else "its name"
            reasons.append(f"The unit, {one.unit}, is stated by {where}.")
        if one.missing:
            reasons.append(f"{one.missing} of its {one.samples} samples are missing.")
        if one.low == one.high and column != "load":
            reasons.append(f"It is {one.low:g} throughout.")
        if column == "load":
            advice = "where it is positive with positive motion, add sign = -1."
            reasons.append(f"Its sign cannot be told: {advice}")
        unit_from = one.unit_from or ("" if channel.unit else "channel")  # a ratio has none
        return Entry(column, one.name, one.unit, unit_from, tuple(reasons))

    def _ask_for_missing(self) -> None:
        """Ask for needed channels for which there is no name."""
        asked = [line for one in self.questions for line in one.lines]
        for group, wanted in unmet(self.needs, tuple(self.channels.values()), self.entries):
            choice = tuple(
                _line(name, one.name, self.found[one.name].unit)
                for name in wanted for one in self.ranked[name]
            )  # fmt: skip
            where = f"name it in the map.{' These have the right unit.' if choice else ''}"
            if any(line.startswith(tuple(f"{name} =" for name in wanted)) for line in asked):
                where, choice = "see above", ()
            alternatives = " or ".join(" with ".join(part) for part in group)
            lead = f"Needed and not found for certain: {alternatives}; "
            self.questions.append(Question(lead + where, choice, needed=True))
        if not self.ranked["time"] and not self.found.has_times:
            said = "No channel looks like time: name it in the map, or give the rate."
            self.questions.append(Question(said, ('sample_rate = "20 kHz"',), needed=True))
