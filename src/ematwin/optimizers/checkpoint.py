"""Checkpoints: the whole state of a search in one file, replaced atomically.

A checkpoint is a pickle, and a pickle can run any code when it is read: read only your own.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ematwin.errors import FileError, InputError
from ematwin.files import written_whole

_FORMAT = "ematwin search checkpoint 1"


def save(path: Path, identity: Mapping[str, Any], state: object) -> None:
    """Write a checkpoint: at every moment, power failures included, the file is whole.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    content = pickle.dumps((_FORMAT, dict(identity), state), protocol=pickle.HIGHEST_PROTOCOL)
    with written_whole(path, durable=True, private=True) as draft:
        draft.write_bytes(content)


def load(path: Path, identity: Mapping[str, Any]) -> Any:
    """Read the state of a search back, or None if there is no checkpoint yet.

    Raises
    ------
    FileError
        If the file cannot be read or is not a checkpoint.
    InputError
        If the checkpoint belongs to a search with other settings.
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
        raise FileError(
            f"The checkpoint {path} was written by another version of ematwin: {form!r}."
        )
    for key, value in identity.items():
        if saved.get(key) != value:
            raise InputError(
                f"The checkpoint {path} belongs to another search: its {key} is "
                f"{saved.get(key)!r}, but {value!r} was asked for. "
                "Name another file, or delete this one."
            )
    return state
