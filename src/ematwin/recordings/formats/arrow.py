"""Numbers between pyarrow and numpy without pandas.

pyarrow imports pandas, where it is installed, at its first conversion to or from numpy; that takes
longer than reading a recording. Buffers of floats need no conversion.
"""

import math
from typing import Any

import numpy as np


def to_numpy(column: Any) -> np.ndarray:
    """Values (S,) of an array of pyarrow of floats, with NaN where it has nulls."""
    return np.from_dlpack(column.fill_null(math.nan) if column.null_count else column)


def from_numpy(values: Any) -> Any:
    """An array of pyarrow of a numpy array of floats; of anything else what pyarrow makes of it."""
    import pyarrow as pa

    if isinstance(values, np.ndarray) and values.dtype == np.float64 and values.ndim == 1:
        buffer = pa.py_buffer(np.ascontiguousarray(values))
        return pa.Array.from_buffers(pa.float64(), len(values), [None, buffer])
    return pa.array(values)
