"""A proposed channel map: which channel of a file is which, why, and what is open.

Nothing is chosen silently. Two channels that are equally likely, or a unit that nobody states and
that several would fit, become questions, and stand in the map as comments.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import tomli_w

from ematwin.recordings.candidates import IN_WORDS, NAMED, Candidate, candidates
from ematwin.recordings.channel import Channel, with_time
from ematwin.recordings.match import Needs, is_met, with_derived
from ematwin.recordings.survey import Survey, Surveyed
from ematwin.recordings.units import unit_factor
from ematwin.showing import markup
from ematwin.showing.frames import frame_of_rows

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
    units : the units that are left, where ``unit`` is open
    unit_from : "file", "name", "plausibility" or ""
    reasons : sentences
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
        return not self.unit

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
    """What the file does not tell.

    Attributes
    ----------
    sentence : what is open, and how to answer it
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
    questions : what is open
    unused : names of the channels of the file that are not used
    check : what reading the file with this map gave: what is doubtful, or why it is refused
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

    def columns(self) -> dict[str, dict[str, Any]]:
        """The map as `ematwin.read` takes it: what is settled."""
        return {
            name: _line_of(entry, entry.unit)
            for name, entry in self.entries.items()
            if not entry.is_open
        }

    def as_toml(self) -> str:
        """The map as a file, with the reasons as comments; what is open is commented out."""
        lines = [
            f"# Channels of a recording of the kind {self.kind}, proposed by ematwin channels."
        ]
        if self.questions:
            lines.append("# What is open stands below: remove the # of the line that is right.")
        lines += ["", "[columns]"]
        for name, entry in self.entries.items():
            lines += [f"# {sentence}" for sentence in entry.reasons]
            if entry.is_open:
                lines += [f"# {toml_line(name, _line_of(entry, unit))}" for unit in entry.units]
            else:
                lines.append(toml_line(name, _line_of(entry, entry.unit)))
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
        """Whether it is complete, then the map and what is open, in a notebook."""
        lead = f"The map for the kind {self.kind} is complete."
        if not self.is_complete:
            lead = f"The map for the kind {self.kind} needs an answer to what is open."
        rows = [
            (name, one.channel, one.unit or f"{' or '.join(one.units)}?", " ".join(one.reasons))
            for name, one in self.entries.items()
        ]
        return "".join(
            [
                markup.verdict(lead, "healthy" if self.is_complete else "changed"),
                markup.table(("taken for", "channel", "unit", "because"), rows),
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


def _line_of(entry: Entry, unit: str) -> dict[str, Any]:
    return {"channel": entry.channel, **({"unit": unit} if unit else {})}


def toml_line(name: str, values: Mapping[str, Any]) -> str:
    """``command = { channel = "Setpoint", unit = "deg" }``."""
    inside = ", ".join(tomli_w.dumps({key: value}).strip() for key, value in values.items())
    return f"{name} = {{ {inside} }}"


def propose(
    found: Survey, channels: Sequence[Channel], needs: Needs, kind: str, command: str
) -> Proposal:
    """A map by names, stated units, and what the channels themselves show.

    Units that nobody states stay open (`ematwin.recordings.plausible` closes what it can).

    Parameters
    ----------
    found : Survey
    channels : those of the kind of actuator
    needs : groups of channels; of each group at least one whole alternative must be there
    kind : of actuator
    command : name of the channel that is commanded
    """
    names = [one.name for one in found.channels]
    known = with_time(channels)
    ranked = {one.name: candidates(one, found.channels, known, names) for one in known}
    by_name = {one.name: one for one in known}
    if any(one.rate is not None for one in found.channels):
        ranked["time"] = []  # the format itself gives times
    chosen, questions = _chosen(ranked, found, by_name, command)
    taken = {one.name for one in chosen.values()}
    entries = {}
    for name, one in chosen.items():
        also = [c for c in ranked[name] if c.score >= IN_WORDS and c.name not in taken]
        entries[name] = _entry(by_name[name], found[one.name], one, also)
    questions += _missing(needs, channels, entries, ranked, questions, found)
    used = {entry.channel for entry in entries.values()}
    unused = tuple(name for name in names if name not in used)
    return Proposal(kind, entries, tuple(questions), unused)


def _chosen(
    ranked: Mapping[str, list[Candidate]],
    found: Survey,
    channels: Mapping[str, Channel],
    command: str,
) -> tuple[dict[str, Candidate], list[Question]]:
    """The channels that are clear, and questions on those that are not."""
    chosen: dict[str, Candidate] = {}
    questions: list[Question] = []
    rivals: dict[str, list[str]] = {}  # channel of the file -> what it may be, equally well
    for name, all_of in ranked.items():
        if not all_of or all_of[0].score < NAMED:
            if all_of and channels[name].unit == "N*m":
                questions.append(_torque(name, [found[one.name] for one in all_of]))
            continue
        best = [one for one in all_of if one.score >= all_of[0].score - _ALIKE]
        if len(best) > 1:
            listed = " and ".join(f"“{one.name}”" for one in best[:4])
            more = f" and {len(best) - 4} more" if len(best) > 4 else ""
            questions.append(
                Question(
                    f"{listed}{more} are equally likely to be {name}: neither name nor unit tells "
                    "which.",
                    tuple(
                        toml_line(name, _line(found[one.name])) for one in best
                    ),
                )
            )  # fmt: skip
            continue
        rivals.setdefault(best[0].name, []).append(name)
    for file_name, wanted in rivals.items():
        top = max(ranked[name][0].score for name in wanted)
        rivals[file_name] = [name for name in wanted if ranked[name][0].score >= top - _ALIKE]
    clear = [wanted[0] for wanted in rivals.values() if len(wanted) == 1]
    chosen |= {name: ranked[name][0] for name in clear}
    for file_name, wanted in rivals.items():
        if len(wanted) == 1:
            continue
        free = [name for name in wanted if name not in chosen]
        shaft = _by_span(found[file_name], free, channels, chosen.get(command), found, command)
        if shaft is not None:
            name, reason = shaft
            chosen[name] = replace(ranked[name][0], reason=reason, score=IN_WORDS)
            continue
        questions.append(
            Question(
                f"“{file_name}” is equally likely to be {' or '.join(wanted)}: its name does not "
                "tell which.",
                tuple(toml_line(name, _line(found[file_name])) for name in wanted),
            )
        )
    order = list(ranked)
    return dict(sorted(chosen.items(), key=lambda pair: order.index(pair[0]))), questions


def _torque(name: str, may_be: Sequence[Surveyed]) -> Question:
    listed = " or ".join(f"“{one.name}”" for one in may_be)
    return Question(
        f"{listed} may be the {name}, or the motor's own torque: the name does not tell which.",
        tuple(toml_line(name, _line(one)) for one in may_be),
    )


def _line(one: Surveyed) -> dict[str, Any]:
    return {"channel": one.name, **({"unit": one.unit} if one.unit else {})}


def _by_span(
    one: Surveyed,
    wanted: Sequence[str],
    channels: Mapping[str, Channel],
    command: Candidate | None,
    found: Survey,
    command_name: str,
) -> tuple[str, str] | None:
    """Which shaft an angle is of, by how far it moves beside the command; None: not clear."""
    if command is None or not one.unit or not found[command.name].unit or not wanted:
        return None
    other, side = found[command.name], channels[command_name].side
    if side is None or channels[wanted[0]].unit != channels[command_name].unit:
        return None
    span = (one.high - one.low) * unit_factor(one.unit, channels[wanted[0]].unit, one.name)
    beside = (other.high - other.low) * unit_factor(
        other.unit, channels[command_name].unit, other.name
    )
    if not (span > 0.0 and beside > 0.0):
        return None
    ratio = span / beside
    if _SAME_SHAFT[0] < ratio < _SAME_SHAFT[1]:
        same = [name for name in wanted if channels[name].side == side]
        if len(same) == 1:
            return same[0], (
                f"it moves {ratio:.2g} times as far as the command, so it is of the same shaft"
            )
    if ratio > _OTHER_SHAFT:
        others = [name for name in wanted if channels[name].side not in (side, None)]
        if len(others) == 1:
            return others[0], (
                f"it moves {ratio:.3g} times as far as the command, so it is of the other shaft"
            )
    return None


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _entry(
    channel: Channel, one: Surveyed, candidate: Candidate, also: Sequence[Candidate]
) -> Entry:
    reasons = [f"{_capital(channel.meaning)}: {candidate.reason}."]
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
    return Entry(channel.name, one.name, one.unit, one.unit_from, tuple(reasons))


def _missing(
    needs: Needs,
    channels: Sequence[Channel],
    entries: Mapping[str, Entry],
    ranked: Mapping[str, list[Candidate]],
    asked: Sequence[Question],
    found: Survey,
) -> list[Question]:
    """Questions on what a recording needs and no name speaks for."""
    present = with_derived(channels, entries)
    questions = []
    for group in needs:
        if is_met(group, present):
            continue
        wanted = list(dict.fromkeys(name for part in group for name in part if name not in present))
        lines: list[str] = []
        for name in wanted:
            lines += [toml_line(name, _line(found[one.name])) for one in ranked[name]]
        alternatives = " or ".join(" with ".join(part) for part in group)
        already = any(line.startswith(f"{name} =") for q in asked for line in q.lines
                      for name in wanted)  # fmt: skip
        by_unit = "" if not lines else " These have the right unit."
        told = "see above" if already else f"name it in the map.{by_unit}"
        questions.append(
            Question(
                f"Needed and not found for certain: {alternatives}; {told}",
                () if already else tuple(dict.fromkeys(lines)),
                needed=True,
            )
        )
    if "time" in ranked and not ranked["time"] and not _has_times(found):
        questions.append(
            Question(
                "No channel looks like time: name it in the map, or give the rate.",
                ('sample_rate = "20 kHz"',),
                needed=True,
            )
        )
    return questions


def _has_times(found: Survey) -> bool:
    return any(one.rate is not None for one in found.channels)


def rate_of(found: Survey, entry: Entry | None) -> float | None:
    """Samples per second that a proposed time channel gives, Hz; None where it is not known."""
    if entry is None or entry.is_open:
        return None
    one = found[entry.channel]
    factor = unit_factor(entry.unit, "s", entry.channel)
    span = factor * (one.high - one.low)
    rate = (one.samples - 1) / span if span > 0.0 else math.nan
    return rate if np.isfinite(rate) else None
