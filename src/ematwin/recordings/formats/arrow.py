"""Numbers between pyarrow and numpy without pandas.

pyarrow imports pandas, where it is installed, at its first conversion to or from numpy; that takes
longer than reading a recording. Buffers of floats need no conversion.
"""

from typing import Any

import numpy as np


def as_floats(column: Any) -> np.ndarray:
    """An array of pyarrow of floats (S,), with NaN where it has nulls."""
    validity, values = column.buffers()
    if values is None:
        return np.full(len(column), np.nan)
    part = slice(column.offset, column.offset + len(column))
    found = np.frombuffer(values, dtype=np.float64)[part]
    if validity is None or column.null_count == 0:
        return found
    bits = np.unpackbits(np.frombuffer(validity, dtype=np.uint8), bitorder="little")[part]
    return np.where(bits, found, np.nan)


def as_integers(column: Any) -> np.ndarray:
    """An array of pyarrow of 64-bit integers without nulls, such as clock times."""
    if column.null_count:
        return np.asarray(column.to_numpy(zero_copy_only=False))
    values = column.buffers()[1]
    if values is None:
        return np.empty(0, dtype=np.int64)
    return np.frombuffer(values, dtype=np.int64)[column.offset : column.offset + len(column)]


def from_numpy(values: Any) -> Any:
    """An array of pyarrow of a numpy array of floats; of anything else what pyarrow makes of it."""
    import pyarrow as pa

    if isinstance(values, np.ndarray) and values.dtype == np.float64 and values.ndim == 1:
        buffer = pa.py_buffer(np.ascontiguousarray(values))
        return pa.Array.from_buffers(pa.float64(), len(values), [None, buffer])
    return pa.array(values)
