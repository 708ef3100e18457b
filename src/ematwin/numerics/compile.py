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

Machine code is kept in a file for each loop and signature, which is named by all that it depends on
(`ematwin.numerics.content`). numba's own cache notices no change of a step in another file than the
loop's, nor of the fields of a tuple, and two processes that save different signatures at once may
exchange them. A cache is executed when it is loaded: the files lie in a folder that only the user
can write.

Processes that need the same machine code at once, such as workers of a study, wait for the first
of them, which compiles it.

The only private parts of numba in this file are the lock of its compiler, its runtime, the cache of
a function and how a `CompileResult` is pickled (numba 0.61 to 0.68).
"""

import functools
import os
import pickle
import shutil
import stat
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps
from numba.extending import register_jitable

from ematwin import numerics
from ematwin.files import written_whole
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
        made.compile = functools.partial(_loaded_or_compiled, made, made.compile)
    return made


def _loaded_or_compiled(made: Any, compile_it: Callable[[Any], Any], signature: Any) -> Any:
    """The entry of a loop for a signature; processes that need the same at once compile it once."""
    with global_compiler_lock, ExitStack() as stack:
        path = _file_of(made, signature)
        made._cache = NullCache() if path is None else _OneFile(path)
        if path is None or not path.exists():
            numerics.compiling()
            stack.enter_context(_turn(path))
        return compile_it(signature)


def _file_of(made: Any, signature: Any) -> Path | None:
    """The file for the machine code of a signature; None where nothing can be kept."""
    function, folder = made.py_func, own_folder()
    if folder is None or not os.path.exists(function.__code__.co_filename):
        return None
    name = f"{function.__module__}.{function.__qualname__}".replace("<locals>.", "")
    place = folder / name / content_of(made)
    with suppress(OSError):
        place.mkdir(parents=True, exist_ok=True)
        return place / f"{signature_of(signature)}.nbc"
    return None


class _OneFile(NullCache):
    """What numba asks for machine code, and gives it: that of one signature, in a file."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        with suppress(Exception):  # missing, or damaged (pickle raises anything): compile it
            # what it compiles from is loaded in a quarter of a second, and machine code needs none
            rtsys.initialize(target_context)
            return CompileResult._rebuild(target_context, *pickle.loads(self._path.read_bytes()))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if data.lifted or data.library.has_dynamic_globals:  # holds addresses of this process
            return
        with suppress(Exception):  # no room: the next process compiles it again
            with written_whole(self._path) as draft:
                draft.write_bytes(dumps(data._reduce()))
            _drop_stale(self._path.parent)


def _turn(path: Path | None) -> AbstractContextManager[Any]:
    """A lock that one process has at a time, for which others wait; it ends with its process."""
    if sys.platform == "win32" or path is None:
        return nullcontext()
    try:
        turn = path.with_suffix(".lock").open("wb")
    except OSError:
        return nullcontext()
    ends = time.monotonic() + 60.0  # s: the other may have been stopped
    while time.monotonic() < ends:
        with suppress(BlockingIOError):
            fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        time.sleep(0.05)
    return turn


def own_folder() -> Path | None:
    """The folder of machine code, which only the user can write; None where there cannot be one.

    ``ematwin`` in the user's folder for caches; where NUMBA_CACHE_DIR is set, which others may
    share, ``ematwin-<user id>`` in that.
    """
    home = os.path.expanduser("~")
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        folder = Path(given, f"ematwin-{os.geteuid()}" if _POSIX else "ematwin")
    elif sys.platform == "win32":
        folder = Path(os.environ.get("LOCALAPPDATA", home), "ematwin")
    elif sys.platform == "darwin":
        folder = Path(home, "Library", "Caches", "ematwin")
    else:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path(home, ".cache"), "ematwin")
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
        own = not _POSIX or (found.st_uid == os.geteuid() and not found.st_mode & 0o022)
        if stat.S_ISDIR(found.st_mode) and own:
            return folder
    return None


def _drop_stale(current: Path) -> None:
    """Remove what other sources of a loop compiled to a month ago."""
    for other in current.parent.iterdir():
        if other != current and other.stat().st_mtime < time.time() - 30 * 86_400.0:
            shutil.rmtree(other, ignore_errors=True)
