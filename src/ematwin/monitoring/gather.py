"""Recordings as they are given: themselves, or the files that hold them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ematwin.errors import InputError
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.recordings.recording import Recording
from ematwin.showing.frames import is_frame

Given = Recording | str | Path | Iterable[Recording | str | Path]  # or a DataFrame, or several


def recordings_of(given: Given, actuator: ParameterSet) -> list[Recording]:
    """Recordings at the rate at which they are compared; files are read as the actuator's kind.

    A table of several motions gives each of them.

    Raises
    ------
    InputError
        If nothing is given, or something that is no recording.
    FileError, RecordError
        If a file cannot be read.
    """
    single = isinstance(given, Recording | str | Path) or is_frame(given)
    items: Iterable[Any] = [given] if single else given  # type: ignore[assignment]
    found: list[Recording] = []
    for one in items:
        if isinstance(one, Recording):
            found.append(one)
        elif isinstance(one, str | Path) or is_frame(one):
            from ematwin.models.reading import read

            found += read(one, actuator=actuator, split=True)
        else:
            raise InputError(
                f"Give recordings, DataFrames or the paths of files, received {type(one).__name__}."
            )
    if not found:
        raise InputError("No recording was given; give at least one.")
    model = model_of(actuator)
    return [model.averaged(one) for one in found]
