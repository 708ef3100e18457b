"""Columns of a recorded file, in SI, for scenarios that repeat what was once commanded."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ematwin.errors import ParameterError, RecordError
from ematwin.recordings.formats.base import open_file
from ematwin.recordings.units import (
    bare,
    says_nothing,
    suffixes,
    unit_beside_name,
    unit_factor,
    unit_in_name,
)


def recorded_columns(
    path: Path, kinds: Mapping[str, tuple[str, ...]], optional: Mapping[str, tuple[str, ...]]
) -> dict[str, np.ndarray]:
    """Named columns of a file in SI; their unit stands in the file or in their name.

    Parameters
    ----------
    path : any file that `ematwin.read` knows
    kinds, optional : name of a column to the SI units of which it may be

    Raises
    ------
    ParameterError
        If a column is missing or its unit is of another kind.
    RecordError
        If it holds no numbers.
    FileError
        If the file cannot be read.
    """
    with open_file(path) as recording:
        units = {**kinds, **optional}
        by_bare_name = {bare(name): name for name in reversed(recording.names)}
        found: dict[str, str] = {}
        for wanted in (*kinds, *optional):
            if wanted in recording.names:
                found[wanted] = wanted
            elif wanted in by_bare_name:
                found[wanted] = by_bare_name[wanted]
            elif suffixed := _with_suffix(wanted, units[wanted], recording.names):
                found[wanted] = suffixed
            elif wanted in kinds:
                raise ParameterError(
                    f"{path} has no column {wanted!r}; it has {', '.join(recording.names)}. "
                    "Rename or add the column."
                )
        values = recording.read(list(dict.fromkeys(found.values())))
        columns = {}
        for wanted, name in found.items():
            stated = recording.unit(name)
            if says_nothing(stated):
                behind = (unit_in_name(name, kind) for kind in units[wanted])
                stated = unit_beside_name(name) or next(filter(None, behind), None)
            factor = _factor(stated or "", units[wanted], f"{name!r} of {path}")
            columns[wanted] = values[name] * factor
        return columns


def _with_suffix(wanted: str, kinds: tuple[str, ...], names: tuple[str, ...]) -> str | None:
    """The name that is a wanted one with a fitting unit behind it, such as ``command_deg``."""
    for name in names:
        if any(stem == wanted for kind in kinds for stem, _ in suffixes(bare(name), kind)):
            return name
    return None


def _factor(unit: str, kinds: tuple[str, ...], what: str) -> float:
    """The factor to the first of the SI units that fits; 1 without a unit."""
    if not unit:
        return 1.0
    for kind in kinds:
        try:
            return unit_factor(unit, kind, what)
        except RecordError:
            continue
    raise ParameterError(
        f"{what} must have a unit of the kind {' or '.join(kinds)}; received {unit!r}. Correct it."
    )
