"""What the machine code of a compiled function depends on.

numba compiles a function together with all that its global names stand for: other compiled
functions, inlined or called; the classes of named tuples; constants, which become numbers in the
machine code. `dependencies` follows these names through whatever files and packages they lead.

It stops at numba, numpy and the standard library, which count by their versions. What numba finds
by another way than a name, such as `numba.extending.overload`, is noticed only where it stands in
one of the files that the names lead to.
"""

import enum
import hashlib
import importlib.util
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

_COMPILES = ("compile.py", "compiler.py", "single.py")
_KNOWN_BY_VERSION = {"numba", "llvmlite", "numpy", *sys.stdlib_module_names}


@dataclass(frozen=True)
class Dependencies:
    """Hashes of what a function is compiled from.

    Attributes
    ----------
    sources : str, of the files that it stands in and leads to, and of the versions of what compiles
        them
    content : str, of what was loaded from them: byte code, options of the compiler, values of
        constants; a file that was edited after it was imported does not pass for what runs
    """

    sources: str
    content: str


def dependencies(compiled: Any) -> Dependencies:
    """Follow a function that numba compiles to all that it depends on."""
    walk = _Walk()
    walk.files.update(str(Path(__file__).with_name(name)) for name in _COMPILES)
    content = walk.text(compiled)
    files = "".join(f"{_file_hash(path)} " for path in sorted(walk.files))
    return Dependencies(_hash(_versions() + files), _hash(content))


@cache
def _versions() -> str:
    """Versions of what compiles, of numba and llvmlite without loading either."""
    found = [f"numpy {np.__version__}"]
    for package in ("numba", "llvmlite"):
        spec = importlib.util.find_spec(package)
        for place in () if spec is None else spec.submodule_search_locations or ():
            found.append(f"{package} {_file_hash(str(Path(place, '_version.py')))}")
    return ", ".join(found)


class _Walk:
    """One walk: the files that were passed, and a text for each value, the same in each process."""

    def __init__(self) -> None:
        self.files: set[str] = set()
        self._seen: dict[object, Any] = {}  # keeps what it names alive: an id is used again

    def text(self, value: Any, names: tuple[str, ...] = ()) -> str:
        """``value`` in words; of a module, what ``names`` stand for in it."""
        kind = f"{type(value).__module__}.{type(value).__qualname__}"
        if isinstance(value, enum.Enum):
            return f"{kind}.{value.name} {value.value!r}"
        if value is None or isinstance(value, (bool, int, float, complex, str, bytes)):
            return f"{kind} {value!r}"
        if isinstance(value, (np.ndarray, np.generic)):
            return f"{kind} {value.dtype} {value.shape} {_hash(value.tobytes())}"
        if isinstance(value, (tuple, list)):
            items = ", ".join(self.text(item) for item in value)
            return f"{kind} {getattr(value, '_fields', '')} ({items})"
        if isinstance(value, (set, frozenset)):
            return f"{kind} {sorted(self.text(item) for item in value)}"
        if isinstance(value, dict):
            return f"{kind} {sorted((self.text(k), self.text(v)) for k, v in value.items())}"
        if isinstance(value, CodeType):
            return self._code(value)
        return self._named(value, names)

    def _named(self, value: Any, names: tuple[str, ...]) -> str:
        """A function, class or module: in full where it is met first, else by its name."""
        is_module = isinstance(value, ModuleType)
        where = value.__name__ if is_module else str(getattr(value, "__module__", None))
        name = f"{where}.{getattr(value, '__qualname__', type(value).__qualname__)}"
        key = (id(value), names if is_module else None)
        if key in self._seen or where.partition(".")[0] in _KNOWN_BY_VERSION:
            return name
        self._seen[key] = value
        if is_module:
            self._file(where)
            parts = [self.text(vars(value)[n], names) for n in names if n in vars(value)]
        elif isinstance(getattr(value, "py_func", None), FunctionType):
            # ours (`ematwin.numerics.compile.Compiled`), or a dispatcher of numba
            compiler = getattr(getattr(value, "_compiler", None), "pipeline_class", None)
            ours = [getattr(value, name, None) for name in ("interleave", "single")]
            parts = [self.text(getattr(value, "targetoptions", None)), self.text(value.py_func)]
            parts += [self.text(compiler), self.text(ours)]
        elif isinstance(value, FunctionType):
            parts = self._function(value)
        elif isinstance(value, type):
            self._file(where)
            fields = [getattr(value, "_fields", None), getattr(value, "_field_defaults", None)]
            methods = [vars(value)[n] for n in sorted(vars(value)) if _is_code(vars(value)[n])]
            parts = [self.text(part) for part in (*fields, *value.__bases__, *methods)]
        else:  # an intrinsic of numba wraps its function; of anything else the type must do
            parts = [self.text(getattr(value, "__wrapped__", type(value)))]
        return f"{name} {{{'; '.join(parts)}}}"

    def _function(self, function: FunctionType) -> list[str]:
        self.files.add(function.__code__.co_filename)
        codes = _nested(function.__code__)
        names = tuple(sorted({name for code in codes for name in code.co_names}))
        parts = [self._code(function.__code__)]
        parts += [self.text(function.__defaults__), self.text(function.__kwdefaults__)]
        for name in names:
            if name in function.__globals__:
                parts.append(f"{name}: {self.text(function.__globals__[name], names)}")
        for cell in function.__closure__ or ():
            with suppress(ValueError):  # it is still empty
                parts.append(self.text(cell.cell_contents, names))
        return parts

    def _code(self, code: CodeType) -> str:
        constants = [self.text(constant) for constant in code.co_consts]
        variables = (code.co_names, code.co_varnames, code.co_cellvars, code.co_freevars)
        return f"code {code.co_code!r} {variables} {constants}"

    def _file(self, module: str) -> None:
        path = getattr(sys.modules.get(module), "__file__", None)
        if path is not None:
            self.files.add(path)


def _is_code(value: Any) -> bool:
    return isinstance(value, FunctionType) or hasattr(value, "py_func")


def _nested(code: CodeType) -> Iterator[CodeType]:
    """A code object and those of the functions, comprehensions and lambdas in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _nested(constant)


def _hash(text: str | bytes) -> str:
    return hashlib.sha256(text.encode() if isinstance(text, str) else text).hexdigest()[:16]


@cache
def _file_hash(path: str) -> str:
    """Hash of a file; of one that cannot be read, as within an archive, nothing is known."""
    try:
        return _hash(Path(path).read_bytes())
    except OSError:
        return ""
