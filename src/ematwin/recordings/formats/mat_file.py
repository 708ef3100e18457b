"""MATLAB files, version 4 to 7.3, through pymatreader.

Variables are read one by one as they are wanted. Fields of a structure are named
``run.signals.values``, columns of a matrix ``data[0]``, ``data[1]``.
"""

import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.recordings.formats.base import RecordedFile, load_library, matrix_columns


class MatFile(RecordedFile):
    """A MATLAB file; it states no units."""

    kind: ClassVar[str] = "mat"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._library = load_library("pymatreader", "pymatreader", "Reading MATLAB files")
        self._fields: dict[str, np.ndarray] = {}  # of the variable that was read last
        for name, shape, kind in self._library.whosmat(path):
            found = (
                matrix_columns(name, shape)
                if re.fullmatch(r"double|single|logical|u?int\d+", kind)
                else ((key, values.shape[0]) for key, values in self._read(name))
            )
            for key, length in found:
                self.channels[key] = name
                self.bases[key] = f"{length} samples"

    def values(self, name: str) -> np.ndarray:  # noqa: D102
        if name not in self._fields:
            self._fields = dict(self._read(self.channels[name]))
        return self._fields[name]

    def _read(self, variable: str) -> Iterator[tuple[str, np.ndarray]]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of objects of classes, which are not read here
            content = self._library.read_mat(self.path, variable_names=[variable])
        yield from _flat(content.get(variable), variable)


def _flat(value: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _flat(part, f"{name}.{key}")
    elif isinstance(value, list):
        for n, part in enumerate(value):
            yield from _flat(part, f"{name}[{n}]")
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        names = matrix_columns(name, value.shape)
        if len(names) == 1:
            yield names[0][0], value.reshape(-1)
        elif names:
            columns = value.squeeze()
            columns = columns if columns.shape[1] == len(names) else columns.T
            for k, (key, _) in enumerate(names):
                yield key, columns[:, k]
