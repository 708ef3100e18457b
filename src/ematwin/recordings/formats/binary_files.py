"""Formats that are read through a library of their own: Parquet, HDF5, MATLAB, ULog and MCAP.

Channels are named by their place in the file: a dataset by its path, a field of a structure
``run.signals.values``, a column of a matrix ``data[0]``, a field of a message ``topic/field``.
"""

import mmap
import re
import warnings
from collections.abc import Iterator, Mapping
from datetime import UTC
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError, RecordError
from ematwin.recordings.formats import base
from ematwin.recordings.formats.base import RecordedFile, load_library, matrix_columns, refusing
from ematwin.recordings.tables import KEY, NAT, checked, to_numpy


class ParquetFile(RecordedFile):
    """A Parquet file; units are taken from the field metadata ``unit`` where there is any."""

    kind: ClassVar[str] = "parquet"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        import pyarrow.parquet as pq

        # pages that were written without a checksum are read as they are
        self.handle = pq.ParquetFile(path, page_checksum_verification=True)
        schema = self.handle.schema_arrow
        notes = {key: note.decode("latin-1") for key, note in (schema.metadata or {}).items()}
        self.metadata = checked(notes.get(KEY.encode()), path, "".join(notes.values()))
        self.units = self.metadata.get("units", {})
        for field in schema:
            own = self.channels[field.name] = field.metadata or {}
            if not self.metadata and (unit := own.get(b"unit") or own.get(b"units")):
                self.units[field.name] = unit.decode()

    def values(self, name: str) -> np.ndarray:
        """Values (S,) of a column; moments and periods are s since the first of them."""
        column, rows = self.handle.read(columns=[name]).column(0), self.handle.metadata.num_rows
        if len(column) != rows:
            said = f"{self.path} promises {rows} rows of {name} and holds {len(column)}"
            raise FileError(f"{said}. It was damaged; copy it again.")
        return self._numbers(column.combine_chunks(), name)

    def texts(self, name: str) -> list[str]:  # noqa: D102
        import pyarrow as pa

        with refusing(self.path, self.kind):
            column = self.handle.read(columns=[name]).column(0)
            if pa.types.is_floating(column.type):
                return super().texts(name)
            return ["" if text is None else text for text in column.cast(pa.string()).to_pylist()]

    def close(self) -> None:
        """Close the file, and give back the memory that its pages were unpacked in."""
        import pyarrow as pa

        super().close()
        pa.default_memory_pool().release_unused()

    def _numbers(self, column: Any, name: str) -> np.ndarray:
        import pyarrow as pa

        kind = column.type
        if kind == pa.float64():
            return to_numpy(column)  # a cast would load what computes with columns
        is_moment = pa.types.is_timestamp(kind)
        if is_moment or pa.types.is_time(kind) or pa.types.is_duration(kind):
            in_ns = pa.time64("ns") if pa.types.is_time(kind) else pa.duration("ns")
            in_ns = pa.timestamp("ns", tz=kind.tz) if is_moment else in_ns
            ticks = column.cast(in_ns).cast(pa.int64()).fill_null(NAT)
            times = np.from_dlpack(ticks).view("datetime64[ns]")
            if is_moment:  # a time of day has no date
                self.note_clock(name, times, None if kind.tz is None else UTC)
            return base.as_float(times, name, self.path)
        try:
            return to_numpy(column.cast(pa.float64()))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            said = f"Column {name} of {self.path} must hold numbers; it holds {kind}"
            raise RecordError(f"{said}. Remove text and units from its rows.") from None


class Hdf5File(RecordedFile):
    """An HDF5 file; units are taken from the attribute ``unit`` or ``units`` of a dataset.

    A dataset of named fields gives ``path/field``.
    """

    kind: ClassVar[str] = "HDF5"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        h5py = load_library("h5py", "h5py", "Reading HDF5 files")
        self.handle = h5py.File(path, "r")
        self._heaps_checked = False
        try:
            self.handle.visititems(self._note)
        except BaseException:
            self.close()
            raise

    def unit(self, name: str) -> str | None:  # noqa: D102
        with refusing(self.path, self.kind):
            attributes = self.handle[self.channels[name][0]].attrs
            known = ("unit", "units", "Unit", "Units", "unit_string")
            key = next((key for key in known if key in attributes), None)
            if key is not None and not self._heaps_checked:
                kind = attributes.get_id(key).get_type()
                if hasattr(kind, "is_variable_str") and kind.is_variable_str():
                    _check_heaps(self.path)
                    self._heaps_checked = True
            text = None if key is None else attributes[key]
        return text.decode(errors="replace") if isinstance(text, bytes) else text and str(text)

    def values(self, name: str) -> Any:  # noqa: D102
        key, part = self.channels[name]
        return self.handle[key][part]

    def _note(self, key: str | bytes, item: Any) -> None:
        shape = getattr(item, "shape", None)
        # left out: names that are no text, groups, scalars, empty datasets
        if isinstance(key, bytes) or not shape:
            return
        for field in item.dtype.names or ():
            name = f"{key}/{field}"
            self.channels[name], self.bases[name] = (key, field), f"{np.prod(shape)} samples"
        if item.dtype.kind in "biuf":
            for name, length, index in matrix_columns(key, shape):
                self.channels[name], self.bases[name] = (key, index), f"{length} samples"


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
                    said = "its heap of texts is damaged. Copy it again."
                    raise FileError(f"Cannot read {path} as HDF5: {said}")
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
            if re.fullmatch(r"double|single|logical|u?int\d+", kind):
                found = [(key, length) for key, length, _ in matrix_columns(name, shape)]
            else:
                found = [(key, values.shape[0]) for key, values in self._read(name)]
            for key, length in found:
                self.channels[key], self.bases[key] = name, f"{length} samples"

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
        for key, part in sorted(value.items()):  # pymatreader gives fields in an order of chance
            yield from _flat(part, f"{name}.{key}")
    elif isinstance(value, list):
        for n, part in enumerate(value):
            yield from _flat(part, f"{name}[{n}]")
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        for key, _, index in matrix_columns(name, value.shape):
            yield key, value[index].reshape(-1)


class ULogFile(RecordedFile):
    """A ULog file; instances of a topic after the first are ``topic.1/field``."""

    kind: ClassVar[str] = "ULog"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        library = load_library("pyulog", "pyulog", "Reading ULog files")
        log = library.ULog(str(path))
        self._topics: dict[str, dict[str, np.ndarray]] = {}
        for one in log.data_list:
            topic = f"{one.name}.{one.multi_id}" if one.multi_id else one.name
            self._topics[topic] = one.data
        for topic, data in self._topics.items():
            for field in (field for field in data if field != "timestamp"):
                name = f"{topic}/{field}"
                self.channels[name], self.bases[name] = (topic, field), topic
        if log.file_corruption or not self.channels:
            why = "it is damaged" if log.file_corruption else "it holds no messages"
            raise FileError(f"Cannot read {path} as ULog: {why}. Copy it from the vehicle again.")
        if not _ends_with_a_message(path):
            last = max(float(data["timestamp"][-1]) for data in self._topics.values())
            said = f"the log {path.name} ends within a message, as after a loss of power"
            read = f"it was read up to {1e-6 * last:.6g} s of the system's clock"
            self.assumed.append(f"{said}: {read}")

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        # us since the start of the system
        return np.asarray(self._topics[key]["timestamp"], dtype=np.float64) * 1e-6

    def values(self, name: str) -> Any:  # noqa: D102
        topic, field = self.channels[name]
        return self._topics[topic][field]


def _ends_with_a_message(path: Path) -> bool:
    """Whether the last message is whole: 16 bytes, then size (2 bytes), kind (1) and content."""
    place, size = 16, path.stat().st_size  # behind the header
    with path.open("rb") as file:
        while place + 3 <= size:
            file.seek(place)
            place += 3 + int.from_bytes(file.read(2), "little")
    return place == size


class McapFile(RecordedFile):
    """An MCAP file; arrays give ``field[k]``, a joint state ``field[joint]``.

    Times come from the header of a message where it has one, else from the log.
    """

    kind: ClassVar[str] = "MCAP"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        reader = load_library("mcap_ros2.reader", "mcap-ros2-support", "Reading MCAP files")
        found: dict[tuple[str, str], list[float]] = {}  # by topic and field
        self._times: dict[str, list[float]] = {}
        for one in reader.read_ros2_messages(str(path)):
            topic, message = one.channel.topic, one.ros_msg
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            logged = one.log_time_ns * 1e-9
            told = logged if stamp is None else stamp.sec + 1e-9 * stamp.nanosec
            self._times.setdefault(topic, []).append(told or logged)
            for field, value in _numbers(message):
                found.setdefault((topic, field), []).append(value)
        for (topic, field), values in found.items():
            if len(values) == len(self._times[topic]):
                name = f"{topic}/{field}"
                self.channels[name], self.bases[name] = values, topic
        if not found:
            raise FileError(
                f"{path} holds no numbers in messages of ROS 2. Messages of other kinds, and bags "
                "in SQLite (.db3), are converted by ros2 bag convert."
            )

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        times = np.array(self._times[key])
        return times - times[0] if times[0] > 1e8 else times  # a moment, not a time of a run

    def values(self, name: str) -> Any:  # noqa: D102
        return np.array(self.channels[name])


def _numbers(message: Any, before: str = "") -> Iterator[tuple[str, float]]:
    """Yield name and value of each number in a message, but for its header."""
    joints: Any = getattr(message, "name", None)
    for field in getattr(message, "__slots__", ()):
        value = getattr(message, field)
        if field == "header":
            continue
        if isinstance(value, bool | int | float):
            yield f"{before}{field}", float(value)
        # a short array is channels side by side
        elif isinstance(value, list | tuple) and len(value) <= 64:
            named = isinstance(joints, list) and len(joints) == len(value)
            for key, one in zip(joints if named else range(len(value)), value, strict=True):
                if isinstance(one, bool | int | float):
                    yield f"{before}{field}[{key}]", float(one)
        elif hasattr(value, "__slots__"):
            yield from _numbers(value, f"{before}{field}/")
