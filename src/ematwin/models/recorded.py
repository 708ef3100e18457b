"""Columns of a recorded file, in SI, for scenarios that repeat a recorded command."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ematwin.errors import ParameterError, RecordError
from ematwin.recordings.formats.base import open_file
from ematwin.recordings.units import (
    bare,
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
    kinds, optional : name of a column to its possible SI units

    Raises
    ------
    ParameterError
        If a column is missing or its unit is of another kind.
    RecordError
        If it holds no numbers.
    FileError
        If the file cannot be read.
    """
    with open_file(path) as file:
        found: dict[str, str] = {}
        for wanted, units in {**kinds, **optional}.items():
            name = _named(wanted, units, file.names)
            if name is not None:
                found[wanted] = name
            elif wanted in kinds:
                raise ParameterError(
                    f"{path} has no column {wanted!r}; it has {', '.join(file.names)}. "
                    "Rename or add the column."
                )
        values = file.read(list(dict.fromkeys(found.values())))
        columns = {}
        for wanted, name in found.items():
            units = (kinds if wanted in kinds else optional)[wanted]
            behind = (unit_in_name(name, unit) for unit in units)
            unit = (
                file.stated_unit(name) or unit_beside_name(name) or next(filter(None, behind), "")
            )
            columns[wanted] = values[name] * _factor(unit, units, f"{name!r} of {path}")
        return columns


def _named(wanted: str, units: tuple[str, ...], names: tuple[str, ...]) -> str | None:
    """The column of that name, with or without a unit, such as ``command_deg``."""
    if wanted in names:
        return wanted
    by_bare_name = [name for name in names if bare(name) == wanted]
    with_unit = (
        name
        for name in names
        if any(stem == wanted for unit in units for stem, _ in suffixes(bare(name), unit))
    )
    return next(iter(by_bare_name), None) or next(with_unit, None)


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
