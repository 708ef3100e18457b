"""RecordedFile: an opened file of any format, with named channels to be read one by one.

Each format is one subclass in a file of its own; `open_file` chooses it by the suffix. A
format of someone else's is found by the entry point group ``ematwin.readers``, whose names are
suffixes without the dot. `ematwin.testing.reader_contract` holds the tests that each must pass.
"""

import difflib
import logging
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime, tzinfo
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Self

import numpy as np

from ematwin.errors import EmatwinError, FileError, InputError, MissingExtraError, RecordError
from ematwin.recordings.units import bare
from ematwin.showing.frames import is_frame

Progress = Callable[[float], None]
ENTRY_POINTS = "ematwin.readers"

_FORMATS = {
    ".csv": "ematwin.recordings.formats.csv_file:CsvFile",
    ".tsv": "ematwin.recordings.formats.csv_file:CsvFile",
    ".txt": "ematwin.recordings.formats.csv_file:CsvFile",
    ".parquet": "ematwin.recordings.formats.parquet_file:ParquetFile",
    ".mat": "ematwin.recordings.formats.mat_file:MatFile",
    ".mf4": "ematwin.recordings.formats.mdf_file:MdfFile",
    ".mdf": "ematwin.recordings.formats.mdf_file:MdfFile",
    ".tdms": "ematwin.recordings.formats.tdms_file:TdmsFile",
    ".h5": "ematwin.recordings.formats.hdf5_file:Hdf5File",
    ".hdf5": "ematwin.recordings.formats.hdf5_file:Hdf5File",
}


class RecordedFile(ABC):
    """An open file; a context manager. Opening reads no samples.

    Attributes
    ----------
    path : Path
    metadata : dict, what ematwin itself wrote into the file; empty for files of others
    assumed : list of str, sentences on what was taken for granted, for the provenance
    start : datetime or None, the moment from which the times of `base_time` are counted
    clocks : dict, the moment of the first sample of each channel of calendar times that was read
    """

    kind: ClassVar[str] = "file"  # for messages: "Cannot read run.mf4 as MDF"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, Any] = {}
        self.assumed: list[str] = []
        self.start: datetime | None = None
        self.clocks: dict[str, datetime] = {}

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Full names of the channels, each once, in the order of the file."""

    @abstractmethod
    def read(self, names: Sequence[str], progress: Progress | None = None) -> dict[str, np.ndarray]:
        """Values of some channels, and of no others, as the file holds them.

        Returns
        -------
        dict of (S,) float64 arrays, fresh ones, which the caller may overwrite
            Missing samples are NaN; calendar times are s since the first of them, which is put into
            `clocks`.
        """

    def texts(self, name: str) -> list[str]:
        """Values of a channel as texts, for labels such as a condition or the number of a run."""
        values = self.read([name])[name]
        # whole numbers in full: days such as 20261121 must stay apart
        return [f"{x:.0f}" if x == round(x, 0) else f"{x:g}" for x in values.tolist()]

    def unit(self, name: str) -> str | None:
        """Unit of a channel as the file states it; None where it states none."""
        return None

    def time_base(self, name: str) -> str:
        """Key of the time base of a channel: channels of one key were sampled together."""
        return ""

    def base_time(self, key: str) -> np.ndarray | None:
        """Times of a time base, s; None where the file gives time as a channel or not at all."""
        return None

    def close(self) -> None:  # noqa: B027  (most formats hold nothing open)
        """Release the file; may be called again."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def open_file(path: Any, **options: Any) -> RecordedFile:
    """Open a file by its suffix, or a DataFrame; ``options`` are those of text tables.

    Raises
    ------
    InputError
        If no reader knows the suffix, or the options are for another format.
    FileError
        If the file cannot be read, is truncated, or is not what its name says.
    MissingExtraError
        If the library for this format is not installed.
    """
    if is_frame(path):
        from ematwin.recordings.formats.frame import FrameFile

        if options:
            raise InputError(
                f"{', '.join(sorted(options))} can be given only for CSV files; a DataFrame is not "
                "one. Leave it out."
            )
        return FrameFile(path)
    path = Path(path)
    suffix = path.suffix.lower()
    maker = _maker(suffix)
    if maker is None:
        raise InputError(
            f"Cannot tell how to read {path}: its name must end in {', '.join(known_suffixes())}."
        )
    if not path.is_file():
        raise FileError(
            f"{path} is a folder; give a file." if path.is_dir() else f"There is no file {path}."
        )
    if options and suffix not in {".csv", ".tsv", ".txt"}:
        raise InputError(
            f"{', '.join(sorted(options))} can be given only for CSV files; {path} is not one. "
            "Leave it out."
        )
    with refusing(path, getattr(maker, "kind", suffix[1:])):
        opened: RecordedFile = maker(path, **options)
    return opened


def known_suffixes() -> list[str]:
    """Suffixes that can be read, those of installed plug-ins included."""
    return [*_FORMATS, *(f".{entry.name}" for entry in entry_points(group=ENTRY_POINTS))]


def _maker(suffix: str) -> Any:
    if suffix in _FORMATS:
        module, name = _FORMATS[suffix].split(":")
        return getattr(import_module(module), name)
    for entry in entry_points(group=ENTRY_POINTS):
        if f".{entry.name}" == suffix:
            return entry.load()
    return None


def load_library(module: str, package: str, purpose: str) -> Any:
    """Import the library of a format, or say how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise MissingExtraError(package, "io", purpose) from None


@contextmanager
def complaints(*loggers: str, level: int = logging.WARNING) -> Iterator[list[str]]:
    """Keep what a library logs off the screen, and collect what is at least of ``level``."""
    found: list[str] = []

    def keep(entry: logging.LogRecord) -> bool:
        if entry.levelno >= level:
            found.append(entry.getMessage().splitlines()[0])
        return False

    for name in loggers:
        logging.getLogger(name).addFilter(keep)
    try:
        yield found
    finally:
        for name in loggers:
            logging.getLogger(name).removeFilter(keep)


@contextmanager
def refusing(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into one sentence."""
    try:
        yield
    except EmatwinError:
        raise
    except MemoryError:
        raise FileError(f"{path} does not fit into memory; map fewer channels.") from None
    except PermissionError:
        raise FileError(f"{path} may not be read; ask its owner for permission.") from None
    except Exception as error:
        # the libraries report damage as ValueError, OSError, KeyError, struct.error and others
        text = str(error).strip() or type(error).__name__
        reason = text.splitlines()[0].rstrip(". ")
        raise FileError(
            f"Cannot read {path} as {kind}: {reason}. It may be truncated or of another kind."
        ) from None


def as_float(values: Any, name: str, path: Path) -> np.ndarray:
    """A fresh (S,) float64 array; clock times become seconds since the first of them.

    Raises
    ------
    RecordError
        If the channel holds something else than numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind == "M":
        array = (array - array[:1]).astype("timedelta64[ns]").astype(np.int64) * 1e-9
    elif array.dtype.kind == "m":
        array = array.astype("timedelta64[ns]").astype(np.int64) * 1e-9
    if array.dtype.kind not in "biuf":
        raise RecordError(
            f"Channel {name!r} of {path} must hold real numbers; it holds {array.dtype}. "
            "Choose another channel or export it as numbers."
        )
    return np.array(array, dtype=np.float64, order="C").reshape(-1)


def words(values: np.ndarray) -> list[str] | None:
    """Texts of an array that holds texts, bytes decoded; None if it holds something else."""
    if values.dtype.kind not in "SUO":
        return None
    items = values.reshape(-1).tolist()
    return [
        (one.decode("utf-8", "replace") if isinstance(one, bytes) else str(one)).strip("\0 ")
        for one in items
    ]


def moment(stamp: np.datetime64, zone: tzinfo | None = None) -> datetime | None:
    """A clock time as a datetime, to the microsecond; None for no time or one out of range."""
    found = stamp.astype("datetime64[us]").item()
    return found.replace(tzinfo=zone) if isinstance(found, datetime) else None


def find_channel(names: Sequence[str], wanted: str, path: Path) -> str:
    """The full name of the channel that ``wanted`` means.

    Compared one after the other, until exactly one fits: the full name; the name in another case;
    the last part of a path (``group/name``, ``struct.name``); either without the bracketed unit.

    Raises
    ------
    RecordError
        If no channel or more than one fits; the message names the closest.
    """
    if wanted in names:
        return wanted
    ways: tuple[Callable[[str], str], ...] = (
        str.casefold,
        lambda name: last_part(name).casefold(),
        lambda name: bare(name).casefold(),
        lambda name: bare(last_part(name)).casefold(),
    )
    target = {wanted.strip().casefold(), bare(wanted).casefold()}
    for way in ways:
        found = [name for name in names if way(name) in target]
        if len(found) == 1:
            return found[0]
        if found:
            raise RecordError(
                f"{path} has {len(found)} channels named {wanted!r}: {_listed(found)}. "
                "Give the full name."
            )
    close = closest(names, wanted)
    hint = f"the closest are {_listed(close)}" if close else f"it has {_listed(names)}"
    raise RecordError(f"{path} has no channel {wanted!r}; {hint}. Correct the name in the map.")


def last_part(name: str) -> str:
    """The last part of ``group/name`` or ``struct.name``, a unit such as ``[1/s]`` left whole."""
    head = bare(name)
    return re.split(r"[/.]", head)[-1] + name[len(head) :]


def closest(names: Sequence[str], wanted: str) -> list[str]:
    """Up to three names that resemble ``wanted``."""
    by_key = {last_part(name).casefold(): name for name in reversed(names)}
    keys = difflib.get_close_matches(wanted.casefold(), by_key, n=3, cutoff=0.5)
    return [by_key[key] for key in keys]


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:8])
    return f"{shown} and {len(names) - 8} more" if len(names) > 8 else shown or "no channels"
