"""What kind of thing an argument of a compiled function is: what machine code is made for.

The same words from a value, without numba, and from numba's type of it (`kind_of_type`), so that
what one process compiled is found by another that does not load numba.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numba.core import types

Kind = str | tuple[Any, ...]
"""A word; or of a tuple its class and the kinds of what it holds."""

_INTEGERS = range(-(2**63), 2**63)
_WORDS: dict[type, str] = {float: "<f8", complex: "<c16", bool: "|b1", type(None): "none"}


class UnknownKindError(Exception):
    """A kind that only numba knows; caught within `ematwin.numerics`."""


def kind(value: Any) -> Kind:
    """The kind of a value.

    Raises
    ------
    UnknownKindError
        If it is neither a number, an array of numbers, None, nor a tuple of such.
    """
    cls = type(value)
    if (word := _WORDS.get(cls)) is not None:
        return word
    if cls is np.ndarray:
        flags = value.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        if value.dtype.kind not in "biufc":
            raise UnknownKindError
        return f"{value.dtype.str}{value.ndim}{layout}{'w' if flags.writeable else 'r'}"
    if isinstance(value, tuple):
        return cls, *map(kind, value)
    if cls is int and value in _INTEGERS:
        return "<i8"
    if isinstance(value, np.generic) and value.dtype.kind in "biufc":
        return value.dtype.str
    raise UnknownKindError


def kind_of_type(found: "types.Type") -> Kind:
    """The kind of the values that numba takes for one of its types."""
    from numba.core import types
    from numba.np.numpy_support import as_dtype

    if isinstance(found, types.NoneType):
        return "none"
    if isinstance(found, (types.Float, types.Integer, types.Boolean, types.Complex)):
        return np.dtype(as_dtype(found)).str
    if type(found) is types.Array and found.aligned:
        dtype = np.dtype(as_dtype(found.dtype)).str
        return f"{dtype}{found.ndim}{found.layout}{'w' if found.mutable else 'r'}"
    if isinstance(found, types.BaseTuple):
        held: Any = found
        return getattr(found, "instance_class", tuple), *map(kind_of_type, held)
    return f"numba {found}"


def text(found: Kind) -> str:
    """A kind in words that are the same in each process."""
    if isinstance(found, str):
        return found
    cls, *held = found
    fields = getattr(cls, "_fields", "")  # machine code counts them by their place
    return f"{cls.__module__}.{cls.__qualname__}{fields}({' '.join(map(text, held))})"
