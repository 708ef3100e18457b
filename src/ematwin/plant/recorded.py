"""Columns of a recorded file, in SI, for scenarios that repeat what was once commanded."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ematwin.errors import ParameterError, RecordError


def recorded_columns(
    path: Path, kinds: Mapping[str, tuple[str, ...]], optional: Mapping[str, tuple[str, ...]]
) -> dict[str, np.ndarray]:
    """Named columns of a file in SI; their unit stands in the file or in brackets in their name.

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
    from ematwin.readers.recording import bare, open_recording
    from ematwin.readers.units import says_nothing, unbracketed

    with open_recording(path) as recording:
        by_bare_name = {bare(name): name for name in reversed(recording.names)}
        found: dict[str, str] = {}
        for wanted in (*kinds, *optional):
            if wanted in recording.names:
                found[wanted] = wanted
            elif wanted in by_bare_name:
                found[wanted] = by_bare_name[wanted]
            elif wanted in kinds:
                raise ParameterError(
                    f"{path} has no column {wanted!r}; it has {', '.join(recording.names)}. "
                    "Rename or add the column."
                )
        values = recording.read(list(dict.fromkeys(found.values())))
        columns = {}
        for wanted, name in found.items():
            stated = recording.unit(name)
            unit = unbracketed(name[len(bare(name)) :]) if says_nothing(stated) else stated
            factor = _factor(unit or "", {**kinds, **optional}[wanted], f"{name!r} of {path}")
            columns[wanted] = values[name] * factor
        return columns


def _factor(unit: str, kinds: tuple[str, ...], what: str) -> float:
    """The factor to the first of the SI units that fits; 1 without a unit."""
    from ematwin.readers.units import unit_factor

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
