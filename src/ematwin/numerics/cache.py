"""What was compiled, kept on disk for the next process: never out of date, and nobody else's.

numba keeps an index beside its data files, and saves the index first: a process that starts in
between, or one that is stopped there, leaves a fresh index over stale or foreign machine code. It
also notices a change only in the file of the compiled loop, not in the steps inlined into it.

Here each result lies in a file of its own, whose name is the hash of all that it depends on: the
sources of the loop and of all that it calls, in whatever package they stand
(`ematwin.numerics.dependencies`), the versions of numba and llvmlite, the signature and the
processor. What is found under a name can only be what belongs there, in whatever order it was
written.

Loading it runs it: machine code, wrapped in a pickle. So the files lie in a folder of the user's
own (0700, files 0600) within numba's cache folder, which others may share. Where that folder is a
link, belongs to another user or can be written by the group or others, it is neither read nor
written; nor is such a file in it. The function is compiled anew then, and also whenever a file is
damaged or cannot be used for any other reason. Systems without POSIX rights skip these checks:
there, set NUMBA_CACHE_DIR to a folder that only you can write.
"""

import hashlib
import io
import os
import pickle
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import llvmlite.binding
from numba.core import types
from numba.core.caching import FunctionCache, _cache_log
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.core.serialize import dumps

from ematwin.files import written_whole
from ematwin.numerics.claim import Claim
from ematwin.numerics.dependencies import Dependencies, dependencies
from ematwin.numerics.notice import compiling

_DIGEST = hashlib.sha256().digest_size
_POSIX = os.name == "posix"
_OWN_FOLDER = f"ematwin-{os.geteuid()}" if _POSIX else "ematwin"
_FOR_READING = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class NamedByContent:
    """One file for each result; replaces numba's index and data files.

    Parameters
    ----------
    folder : str or Path, numba's cache folder for the function; the files lie in a folder of the
        user's own in it
    function : str, name of the function, its line and the version of Python, as numba puts them
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

    def load(self, key: Any) -> Any:
        """What was compiled for ``key``, or None."""
        try:
            path = self.path(key)
            if not _is_own_folder(self.folder):
                return None
            content = _read_own(path)
            digest, data = content[:_DIGEST], content[_DIGEST:]
            if hashlib.sha256(data).digest() != digest:
                return None
            loaded = _Unpickler(io.BytesIO(data)).load()
            _cache_log("[cache] data loaded from %r", str(path))
            return loaded
        except Exception:
            return None  # missing, damaged or foreign (pickle raises anything): compile again

    def save(self, key: Any, data: Any) -> None:
        """Keep what was compiled for ``key``; drop what other sources compiled to."""
        content = dumps(data)
        path = self.path(key)
        with suppress(OSError):  # full, read-only or foreign: the next process compiles again
            self.folder.mkdir(mode=0o700, exist_ok=True)
            if not _is_own_folder(self.folder):
                return
            if os.path.lexists(path) and not _is_own(path.lstat()):
                return
            with written_whole(path, private=True) as draft:
                draft.write_bytes(hashlib.sha256(content).digest() + content)
            _cache_log("[cache] data saved to %r", str(path))
            for other in () if self._variants else self._out_of_date():
                other.unlink(missing_ok=True)

    def claim(self, key: Any) -> Claim | None:
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

    def stamp(self, key: Any) -> tuple[int, int] | None:
        """What tells a file of ``key`` from a later one; None where there is none."""
        try:
            found = self.path(key).lstat()
        except Exception:  # no file, or none that can be named: whoever loads it sees
            return None
        return found.st_ino, found.st_mtime_ns

    def path(self, key: Any) -> Path:
        """The file of ``key``."""
        depends_on = self._dependencies()
        text = f"{depends_on.content} {key!r} {[*_field_names(key)]}"
        number = hashlib.sha256(text.encode()).hexdigest()[:16]
        return self.folder / f"{self._function}.{depends_on.sources}.{number}.nbc"

    def flush(self) -> None:
        """Nothing is held in memory."""

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


class _Unpickler(pickle.Unpickler):
    """Reads machine code without loading the parts of numba that it was compiled from."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("numba.core.environment", "_rebuild_env"):
            return _environment
        return super().find_class(module, name)


def _environment(module: str, constants: list[Any], name: str) -> Environment:
    """The environment that machine code asks for by its name.

    Of the module only code that runs in the interpreter would see more than the constants, and
    loops have none. numba imports it, for `numpy.empty` all that compiles arrays and strings.
    """
    found = lookup_environment(name)
    if found is None:
        found = Environment(vars(sys.modules[module]) if module in sys.modules else {})
        found.consts[:] = constants
        found.env_name = name
        Environment._memo[name] = found
    return found


class _Cache(FunctionCache):
    """numba's cache of a function, with files named by their content.

    numba has no public way to this (checked with numba 0.61 to 0.68).
    """

    def __init__(self, compiled: Any) -> None:
        super().__init__(compiled.py_func)
        self._cache_file = NamedByContent(
            self._cache_path,
            self._impl.filename_base,
            lambda: dependencies(compiled),
            variants=compiled.py_func.__closure__ is not None,
        )
        self._claim: Claim | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled, without all that numba loads and compiles to compile anything.

        That is most of its start. What machine code needs of numba's runtime beyond C functions was
        linked into it when it was compiled.
        """
        key = self._index_key(sig, target_context.codegen())
        before = self._cache_file.stamp(key)
        found = self._loaded(sig, target_context)
        if found is None:
            compiling()
            self._release()  # of what could not be compiled
            self._claim = self._cache_file.claim(key)
            if self._cache_file.stamp(key) != before:  # another process has kept it meanwhile
                found = self._loaded(sig, target_context)
        if found is None:
            target_context.refresh()
        else:
            self._release()
        return found

    def _loaded(self, sig: Any, target_context: Any) -> Any:
        try:
            _add_runtime_symbols()
            return self._load_overload(sig, target_context)
        except Exception:
            target_context.refresh()
            with suppress(Exception):  # sound data that this process cannot use: compile again
                return self._load_overload(sig, target_context)
            return None

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        """Machine code from disk, its bitcode parsed only where a loop that is compiled calls it.

        numba parses all of it and goes through its symbols, which takes longer than all else here.
        """
        kept = self._cache_file.load(self._index_key(sig, target_context.codegen()))
        if kept is None:
            return None
        (name, kind, (code, bitcode)), function, *rest = kept
        library = name, kind, (code, _defining(function))
        found = self._impl.rebuild(target_context, (library, function, *rest))
        found.library._get_module_for_linking = partial(llvmlite.binding.parse_bitcode, bitcode)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            with suppress(OSError):
                super().save_overload(sig, data)
        finally:
            self._release()

    def _release(self) -> None:
        """Let other processes compile it, or load what was saved."""
        if self._claim is not None:
            self._claim.release()
            self._claim = None

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        # numba adds a hash of the closure, which it pickles differently in each process; the
        # dependencies hold what is in it.
        return sig, codegen.magic_tuple()


def _add_runtime_symbols() -> None:
    """Tell LLVM where the C functions of numba's runtime are, by the names numba gives them."""
    for name, address in _nrt_python.c_helpers.items():
        llvmlite.binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


def _defining(function: Any) -> bytes:
    """Bitcode that defines the names by which numba asks for a function, and does nothing."""
    names = (function.llvm_func_name, function.llvm_cpython_wrapper_name)
    empty = "\n".join(f'define void @"{name}"() {{ ret void }}' for name in names)
    return llvmlite.binding.parse_assembly(empty).as_bitcode()


def keep(compiled: Any) -> None:
    """Let the results of a function of ``numba.njit`` be kept on disk.

    Nothing happens where no folder can be written, neither beside the source nor in a home, and
    where NUMBA_DISABLE_JIT is set.
    """
    if hasattr(compiled, "py_func"):
        with suppress(RuntimeError):  # no folder
            compiled._cache = _Cache(compiled)


def _field_names(key: Any) -> Iterator[str]:
    """Fields of the named tuples in a signature: numba counts them by place, and so must we."""
    if isinstance(key, (types.NamedTuple, types.NamedUniTuple)):
        yield f"{key.instance_class.__module__}.{key.instance_class.__qualname__}{key.fields}"
    if isinstance(key, (tuple, types.Tuple, types.NamedTuple)):
        for part in key:
            yield from _field_names(part)
    elif isinstance(key, (types.UniTuple, types.NamedUniTuple)):
        yield from _field_names(key.dtype)
    elif isinstance(key, types.Optional):
        yield from _field_names(key.type)


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
