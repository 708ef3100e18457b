"""Files of arrays: HDF5, through h5py, and MATLAB 4 to 7.3, through pymatreader.

Datasets are named by their path, fields of a structure ``run.signals.values``, columns of a matrix
``data[0]``, ``data[1]``.
"""

import mmap
import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError
from ematwin.recordings.formats.base import RecordedFile, load_library, matrix_columns, refusing


class Hdf5File(RecordedFile):
    """An HDF5 file; units are taken from the attribute ``unit`` or ``units`` of a dataset.

    A dataset of named fields gives ``path/field``.
    """

    kind: ClassVar[str] = "HDF5"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        h5py = load_library("h5py", "h5py", "Reading HDF5 files")
        self._file = h5py.File(path, "r")
        self._heaps_checked = False
        try:
            self._file.visititems(self._note)
        except BaseException:
            self._file.close()
            raise

    def unit(self, name: str) -> str | None:  # noqa: D102
        with refusing(self.path, self.kind):
            attributes = self._file[self.channels[name][0]].attrs
            known = ("unit", "units", "Unit", "Units", "unit_string")
            key = next((key for key in known if key in attributes), None)
            if key is not None and not self._heaps_checked:
                self._heaps_checked = True
                kind = attributes.get_id(key).get_type()
                if hasattr(kind, "is_variable_str") and kind.is_variable_str():
                    _check_heaps(self.path)
            text = None if key is None else attributes[key]
        return text.decode(errors="replace") if isinstance(text, bytes) else text and str(text)

    def close(self) -> None:  # noqa: D102
        self._file.close()

    def values(self, name: str) -> Any:  # noqa: D102
        key, part = self.channels[name]
        return self._file[key][part]

    def _note(self, key: str | bytes, item: Any) -> None:
        shape = getattr(item, "shape", None)
        # left out: names that are no text, groups, scalars, empty datasets
        if isinstance(key, bytes) or not shape:
            return
        for field in item.dtype.names or ():
            name = f"{key}/{field}"
            self.channels[name], self.bases[name] = (key, field), f"{np.prod(shape)} samples"
        if item.dtype.kind in "biuf":
            found = matrix_columns(key, shape)
            for k, (name, length) in enumerate(found):
                lying = shape[0] != length
                part = np.s_[:] if len(found) == 1 else np.s_[k, :] if lying else np.s_[:, k]
                self.channels[name], self.bases[name] = (key, part), f"{length} samples"


def _check_heaps(path: Path) -> None:
    """Refuse a file with a global heap, where texts lie, that HDF5 2.0 would read without end.

    It steps over the free space of a heap by the size that stands there, also if that is zero.
    HDF5 File Format Specification 3.0, III.E.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:

        def number(place: int, size: int) -> int:
            return int.from_bytes(content[place : place + size], "little")

        start = content.find(b"GCOL\x01\0\0\0")
        while start >= 0:
            place = start + 16
            end = min(start + number(start + 8, 8), len(content))
            while place + 16 <= end:
                size = number(place + 8, 8)
                step = 16 + (size + 7) // 8 * 8 if number(place, 2) else size
                if step == 0:
                    raise FileError(
                        f"Cannot read {path} as HDF5: its heap of texts is damaged. Copy it again."
                    )
                place += step
            start = content.find(b"GCOL\x01\0\0\0", start + 4)


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
