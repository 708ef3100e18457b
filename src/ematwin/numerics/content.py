"""Names for everything that the machine code of a loop depends on, the same in each process.

numba compiles a function together with all that its global names stand for: other compiled
functions, inlined or called; constants, which become numbers in the machine code; the classes of
named tuples, whose fields it counts by their place. `content_of` follows these names through
whatever files and packages they lead to, by the loaded code: a file that was edited after its
import does not count. numba, numpy and the standard library count by their
versions.
"""

import hashlib
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.registry import cpu_target

_BY_VERSION = {"numba", "llvmlite", "numpy", *sys.stdlib_module_names}


def content_of(compiled: Any) -> str:
    """A name for the sources, versions and processor that a compiled function depends on."""
    return digest(f"{_surroundings()} {_Walk().text(compiled)}")


def signature_of(arguments: Any) -> str:
    """A name for numba's types of arguments, with the fields of those that are named tuples."""
    return digest(" ".join(map(_type_text, arguments)))


@cache
def _surroundings() -> str:
    host = cpu_target.target_context.codegen().magic_tuple()
    versions = (sys.implementation.cache_tag, numba, llvmlite, np)
    ours = [Path(__file__).with_name(name).read_bytes() for name in ("compile.py", "lanes.py")]
    return f"{host} {[getattr(one, '__version__', one) for one in versions]} {ours}"


def _type_text(found: Any) -> str:
    cls = getattr(found, "instance_class", None)
    if cls is None:
        return str(found)
    held = " ".join(map(_type_text, found))
    return f"{cls.__module__}.{cls.__qualname__}{getattr(cls, '_fields', '')}({held})"


class _Walk:
    """One walk from a function: a text for each value that it leads to."""

    def __init__(self) -> None:
        self._seen: dict[int, Any] = {}  # keeps what it names alive: an id is used again

    def text(self, value: Any, names: frozenset[str] = frozenset()) -> str:
        """``value`` in words; of a module, what ``names`` stand for in it."""
        if isinstance(value, (tuple, list)):
            return f"({', '.join(self.text(item) for item in value)})"
        if isinstance(value, (set, frozenset)):
            return f"{sorted(self.text(item) for item in value)}"
        if isinstance(value, dict):
            return f"{[(key, self.text(value[key])) for key in sorted(value)]}"
        if isinstance(value, CodeType):
            parts = value.co_consts, value.co_names, value.co_varnames, value.co_freevars
            return f"{value.co_code!r} {self.text(parts)}"
        if isinstance(value, np.ndarray):
            return f"{value.dtype} {value.shape} {digest(value.tobytes())}"
        if isinstance(value, (ModuleType, FunctionType, type)) or hasattr(value, "py_func"):
            return self._named(value, names)
        return repr(value)

    def _named(self, value: Any, names: frozenset[str]) -> str:
        """A module, function or class: in full where it is met first, else by its name."""
        module = isinstance(value, ModuleType)
        where = value.__name__ if module else str(value.__module__)
        name = where if module else f"{where}.{value.__qualname__}"
        if where.partition(".")[0] in _BY_VERSION or id(value) in self._seen:
            return name
        if module:
            held = vars(value)
            return f"{name} {[self.text(held[n]) for n in sorted(names) if n in held]}"
        self._seen[id(value)] = value
        if isinstance(value, type):
            return f"{name} {getattr(value, '_fields', '')}"
        function = getattr(value, "py_func", value)
        options = [getattr(value, name, None) for name in ("targetoptions", "over_lanes")]
        used = frozenset(n for code in _nested(function.__code__) for n in code.co_names)
        held = function.__globals__
        parts = [function.__code__, function.__defaults__, options]
        parts += [cell.cell_contents for cell in function.__closure__ or ()]
        found = [self.text(part) for part in parts]
        return f"{name} {found} {[self.text(held[n], used) for n in sorted(used) if n in held]}"


def _nested(code: CodeType) -> Iterator[CodeType]:
    """A code object and the code objects of functions and comprehensions in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _nested(constant)


def digest(text: str | bytes) -> str:
    """A short hash."""
    return hashlib.sha256(text.encode() if isinstance(text, str) else text).hexdigest()[:20]
