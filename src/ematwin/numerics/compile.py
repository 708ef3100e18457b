"""How kernels are compiled by numba, and where their machine code is kept.

``step`` marks one scalar step of the physics. It is inlined at the numba level into every loop
that calls it: without that lanes do not vectorise (measured: 4.6 times slower).

``part`` marks a step that LLVM alone inlines: it compiles several times faster than one that numba
inlines, and its lanes still vectorise if it is short. Python runs it as Python: a compiled entry
for Python would hold the whole part once more, and take a quarter of the time.

``loop`` marks the compiled loops. They release the GIL, so that threads share the work, and their
machine code is kept for the next process.

``contract``, ``nsz`` and ``arcp`` are the only relaxations of floating point: fused multiply-add,
the sign of zero ignored, reciprocals of loop constants. Sums keep their order, and NaN keeps its
meaning: it marks a candidate that diverged.

numba's own cache keeps the machine code. By itself it notices no change of a step in another file
than the loop's, nor of the fields of a tuple, and two processes that save different signatures at
once may exchange them. So each loop has, for each signature, a folder that is named by all that
the machine code depends on (`ematwin.numerics.content`), where there is nothing to mistake. A
cache is executed when it is loaded: the folders lie in one that only the user can write.

Processes that need the same machine code at once, such as workers of a study, wait for the first
of them, which compiles it.

The only private parts of numba in this file are the cache of a function, for which `Kept` stands
in, and the key of `_InOneFolder` (numba 0.61 to 0.68).
"""

import functools
import os
import shutil
import stat
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FunctionType
from typing import IO, Any

import numba
from numba.core import event
from numba.core.caching import FunctionCache
from numba.extending import register_jitable

from ematwin import numerics
from ematwin.numerics.content import content_of, signature_of

RELAXED = {"contract", "nsz", "arcp"}
if sys.platform != "win32":
    import fcntl

_POSIX = os.name == "posix"


def step(function: Callable[..., Any]) -> Any:
    """Mark a scalar step, which numba inlines."""
    return numba.njit(inline="always", error_model="numpy", fastmath=RELAXED)(function)


def part(function: Callable[..., Any]) -> Any:
    """Mark a step that LLVM alone inlines."""
    options = {"forceinline": True, "no_cfunc_wrapper": True}
    return register_jitable(error_model="numpy", fastmath=RELAXED, **options)(function)


@functools.cache
def plain(compiled: Any) -> Any:
    """A step, with all steps that it calls, as Python runs it: a few calls are sooner done so.

    Nothing is compiled: numba takes half a second for the first small step in each process.
    """
    function = getattr(compiled, "py_func", compiled)
    if not isinstance(function, FunctionType):
        return compiled
    code, held = function.__code__, function.__globals__
    names = {name: plain(held[name]) for name in code.co_names if name in held}
    return FunctionType(code, names, code.co_name, function.__defaults__, function.__closure__)


def loop(function: Callable[..., Any]) -> Any:
    """Compile ``function`` on its first call; keep the result on disk for the next process."""
    made: Any = numba.njit(nogil=True, error_model="numpy", fastmath=RELAXED)(function)
    if hasattr(made, "py_func"):  # else NUMBA_DISABLE_JIT is set
        made._cache = Kept(made)
    return made


class Kept:
    """The machine code of a loop, by its dispatcher, on disk, as numba asks for it."""

    cache_path = None

    def __init__(self, made: Any) -> None:
        self._made = made
        self._turn: IO[bytes] | None = None  # locked while this process compiles

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Machine code for a signature, or None."""
        found = self._found(signature, context)
        if found is None:
            numerics.compiling()
            with suppress(OSError, _NoFolderError):
                self._wait_for_others(signature)
                found = self._found(signature, context)
            if found is not None:  # the next in turn finds it as well
                self.end_turn()
        return found

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep machine code, if there is a folder with room for it."""
        with suppress(Exception):  # the next process compiles it again
            cache = self._of(signature)
            cache.save_overload(signature, compiled)
            _drop_stale(Path(cache.cache_path).parents[1])
        self.end_turn()

    def flush(self) -> None:
        """Do nothing: machine code named by content is never out of date."""

    def _found(self, signature: Any, context: Any) -> Any:
        """Machine code on disk, or None."""
        with suppress(Exception):  # damaged (pickle raises anything): compile it again
            return self._of(signature).load_overload(signature, context)
        return None

    def _wait_for_others(self, signature: Any) -> None:
        """Wait until no other process compiles the same; a lock ends with its process."""
        self.end_turn()
        if sys.platform == "win32":
            return
        place = self._place(signature)
        place.parent.mkdir(parents=True, exist_ok=True)
        self._turn = turn = place.with_suffix(".lock").open("wb")
        ends = time.monotonic() + 60.0  # s: the other may have been stopped
        while time.monotonic() < ends:
            try:
                fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                time.sleep(0.05)
            else:
                return

    def end_turn(self) -> None:
        """Let others compile, or load from the cache."""
        if self._turn is not None:
            with suppress(OSError):
                self._turn.close()
            self._turn = None

    def _place(self, signature: Any) -> Path:
        """The folder for the machine code of a signature."""
        function, folder = self._made.py_func, own_folder()
        if folder is None or not os.path.exists(function.__code__.co_filename):
            raise _NoFolderError
        name = f"{function.__module__}.{function.__qualname__}".replace("<locals>.", "")
        return folder / name / content_of(self._made) / signature_of(signature)

    def _of(self, signature: Any) -> "_InOneFolder":
        """numba's cache in the folder for a signature."""
        config: Any = numba.config
        before, config.CACHE_DIR = config.CACHE_DIR, str(self._place(signature))
        try:
            return _InOneFolder(self._made.py_func)
        finally:
            config.CACHE_DIR = before


class _Failures(event.Listener):
    """Lets others compile where this process was interrupted or failed."""

    def on_start(self, event: Any) -> None:
        """Do nothing."""

    def on_end(self, event: Any) -> None:
        """End the turn of a loop that is not going to be saved."""
        made = event.data["dispatcher"]
        kept = getattr(made, "_cache", None)
        if isinstance(kept, Kept) and tuple(event.data["args"]) not in made.overloads:
            kept.end_turn()


event.register("numba:compile", _Failures())


class _InOneFolder(FunctionCache):
    """numba's cache, which takes loops around the same steps for others in each process."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return sig, codegen.magic_tuple()


class _NoFolderError(Exception):
    """Nothing is kept, and all is compiled in memory."""


def own_folder() -> Path | None:
    """The folder of machine code, which only the user can write; None where there cannot be one.

    ``ematwin`` in the user's folder for caches; where NUMBA_CACHE_DIR is set, which others may
    share, ``ematwin-<user id>`` in that.
    """
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        folder = Path(given, f"ematwin-{os.geteuid()}" if _POSIX else "ematwin")
    else:
        folder = _folder_for_caches() / "ematwin"
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
        own = not _POSIX or (found.st_uid == os.geteuid() and not found.st_mode & 0o022)
        if stat.S_ISDIR(found.st_mode) and own:
            return folder
    return None


def _folder_for_caches() -> Path:
    home = os.path.expanduser("~")
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", home))
    if sys.platform == "darwin":
        return Path(home, "Library", "Caches")
    return Path(os.environ.get("XDG_CACHE_HOME") or Path(home, ".cache"))


def _drop_stale(current: Path) -> None:
    """Remove what other sources of a loop compiled to a month ago."""
    for other in current.parent.iterdir():
        if other != current and other.stat().st_mtime < time.time() - 30 * 86_400.0:
            shutil.rmtree(other, ignore_errors=True)
