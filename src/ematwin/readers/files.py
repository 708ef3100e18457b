"""Files: written whole or not at all."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ematwin.errors import FileError, InputError


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside ``path``; it takes its place when the block ends well.

    Raises
    ------
    FileError
        If the folder cannot be written.
    """
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{target.name}.", suffix=target.suffix, dir=target.parent
        )
    except OSError as error:
        raise FileError(
            f"Cannot write {target}: {error.strerror}. Choose a folder that exists and is yours."
        ) from None
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        mode = target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask()
        draft.chmod(mode)
        os.replace(draft, target)
    except OSError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"Cannot write {target}: {error.strerror or error}.") from None
    finally:
        draft.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with written_whole(path) as draft:
        draft.write_text(text, encoding="utf-8")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def check_target(path: Path, suffixes: tuple[str, ...]) -> None:
    """Before long work: the name ends in one of ``suffixes`` and its folder can be written.

    Raises
    ------
    InputError
        If the name has another ending.
    FileError
        If the folder is missing or read-only.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(
            f"Cannot tell how to write {path}: end its name in {' or '.join(suffixes)}."
        )
    if path.is_dir():
        raise FileError(f"Cannot write {path}: it is a folder. Give the name of a file.")
    folder = path.parent
    try:
        tempfile.TemporaryFile(dir=folder).close()  # rights alone do not tell of read-only mounts
    except OSError:
        raise FileError(
            f"Cannot write {path}: the folder {folder} is missing or read-only. "
            "Choose a folder that exists and is yours."
        ) from None
