"""Checkpoints: the whole state of a search in one file, replaced atomically.

A checkpoint is a pickle, and a pickle can run any code when it is read: read only your own.
"""

from __future__ import annotations

import os
import pickle
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ematwin.errors import FileError, InputError

_FORMAT = "ematwin search checkpoint 1"


def save(path: Path, identity: Mapping[str, Any], state: object) -> None:
    """Write a checkpoint such that the file is at every moment the old one or the new one.

    Raises
    ------
    FileError
        The file cannot be written.
    """
    content = pickle.dumps((_FORMAT, dict(identity), state), protocol=pickle.HIGHEST_PROTOCOL)
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise FileError(f"The checkpoint {path} cannot be written: {error}.") from error


def load(path: Path, identity: Mapping[str, Any]) -> Any:
    """Read the state of a search back, or None if there is no checkpoint yet.

    Raises
    ------
    FileError
        The file cannot be read or is not a checkpoint.
    InputError
        The checkpoint belongs to a search with other settings.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise FileError(f"The checkpoint {path} cannot be read: {error}.") from error
    try:
        form, saved, state = pickle.loads(content)
    except Exception as error:
        raise FileError(
            f"The file {path} is not a checkpoint of ematwin, or is damaged."
        ) from error
    if form != _FORMAT:
        raise FileError(f"The checkpoint {path} is of another version of ematwin: {form!r}.")
    for key, value in identity.items():
        if saved.get(key) != value:
            raise InputError(
                f"The checkpoint {path} is of another search: its {key} is {saved.get(key)!r}, "
                f"now {value!r} was asked for. Name another file, or delete this one."
            )
    return state
