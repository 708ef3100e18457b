"""Files and folders: written whole or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ematwin.errors import FileError, InputError


@contextmanager
def written_whole(
    path: str | Path, *, durable: bool = False, private: bool = False
) -> Iterator[Path]:
    """Give a temporary path beside ``path``; it takes its place when the block ends well.

    ``durable`` waits until the content is on the disk, so that it survives a power failure. A
    ``private`` file is the user's alone; others have the rights of the file that they replace, or
    the usual ones. Raises `FileError` if the file cannot be written; an older one stays as it was.
    """
    target = Path(path)
    with _refusing(f"{target}", " Choose a folder that exists and is yours."):
        handle, name = tempfile.mkstemp(target.suffix, f".{target.name}.", target.parent)
        os.close(handle)
    draft = Path(name)
    try:
        with _refusing(f"{target}"):
            yield draft
            if durable:
                with draft.open("rb+") as file:
                    os.fsync(file.fileno())
            if not private:
                draft.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
            os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)


@contextmanager
def folder_written_whole(folder: str | Path) -> Iterator[Path]:
    """Give a temporary folder; its files move to ``folder`` when the block ends well.

    A folder that is missing is made; in one that is there, files of the same name are replaced.
    Raises `FileError` if it cannot be written; one that was missing stays so, and no file is left
    half-done.
    """
    target = Path(folder)
    parent = target.absolute().parent
    with _refusing(f"to {target}", " Choose a folder that is yours."):
        parent.mkdir(parents=True, exist_ok=True)
        there = target if target.exists() else parent
        draft = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=there))
    try:
        with _refusing(f"to {target}"):
            yield draft
            if target.exists():
                for path in sorted(draft.iterdir()):
                    os.replace(path, target / path.name)
            else:
                draft.chmod(0o777 & ~_umask())
                draft.rename(target)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


@contextmanager
def _refusing(what: str, advice: str = "") -> Iterator[None]:
    """Turn an error of the system into a sentence."""
    try:
        yield
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"Cannot write {what}: {error.strerror or error}.{advice}") from None


def write_text(path: str | Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with written_whole(path) as draft:
        draft.write_text(text, encoding="utf-8")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def check_target(path: Path, suffixes: tuple[str, ...], *, replace: bool = True) -> None:
    """Check before long work that a name has one of ``suffixes`` and its folder can be written.

    ``replace`` False is for files that a user may have edited: one that exists is refused. Raises
    `InputError`, or `FileError` if the folder is missing or read-only.
    """
    if path.suffix.lower() not in suffixes:
        known = " or ".join(suffixes)
        raise InputError(f"Cannot tell how to write {path}: end its name in {known}.")
    if path.is_dir():
        raise FileError(f"Cannot write {path}: it is a folder. Give the name of a file.")
    if path.exists() and not replace:
        advice = "Give another name, or replace it with --force."
        raise InputError(f"{path} exists, and may hold what you put in. {advice}")
    folder = path.parent
    try:
        tempfile.TemporaryFile(dir=folder).close()  # rights alone do not tell of read-only mounts
    except OSError:
        said = f"Cannot write {path}: the folder {folder} is missing or read-only"
        raise FileError(f"{said}. Choose a folder that exists and is yours.") from None
