"""Motions in files: a table of many motions, or one motion a file.

A new motion begins where time falls back or a label changes. Labels are the columns that do not
change within a motion, such as condition, run and motion.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.readers.recording import Recording, bare, find_channel, open_recording
from ematwin.readers.timing import tidy_time
from ematwin.readers.units import says_nothing, unit_factor, unit_in_name
from ematwin.signals.motion import MOTION_COLUMNS, Motion, label_text

Choice = Mapping[str, Sequence[str]]  # label to the values that are wanted
_ALIASES = {
    "time": ("time", "t"),
    "set_point": ("set_point", "setpoint", "command", "demand", "reference"),
    "position": ("position", "nut_position", "output_position"),
    "position_error": ("position_error", "error", "following_error"),
    "current": ("current", "motor_current", "drive_current"),
}
_SUFFIX = re.compile(r"^(.*)_([A-Za-z]+)$")  # set_point_mm: the unit after the last underscore
_LONGEST = 100.0  # m: no actuator travels further; a larger span is a wrong unit
_LARGEST = 2000.0  # A
_SHORTEST = 20  # samples of a motion


def read_motions(
    paths: Sequence[str | Path] | str | Path,
    columns: Mapping[str, str] | None = None,
    where: Choice | Sequence[Choice] | None = None,
) -> list[Motion]:
    """Read motions from files that `ematwin.read` knows the format of.

    Parameters
    ----------
    paths : one file or several
    columns : channel of each of time, set_point, position_error (or position) and current; found
        by name where left out. A unit stands in the name (``"Demand [mm]"``, ``demand_mm``) or in
        the file; SI where it stands nowhere
    where : labels with the values that are wanted, e.g. ``{"condition": ["normal"]}``, or several
        such choices, of which one has to fit

    Raises
    ------
    InputError
        If a column name is unknown, or a label that `where` names is not in the files.
    FileError
        If a file cannot be read.
    RecordError
        If a channel is missing or holds what a motion cannot, or nothing fits `where`.
    """
    for name in columns or {}:
        if name not in MOTION_COLUMNS:
            raise InputError(
                f"A motion has no column {name!r}; there are {', '.join(MOTION_COLUMNS)}. "
                "Correct the name."
            )
    files = [paths] if isinstance(paths, str | Path) else list(paths)
    pieces: list[_Piece] = []
    for file in files:
        with open_recording(Path(file)) as recording:
            pieces += _pieces_of(recording, columns or {})
    choices = [where or {}] if where is None or isinstance(where, Mapping) else list(where)
    wanted = {id(piece) for choice in choices for piece in fitting(pieces, choice)}
    # only what was chosen has to be sound
    return [piece.motion() for piece in pieces if id(piece) in wanted]


class _Labelled(Protocol):
    @property
    def labels(self) -> dict[str, str]: ...

    @property
    def source(self) -> str: ...


_Item = TypeVar("_Item", bound=_Labelled)


def fitting(motions: Sequence[_Item], where: Choice) -> list[_Item]:
    """The motions with these labels.

    Raises
    ------
    InputError
        If a motion has no such label.
    RecordError
        If none fits.
    """
    chosen = [motion for motion in motions if _fits(motion, where)]
    if not chosen:
        wanted = ", ".join(f"{key} = {' or '.join(v)}" for key, v in where.items())
        raise RecordError(
            f"None of the {len(motions)} motions has {wanted or 'anything to read'}; there are "
            f"{labels_of(motions)}. Correct the choice."
        )
    return chosen


def _fits(motion: _Labelled, where: Choice) -> bool:
    for name, values in where.items():
        if name not in motion.labels:
            raise InputError(
                f"{motion.source} has no label {name!r}; it has "
                f"{', '.join(motion.labels) or 'none'}. Correct the name."
            )
        if motion.labels[name] not in values:
            return False
    return True


def labels_of(motions: Sequence[_Labelled]) -> str:
    """The labels of motions with their values, as a text."""
    values: dict[str, dict[str, None]] = {}
    for motion in motions:
        for name, value in motion.labels.items():
            values.setdefault(name, {})[value] = None
    return "; ".join(f"{name} {', '.join(list(v)[:20])}" for name, v in values.items()) or "none"


@dataclass(frozen=True)
class _Piece:
    """The rows of a motion in a file, not looked at yet."""

    values: dict[str, np.ndarray]
    labels: dict[str, str]
    path: Path

    @property
    def source(self) -> str:
        return self.path.name

    def motion(self) -> Motion:
        return _motion(self.values, self.labels, self.path)


def _pieces_of(recording: Recording, columns: Mapping[str, str]) -> list[_Piece]:
    path = recording.path
    channels = _channels(recording, columns)
    raw = recording.read(list(channels.values()))
    values = {role: raw[name] * _factor(recording, role, name) for role, name in channels.items()}
    others = [name for name in recording.names if name not in channels.values()]
    labels = {name: np.array(recording.texts(name)) for name in others}
    time = values["time"]
    if time.size == 0:
        raise RecordError(f"{path} holds no rows; nothing was recorded. Leave it out.")
    starts = np.r_[True, np.diff(time) < 0.0]
    fixed = {name: text for name, text in labels.items() if _is_label(text, time.size)}
    for text in fixed.values():
        starts[1:] |= text[1:] != text[:-1]
    pieces = []
    for first, end in pairwise(np.r_[np.flatnonzero(starts), time.size]):
        part = slice(int(first), int(end))
        own = {name: str(text[first]) for name, text in fixed.items()}
        pieces.append(_Piece({k: v[part] for k, v in values.items()}, own, path))
    return pieces


def _is_label(text: np.ndarray, rows: int) -> bool:
    """Whether a column stays as it is for many rows: it names a condition, it is no signal."""
    changes = int(np.sum(text[1:] != text[:-1]))
    return changes * _SHORTEST <= rows


def _channels(recording: Recording, columns: Mapping[str, str]) -> dict[str, str]:
    names = recording.names
    found = {}
    for role in MOTION_COLUMNS:
        if role in columns:
            found[role] = find_channel(names, columns[role], recording.path)
            continue
        fitting = [name for name in names if _plain(name) in _ALIASES[role]]
        if len(fitting) == 1:
            found[role] = fitting[0]
        elif fitting:
            raise RecordError(
                f"{recording.path} has several channels for {role}: {', '.join(fitting)}. "
                f'Say which with --column {role}="...".'
            )
    missing = [role for role in ("time", "set_point", "current") if role not in found]
    if not ({"position", "position_error"} & set(found)):
        missing.append("position_error")
    if missing:
        raise RecordError(
            f"{recording.path} has no channel for {missing[0]}; it has {', '.join(names)}. "
            f'Say which it is with --column {missing[0]}="...".'
        )
    if "position_error" in found:
        found.pop("position", None)
    return found


def _plain(name: str) -> str:
    """The name without unit and case: ``"Set_Point_mm"`` and ``"set point [mm]"`` alike."""
    text = bare(name).casefold().replace(" ", "_")
    match = _SUFFIX.match(text)
    known = {alias for aliases in _ALIASES.values() for alias in aliases}
    return match[1] if match and text not in known else text


def _factor(recording: Recording, role: str, name: str) -> float:
    si_unit = MOTION_COLUMNS[role][0]
    what = f"{recording.path}: {name}"
    stated = recording.unit(name)
    if stated is not None and not says_nothing(stated):
        return unit_factor(stated, si_unit, what)
    inside = unit_in_name(name, si_unit)
    if inside is not None:
        return unit_factor(inside, si_unit, what)
    match = _SUFFIX.match(name)
    if match and _plain(name) != bare(name).casefold().replace(" ", "_"):
        suffix = "A" if match[2] in {"a", "A"} else match[2]
        return unit_factor(suffix, si_unit, what)
    return 1.0


def _motion(values: dict[str, np.ndarray], labels: dict[str, str], path: Path) -> Motion:
    motion = f"{path} {label_text(labels)}".strip()
    if values["time"].size < _SHORTEST:
        raise RecordError(
            f"{motion}: a motion of {values['time'].size} samples is too short; at least "
            f"{_SHORTEST} are needed. Remove it, or check the column of time."
        )
    time, _ = tidy_time(values["time"], path)
    set_point = values["set_point"]
    error = values.get("position_error")
    if error is None:
        error = set_point - values["position"]
    span = float(np.ptp(set_point)) if np.isfinite(set_point).all() else 0.0
    if span > _LONGEST:
        raise RecordError(
            f"{motion}: set_point spans {span:.4g} m, which no actuator travels; its unit is "
            "probably mm. Name it set_point_mm or put [mm] into the name."
        )
    largest = float(np.abs(values["current"]).max())  # NaN is refused by `Motion`
    if largest > _LARGEST:
        raise RecordError(
            f"{motion}: current reaches {largest:.4g} A, which no such drive takes; its unit is "
            "probably mA. Put [mA] into the name of the channel."
        )
    return Motion(time, set_point, error, values["current"], labels, path.name)
