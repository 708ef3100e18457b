"""Tables of motions: where one ends and the next begins, and what each is called.

A new motion begins where time falls back or a label changes. Labels are the columns that do not
change within a motion, such as condition, run and motion. A column with a unit is a label where it
stays the same through each motion; a load that steps within one is a signal that nobody mapped.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Protocol, TypeVar

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.recordings.collect import Collected
from ematwin.recordings.formats.base import RecordedFile
from ematwin.recordings.units import beside, is_unit

Choice = Mapping[str, Sequence[str]]  # label to the values that are wanted
_SHORTEST = 20  # samples of a motion


class Labelled(Protocol):
    """A recording, or a part of a file that will be one."""

    @property
    def labels(self) -> dict[str, str]: ...  # noqa: D102

    @property
    def source(self) -> str: ...  # noqa: D102


_Item = TypeVar("_Item", bound=Labelled)


def pieces(found: Collected, file: RecordedFile) -> list[Collected]:
    """The motions of a file; one, where its channels have several time bases."""
    if len(found.times) > 1:
        return [found]
    key, time = next(iter(found.times.items()))
    labels = _labels(file, found, key, time.size)
    measured = {name for name in labels if _has_unit(file, name)}
    starts = np.r_[True, np.diff(time) < 0.0]
    for name in labels.keys() - measured:
        starts[1:] |= _changes(labels[name])
    for name in measured:
        if np.any(_changes(labels[name]) & ~starts[1:]):
            del labels[name]
    return [
        found.part(
            slice(int(first), int(end)),
            {name: str(text[first]) for name, text in labels.items()},
        )
        for first, end in pairwise(np.r_[np.flatnonzero(starts), time.size])
    ]


def check_length(found: Collected) -> None:
    """Raise `RecordError` unless a part of a table has the samples of a motion."""
    samples = min(time.size for time in found.times.values())
    if samples < _SHORTEST:
        raise RecordError(
            f"{found.name}: a motion of {samples} samples is too short; at least {_SHORTEST} are "
            "needed. Remove it, or check the column of time."
        )


def check_single(found: Collected, file: RecordedFile) -> None:
    """Raise `RecordError` if a table that is read as one recording holds several motions."""
    if len(found.times) > 1:
        return
    time = next(iter(found.times.values()))
    falls = np.flatnonzero(np.diff(time) < 0.0) + 1
    if falls.size and np.diff(np.r_[0, falls, time.size]).min() >= _SHORTEST:
        raise RecordError(
            f"{file.path} holds {falls.size + 1} motions: time falls back to {time[falls[0]]:.6g} "
            f"s at sample {falls[0]}. Read it with split=True, which gives a recording for each."
        )


def fitting(motions: Sequence[_Item], where: Choice | Sequence[Choice] | None) -> list[_Item]:
    """The motions that fit a choice of labels or one of several, in their order; all for None.

    Raises
    ------
    InputError
        If a motion has no such label.
    RecordError
        If none fits a choice.
    """
    if where is None:
        return list(motions)
    wanted: set[int] = set()
    for choice in [where] if isinstance(where, Mapping) else where:
        chosen = {id(motion) for motion in motions if _fits(motion, choice)}
        if not chosen:
            given = ", ".join(f"{key} = {' or '.join(v)}" for key, v in choice.items())
            raise RecordError(
                f"None of the {len(motions)} motions has {given or 'anything to read'}; there are "
                f"{labels_of(motions)}. Correct the choice."
            )
        wanted |= chosen
    return [motion for motion in motions if id(motion) in wanted]


def labels_of(motions: Sequence[Labelled]) -> str:
    """The labels of motions with their values, as a text."""
    values: dict[str, dict[str, None]] = {}
    for motion in motions:
        for name, value in motion.labels.items():
            values.setdefault(name, {})[value] = None
    return "; ".join(f"{name} {', '.join(list(v)[:20])}" for name, v in values.items()) or "none"


def _fits(motion: Labelled, where: Choice) -> bool:
    for name, values in where.items():
        if name not in motion.labels:
            raise InputError(
                f"{motion.source} has no label {name!r}; it has "
                f"{', '.join(motion.labels) or 'none'}. Correct the name."
            )
        if motion.labels[name] not in values:
            return False
    return True


def _labels(file: RecordedFile, found: Collected, key: str, rows: int) -> dict[str, np.ndarray]:
    """The columns of a file that are labels, (S,) arrays of texts."""
    texts: dict[str, np.ndarray] = {}
    for name in file.names:
        if name in found.names or file.time_base(name) != key:
            continue
        text = np.array(file.texts(name))
        if text.size == rows and int(np.sum(_changes(text))) * _SHORTEST <= text.size:
            texts[name] = text  # it stays as it is for many rows, as no signal does
    return texts


def _changes(text: np.ndarray) -> np.ndarray:
    """Whether each row but the first differs from the one before it."""
    changed: np.ndarray = text[1:] != text[:-1]
    return changed


def _has_unit(file: RecordedFile, name: str) -> bool:
    """Whether the file, or brackets in the name, state a unit."""
    return bool(file.stated_unit(name)) or is_unit(beside(name)[1])
