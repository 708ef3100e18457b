"""What was compiled, kept on disk for the next process: safe to share, never out of date.

numba keeps an index beside its data files, and saves the index first: a process that starts in
between, or one that is stopped there, leaves a fresh index over stale or foreign machine code. It
also notices a change only in the file of the compiled loop, not in the steps inlined into it.

Here each result lies in a file of its own, whose name is the hash of all that it depends on: every
kernel source, the versions of numba and llvmlite, the signature and the processor. What is found
under a name can only be what belongs there, whoever wrote it and in whatever order.
"""

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import IndexDataCacheFile


@cache
def sources_stamp() -> str:
    """Hash of all kernel sources and of what compiles them."""
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__}".encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


class NamedByContent(IndexDataCacheFile):
    """One file for each result; replaces numba's index and data files."""

    def __init__(self, folder: str, function: str) -> None:
        super().__init__(folder, f"{function}.{sources_stamp()}", sources_stamp())
        name, _, line_and_python = function.rpartition("-")
        self._family = f"{name}-*.{line_and_python.partition('.')[2]}.*.nbc"

    def load(self, key: Any) -> Any:
        """What was compiled for ``key``, or None."""
        try:
            return self._load_data(self._name(key))
        except Exception:
            return None  # missing or damaged (pickle raises anything): it is compiled again

    def save(self, key: Any, data: Any) -> None:
        """Keep what was compiled for ``key``; drop what other sources compiled to."""
        name = self._name(key)
        try:
            self._save_data(name, data)
            for path in Path(self._cache_path).glob(self._family):
                if f".{sources_stamp()}." not in path.name:
                    path.unlink(missing_ok=True)
        except OSError:
            return  # full or read-only: the next process compiles again

    def _name(self, key: Any) -> str:
        return self._data_name(int(hashlib.sha256(repr(key).encode()).hexdigest()[:12], 16))


def keep(compiled: Any) -> None:
    """Let a function of ``numba.njit(cache=True)`` be kept by `NamedByContent`.

    numba has no public way to this (checked with numba 0.61 to 0.68).
    """
    own = getattr(compiled, "_cache", None)
    if own is not None:  # there is none where NUMBA_DISABLE_JIT is set
        own._cache_file = NamedByContent(own.cache_path, own._impl.filename_base)
