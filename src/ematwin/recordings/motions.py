"""Tables of motions: where one ends and the next begins, and what each is called.

A new motion begins where time falls back or a label changes. Labels are the columns that do not
change within a motion, such as condition, run and motion. A column with a unit is a label where it
stays the same through each motion; a load that steps within one is a signal that nobody mapped.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.recordings.collect import Collected
from ematwin.recordings.recording import Recording
from ematwin.recordings.units import beside, is_unit

Choice = Mapping[str, Sequence[str]]  # label to the values that are wanted
_SHORTEST = 20  # samples of a motion
_Motion = TypeVar("_Motion", Recording, Collected)


def pieces(found: Collected) -> list[Collected]:
    """The motions of a file; one, where its channels have several time bases."""
    if len(found.times) > 1:
        return [found]
    key, time = next(iter(found.times.items()))
    labels = _labels(found, key, time.size)
    starts = np.r_[True, np.diff(time) < 0.0]
    measured = []  # the file, or brackets in the name, state a unit
    for name in labels:
        if found.file.stated_unit(name) or is_unit(beside(name)[1]):
            measured.append(name)
        else:
            starts[1:] |= _changes(labels[name])
    for name in measured:
        if np.any(_changes(labels[name]) & ~starts[1:]):
            del labels[name]
    ends = pairwise(np.r_[np.flatnonzero(starts), time.size].tolist())
    return [
        found.part(slice(first, end), {name: str(text[first]) for name, text in labels.items()})
        for first, end in ends
    ]


def check_length(found: Collected) -> None:
    """Raise `RecordError` unless a part of a table has the samples of a motion."""
    samples = min(time.size for time in found.times.values())
    if samples < _SHORTEST:
        raise RecordError(
            f"{found.name}: a motion of {samples} samples is too short; at least {_SHORTEST} are "
            "needed. Remove it, or check the column of time."
        )


def check_single(found: Collected) -> None:
    """Raise `RecordError` if a table that is read as one recording holds several motions."""
    if len(found.times) > 1:
        return
    time = next(iter(found.times.values()))
    falls = np.flatnonzero(np.diff(time) < 0.0) + 1
    if falls.size and np.diff(np.r_[0, falls, time.size]).min() >= _SHORTEST:
        raise RecordError(
            f"{found.file.path} holds {falls.size + 1} motions: time falls back to "
            f"{time[falls[0]]:.6g} s at sample {falls[0]}. Read it with split=True, "
            "which gives a recording for each."
        )


def fitting(motions: Sequence[_Motion], where: Choice | Sequence[Choice] | None) -> list[_Motion]:
    """The motions that fit a choice of labels or one of several, in their order; all for None.

    Raises `InputError` if a motion has no such label, `RecordError` if none fits a choice.
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
                f"{_labels_of(motions)}. Correct the choice."
            )
        wanted |= chosen
    return [motion for motion in motions if id(motion) in wanted]


def _labels_of(motions: Sequence[Any]) -> str:
    values: dict[str, dict[str, None]] = {}
    for motion in motions:
        for name, value in motion.labels.items():
            values.setdefault(name, {})[value] = None
    return "; ".join(f"{name} {', '.join(list(v)[:20])}" for name, v in values.items()) or "none"


def _fits(motion: Any, where: Choice) -> bool:
    for name, values in where.items():
        if name not in motion.labels:
            raise InputError(
                f"{motion.source} has no label {name!r}; it has "
                f"{', '.join(motion.labels) or 'none'}. Correct the name."
            )
        if motion.labels[name] not in values:
            return False
    return True


def _labels(found: Collected, key: str, rows: int) -> dict[str, np.ndarray]:
    """The columns of a file that are labels, (S,) arrays of texts."""
    texts: dict[str, np.ndarray] = {}
    for name in found.file.names:
        if name in found.names or found.file.time_base(name) != key:
            continue
        text = np.array(found.file.texts(name))
        if text.size == rows and int(np.sum(_changes(text))) * _SHORTEST <= text.size:
            texts[name] = text  # it stays as it is for many rows, as no signal does
    return texts


def _changes(text: np.ndarray) -> Any:
    """Whether each row but the first differs from the one before it."""
    return text[1:] != text[:-1]
