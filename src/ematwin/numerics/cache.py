"""What was compiled, kept on disk for the next process: never out of date, and nobody else's.

numba keeps an index beside its data files, and saves the index first: a process that starts in
between, or one that is stopped there, leaves a fresh index over stale or foreign machine code. It
also notices a change only in the file of the compiled loop, not in the steps inlined into it.

Here each result lies in a file of its own, whose name is the hash of all that it depends on: the
sources of the loop and of all that it calls, in whatever package they stand
(`ematwin.numerics.dependencies`), the versions of numba and llvmlite, the kinds of the arguments
and the processor. What is found under a name can only be what belongs there, in whatever order it
was written.

A file has two parts: what runs without numba (`ematwin.numerics.machine_code`), and what numba
itself keeps, by which another loop that is compiled can call it.

Loading it runs it: machine code, wrapped in a pickle. So the files lie in a folder of the user's
own (0700, files 0600) within that of the byte code, or of NUMBA_CACHE_DIR, which others may share.
Where that folder is a link, belongs to another user or can be written by the group or others, it is
neither read nor written; nor is such a file in it. The function is compiled anew then, and also
whenever a file is damaged or cannot be used for any other reason. Systems without POSIX rights skip
these checks: there, set NUMBA_CACHE_DIR to a folder that only you can write.
"""

import hashlib
import io
import os
import pickle
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import FunctionType
from typing import Any

from ematwin.files import written_whole
from ematwin.numerics.claim import Claim
from ematwin.numerics.dependencies import Dependencies

_DIGEST = hashlib.sha256().digest_size
_POSIX = os.name == "posix"
_OWN_FOLDER = f"ematwin-{os.geteuid()}" if _POSIX else "ematwin"
_FOR_READING = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class NamedByContent:
    """One file for each result; replaces numba's index and data files.

    Parameters
    ----------
    folder : str or Path, of `folder_for`; the files lie in a folder of the user's own in it
    function : str, name of the function, its line and the version of Python
    depends_on : callable, gives the `Dependencies` of the function; asked at the first use, so that
        importing stays quick
    variants : bool, several functions go by this name, each with a closure of its own: what depends
        on other sources may belong to another of them, and is not dropped
    """

    def __init__(
        self,
        folder: str | Path,
        function: str,
        depends_on: Callable[[], Dependencies],
        variants: bool = False,
    ) -> None:
        self.folder = Path(folder, _OWN_FOLDER)
        self._function = function
        self._depends_on = depends_on
        self._variants = variants
        self._known: Dependencies | None = None

    def load(self, key: str, part: int = 0) -> Any:
        """A part of what was compiled for ``key``, or None."""
        try:
            path = self.path(key)
            if not _is_own_folder(self.folder):
                return None
            content = _read_own(path)
            digest, data = content[:_DIGEST], content[_DIGEST:]
            if hashlib.sha256(data).digest() != digest:
                return None
            stream = io.BytesIO(data)
            for _ in range(part):
                pickle.load(stream)
            loaded = _Unpickler(stream).load()
            _log(f"loaded from {str(path)!r}")
            return loaded
        except Exception:
            return None  # missing, damaged or foreign (pickle raises anything): compile again

    def save(self, key: str, *parts: bytes) -> None:
        """Keep pickles of what was compiled for ``key``; drop what other sources compiled to."""
        content = b"".join(parts)
        path = self.path(key)
        with suppress(OSError):  # full, read-only or foreign: the next process compiles again
            self.folder.mkdir(mode=0o700, exist_ok=True)
            if not _is_own_folder(self.folder):
                return
            if os.path.lexists(path) and not _is_own(path.lstat()):
                return
            with written_whole(path, private=True) as draft:
                draft.write_bytes(hashlib.sha256(content).digest() + content)
            _log(f"saved to {str(path)!r}")
            for other in () if self._variants else self._out_of_date():
                other.unlink(missing_ok=True)

    def claim(self, key: str) -> Claim | None:
        """The right to compile for ``key``, taken once nobody else has it; None without a folder.

        Whoever had it may have saved what is looked for: load it again before compiling.
        """
        try:
            self.folder.mkdir(mode=0o700, exist_ok=True)
            if not _is_own_folder(self.folder):
                return None
            taken = Claim(self.path(key))
            taken.take()
            return taken
        except OSError:
            return None

    def stamp(self, key: str) -> tuple[int, int] | None:
        """What tells a file of ``key`` from a later one; None where there is none."""
        try:
            found = self.path(key).lstat()
        except Exception:  # no file, or none that can be named: whoever loads it sees
            return None
        return found.st_ino, found.st_mtime_ns

    def path(self, key: str) -> Path:
        """The file of ``key``."""
        depends_on = self._dependencies()
        number = hashlib.sha256(f"{depends_on.content} {key}".encode()).hexdigest()[:16]
        return self.folder / f"{self._function}.{depends_on.sources}.{number}.nbc"

    def _out_of_date(self) -> Iterator[Path]:
        """Files of the same function, on whatever line, from other sources."""
        name, _, line_and_python = self._function.rpartition("-")
        python = line_and_python.partition(".")[2]
        for path in self.folder.glob(f"{name}-*.{python}.*.*.nbc"):
            if f".{self._dependencies().sources}." not in path.name:
                yield path

    def _dependencies(self) -> Dependencies:
        if self._known is None:
            self._known = self._depends_on()
        return self._known


def files_for(
    function: FunctionType, depends_on: Callable[[], Dependencies]
) -> NamedByContent | None:
    """Files for what a function compiles to; None where no folder can be written."""
    folder = folder_for(function.__code__.co_filename)
    if folder is None:
        return None
    module = function.__module__.rpartition(".")[2]
    name = function.__qualname__.replace("<", "").replace(">", "")
    version = "".join(map(str, sys.version_info[:2]))
    return NamedByContent(
        folder,
        f"{module}.{name}-{function.__code__.co_firstlineno}.py{version}",
        depends_on,
        variants=function.__closure__ is not None,
    )


def folder_for(source: str) -> Path | None:
    """The first folder in which results of a source file may be kept, or None; as numba has it.

    NUMBA_CACHE_DIR; the folder of its byte code; and one of the user's own.
    """
    place = os.path.dirname(os.path.abspath(source))
    own = f"{os.path.basename(place)}_{hashlib.sha1(place.encode()).hexdigest()}"
    tried = [_of_user() / own]
    if os.path.exists(source):  # else it was typed
        tried.insert(0, Path(place, "__pycache__"))
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        tried.insert(0, Path(given, own))
    for folder in tried:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK | os.X_OK):
                return folder
    return None


def _of_user() -> Path:
    home = os.path.expanduser("~")
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", home), "ematwin", "Cache")
    if sys.platform == "darwin":
        return Path(home, "Library", "Caches", "ematwin")
    return Path(os.environ.get("XDG_CACHE_HOME") or Path(home, ".cache"), "ematwin")


class _Unpickler(pickle.Unpickler):
    """Reads what numba keeps without loading the parts of numba that it was compiled from."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("numba.core.environment", "_rebuild_env"):
            from ematwin.numerics.compiler import environment

            return environment
        return super().find_class(module, name)


def _log(done: str) -> None:
    if os.environ.get("NUMBA_DEBUG_CACHE", "0") not in ("", "0"):
        print(f"[cache] data {done}")


def _is_own_folder(path: Path) -> bool:
    found = path.lstat()
    return stat.S_ISDIR(found.st_mode) and _is_own(found)


def _is_own(found: os.stat_result) -> bool:
    """Whether it belongs to this user, and neither group nor others can write it."""
    return not _POSIX or (found.st_uid == os.geteuid() and not found.st_mode & 0o022)


def _read_own(path: Path) -> bytes:
    """Content of a file that `_is_own`; a link is not followed."""
    handle = os.open(path, _FOR_READING)
    with open(handle, "rb") as file:
        found = os.fstat(handle)
        if not (stat.S_ISREG(found.st_mode) and _is_own(found)):
            raise PermissionError(f"{path} belongs to another user or can be written by others.")
        return file.read()
