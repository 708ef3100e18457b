"""MATLAB files, version 4 to 7.3, through pymatreader.

Variables are read one by one as they are wanted. Fields of a structure are named
``run.signals.values``, columns of a matrix ``data[0]``, ``data[1]``.
"""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.recordings.formats.base import Progress, RecordedFile, as_float, load_library, refusing

_NUMERIC = {
    "double", "single", "logical",
    "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64",
}  # fmt: skip
MOST_COLUMNS = 64  # of a matrix that is taken for channels side by side


class MatFile(RecordedFile):
    """A MATLAB file; it states no units."""

    kind: ClassVar[str] = "mat"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._library = load_library("pymatreader", "pymatreader", "Reading MATLAB files")
        self._variable: dict[str, str] = {}  # channel -> variable that holds it
        self._lengths: dict[str, int] = {}
        for name, shape, kind in self._library.whosmat(path):
            found = (
                matrix_columns(name, shape)
                if kind in _NUMERIC
                else ((key, values.shape[0]) for key, values in self._fields(name))
            )
            for key, length in found:
                self._variable[key] = name
                self._lengths[key] = length

    @property
    def names(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(self._variable)

    def time_base(self, name: str) -> str:  # noqa: D102
        return f"{self._lengths[name]} samples"

    def read(  # noqa: D102
        self, names: Sequence[str], progress: Progress | None = None
    ) -> dict[str, np.ndarray]:
        columns: dict[str, np.ndarray] = {}
        variables = list(dict.fromkeys(self._variable[name] for name in names))
        with refusing(self.path, self.kind):
            for done, variable in enumerate(variables, start=1):
                fields = dict(self._fields(variable))
                for name in names:
                    if self._variable[name] == variable:
                        columns[name] = as_float(fields[name], name, self.path)
                if progress is not None:
                    progress(done / len(variables))
        return {name: columns[name] for name in names}

    def _fields(self, variable: str) -> Iterator[tuple[str, np.ndarray]]:
        with warnings.catch_warnings():
            # of objects of classes, which are not read here
            warnings.simplefilter("ignore")
            content = self._library.read_mat(self.path, variable_names=[variable])
        yield from _flat(content.get(variable), variable)


def matrix_columns(name: str, shape: Sequence[int]) -> list[tuple[str, int]]:
    """Channel names and lengths in an array: itself, or its columns ``name[k]``.

    A vector is one channel, standing or lying; a matrix of up to 64 columns is one for each.
    """
    sides = [side for side in shape if side != 1]
    if len(sides) == 1:
        return [(name, sides[0])]
    if len(sides) == 2 and sides[1] <= MOST_COLUMNS and sides[1] < sides[0]:
        return [(f"{name}[{k}]", sides[0]) for k in range(sides[1])]
    if len(sides) == 2 and sides[0] <= MOST_COLUMNS:
        return [(f"{name}[{k}]", sides[1]) for k in range(sides[0])]
    return []


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
