"""RecordedFile: an opened file of any format, with named channels to be read one by one.

Each format is one subclass; `open_file` chooses it by the suffix. A format of someone else's is
found by the entry point group ``ematwin.readers``, whose names are suffixes without the dot.
`ematwin.testing.reader_contract` holds the tests that each must pass.
"""

import csv
import gzip
import logging
import shutil
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime, tzinfo
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Self

import numpy as np

from ematwin.errors import EmatwinError, FileError, InputError, MissingExtraError, RecordError
from ematwin.recordings.tables import verify
from ematwin.recordings.words import says_nothing
from ematwin.showing.results import is_frame

Progress = Callable[[float], None]
ENTRY_POINTS = "ematwin.readers"
_TEXT = (".csv", ".tsv", ".txt")
_PACKED = (".gz", ".zip", ".xlsx", ".xlsm")  # read as what they hold
_FORMATS = {
    **dict.fromkeys(_TEXT, "csv_file:CsvFile"),
    ".parquet": "binary_files:ParquetFile",
    ".mat": "binary_files:MatFile",
    **dict.fromkeys((".mf4", ".mdf"), "group_files:MdfFile"),
    ".tdms": "group_files:TdmsFile",
    **dict.fromkeys((".h5", ".hdf5"), "binary_files:Hdf5File"),
    ".ulg": "binary_files:ULogFile",
    ".mcap": "binary_files:McapFile",
    **dict.fromkeys(_PACKED, "base:open_packed"),
}
_ELSEWHERE = {
    **dict.fromkeys((".xls", ".ods"), "Save it as .xlsx or .csv."),
    ".db3": "Convert the bag: ros2 bag convert, with storage_id: mcap.",
    ".bag": "Convert the bag of ROS 1: rosbags-convert, then ros2 bag convert to MCAP.",
    ".bin": "Convert the log of ArduPilot: mavlogdump.py --format csv.",
    **dict.fromkeys((".tcscopex", ".svdx"), "Export it from the TwinCAT Scope as CSV."),
    ".blf": "Convert the log to MDF or CSV, as python-can or CANalyzer do.",
    ".slx": "Give the recorded signals, in a .mat file.",
}


class RecordedFile:
    """An open file; a context manager. Opening reads no samples.

    A format gives `channels` and `values`, or `names` and `read` where its library reads several
    channels at once.
    """

    kind: ClassVar[str] = "file"  # for messages: "Cannot read run.mf4 as MDF"
    zone: ClassVar[tzinfo | None] = None  # of its calendar times

    def __init__(self, path: Path) -> None:
        self.path = path
        self.given = path  # by the user: the packed file that holds ``path``, if any
        # by full name where the channel lies in the file, in the order of the file
        self.channels: dict[str, Any] = {}
        self.units: dict[str, str] = {}  # of channels, where the file states them
        # keys of the time bases of channels: those of one key were sampled together
        self.bases: dict[str, str] = {}
        self.metadata: dict[str, Any] = {}  # what ematwin itself wrote into the file
        self.assumed: list[str] = []  # sentences for the provenance
        self.start: datetime | None = None  # from which the times of `base_time` are counted
        self.clocks: dict[str, datetime] = {}  # when channels of calendar times began, if read
        self.unpacked: Any = None  # the temporary folder of what a packed file holds
        self.handle: Any = None  # what a library opened, which is closed with the file

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of the channels, each once, in the order of the file."""
        return tuple(self.channels)

    def values(self, name: str) -> Any:
        """Values of a channel as the library of the format gives them."""
        return self.read([name])[name]

    def read(self, names: Sequence[str], progress: Progress | None = None) -> dict[str, np.ndarray]:
        """Values of some channels, and of no others, as the file holds them.

        Gives fresh (S,) float64 arrays, which the caller may overwrite. Missing samples are NaN;
        calendar times are s since the first of them, which is put into `clocks`.
        """
        if type(self).values is RecordedFile.values:
            raise NotImplementedError(f"{type(self).__name__} gives neither values nor read")
        columns: dict[str, np.ndarray] = {}
        with refusing(self.path, self.kind):
            for done, name in enumerate(names, start=1):
                found = np.asarray(self.values(name))
                if found.dtype.kind == "M":
                    self.note_clock(name, found, self.zone)
                columns[name] = as_float(found, name, self.path)
                if progress is not None:
                    progress(done / len(names))
        verify(columns, self.metadata, self.path)
        return columns

    def texts(self, name: str) -> list[str]:
        """Values of a channel as texts, for labels such as a condition or the number of a run."""
        with refusing(self.path, self.kind):
            values = np.asarray(self.values(name)).reshape(-1)
        if values.dtype.kind in "SUO":
            texts = (
                one.decode("utf-8", "replace") if isinstance(one, bytes) else str(one)
                for one in values.tolist()
            )
            return [text.strip("\0 ") for text in texts]
        numbers = as_float(values, name, self.path).tolist()
        # whole numbers in full: days such as 20261121 must stay apart
        return [f"{x:.0f}" if x == round(x, 0) else f"{x:g}" for x in numbers]

    def unit(self, name: str) -> str | None:
        """Unit of a channel as the file states it; None where it states none."""
        return self.units.get(name) or None

    def stated_unit(self, name: str) -> str:
        """Unit of a channel; "" where the file states none, or a dash."""
        stated = (self.unit(name) or "").strip()
        return "" if says_nothing(stated) else stated

    def time_base(self, name: str) -> str:
        """Key of the time base of a channel."""
        return self.bases.get(name, "")

    def base_time(self, key: str) -> np.ndarray | None:
        """Times of a time base, s; None where the file gives time as a channel or not at all."""
        return None

    def close(self) -> None:
        """Release the file; may be called again."""
        if self.handle is not None:
            self.handle.close()
            self.handle = None

    def note_clock(self, name: str, times: np.ndarray, zone: tzinfo | None) -> None:
        """Keep the moment at which a channel of calendar times (S,) begins, if it is known."""
        began = moment(first_known(times), zone)
        if began is not None:
            self.clocks[name] = began

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.close()
        if isinstance(error, EmatwinError):
            name_given(error, self.path, self.given)


class FrameFile(RecordedFile):
    """A DataFrame; its index counts as a channel where it is one of times or is called so.

    Units stand in the names of columns, or in ``frame.attrs["units"]``.
    """

    kind: ClassVar[str] = "DataFrame"

    def __init__(self, frame: Any) -> None:
        super().__init__(Path(str(frame.attrs.get("source", "") or "DataFrame")))
        name = frame.index.name
        called_so = str(name).strip().casefold() in ("time", "t", "timestamp")
        if called_so or frame.index.dtype.kind in "mM":
            self.channels["time" if name is None else str(name)] = frame.index
        for place, column in enumerate(frame.columns):
            key = str(column)
            if key in self.channels:
                raise RecordError(f"The DataFrame has two columns {key!r}; rename one of them.")
            self.channels[key] = frame.iloc[:, place]
        self.units = {str(key): str(unit) for key, unit in frame.attrs.get("units", {}).items()}
        dated = (key for key, column in self.channels.items() if column.dtype.kind in "mM")
        self.units |= dict.fromkeys(dated, "s")

    def values(self, name: str) -> Any:  # noqa: D102
        return self.channels[name].to_numpy()


def open_file(path: Any, **options: Any) -> RecordedFile:
    """Open a file by its suffix, or a DataFrame; ``options`` are for text tables.

    Raises `InputError` if no reader knows the suffix, or the options are for another format;
    `FileError` if the file cannot be read, is truncated, or is not what its name says;
    `MissingExtraError` if the library for this format is not installed.
    """
    is_table = is_frame(path)
    suffix = "" if is_table else Path(path).suffix.lower()
    if options and suffix not in (*_TEXT, *_PACKED):
        said = f"{', '.join(sorted(options))} can be given only for CSV files"
        raise InputError(f"{said}; {'a DataFrame' if is_table else path} is not one. Leave it out.")
    if is_table:
        return FrameFile(path)
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise FileError(f"{path} is a pipe or a device; save the recording to a file first.")
    maker: Any
    if suffix in _FORMATS:
        module, name = _FORMATS[suffix].split(":")
        maker = getattr(import_module(f"ematwin.recordings.formats.{module}"), name)
    else:
        others = (one for one in entry_points(group=ENTRY_POINTS) if f".{one.name}" == suffix)
        maker = next((one.load() for one in others), None)
    if maker is None and suffix in _ELSEWHERE:
        raise InputError(f"Cannot read {path} itself. {_ELSEWHERE[suffix]}")
    if maker is None:
        known = ", ".join(known_suffixes())
        raise InputError(f"Cannot tell how to read {path}: its name must end in {known}.")
    if path.is_dir():
        raise FileError(f"{path} is a folder; give a file.")
    if not path.is_file():
        raise FileError(f"There is no file {path}.")
    if suffix in _TEXT and not options:
        from ematwin.recordings.formats.csv_file import TwinCatFile, is_export

        maker = TwinCatFile if is_export(path) else maker
    with refusing(path, getattr(maker, "kind", suffix[1:])):
        opened: RecordedFile = maker(path, **options)
    return opened


def open_packed(path: Path, **options: Any) -> RecordedFile:
    """Open the content of a gzip or zip file or a workbook; ``options`` are for text tables.

    It is unpacked into a temporary folder, deleted with the file, and read by its reader.
    """
    folder = TemporaryDirectory(prefix="ematwin-")
    content = {".gz": _ungzipped, ".zip": _unzipped}.get(path.suffix.lower(), _sheet)
    inside, assumed = content(path, Path(folder.name))
    try:
        opened = open_file(inside, **options)
    except EmatwinError as error:
        name_given(error, inside, path)
        raise
    opened.given, opened.unpacked = path, folder  # the folder goes with the file
    if assumed:
        opened.assumed.append(assumed)
    return opened


def _ungzipped(path: Path, folder: Path) -> tuple[Path, str]:
    inside = folder / path.stem
    with gzip.open(path) as source, inside.open("wb") as target:
        shutil.copyfileobj(source, target)
    return inside, ""


def _unzipped(path: Path, folder: Path) -> tuple[Path, str]:
    with zipfile.ZipFile(path) as archive:
        files = [one.filename for one in archive.infolist() if not one.is_dir()]
        # without what macOS adds
        names = [n for n in files if Path(n).name[:1] not in (".", "_") and "__MACOSX" not in n]
        if len(names) != 1:
            listed = ", ".join(names[:5]) or "nothing"
            said = f"{path} must hold one file, and holds {listed}"
            raise FileError(f"{said}. Unpack it, and give the folder.")
        return Path(archive.extract(names[0], folder)), ""


def _sheet(path: Path, folder: Path) -> tuple[Path, str]:
    """The longest sheet of a workbook as a text table, and a note on other sheets."""
    library = load_library("openpyxl", "openpyxl", "Reading Excel files")
    book = library.load_workbook(path, read_only=True, data_only=True)
    sheet = max(book.worksheets, key=lambda one: one.max_row or 0)
    inside = folder / f"{path.stem}.csv"
    with inside.open("w", newline="", encoding="utf-8") as target:
        writer = csv.writer(target, delimiter=";")
        for row in sheet.iter_rows(values_only=True):
            writer.writerow(row)
    others = len(book.worksheets) - 1
    book.close()
    return inside, f"sheet “{sheet.title}” was read, and not the other {others}" if others else ""


def known_suffixes() -> list[str]:
    """Suffixes that can be read, with installed plug-ins."""
    return [*_FORMATS, *(f".{entry.name}" for entry in entry_points(group=ENTRY_POINTS))]


def load_library(module: str, package: str, purpose: str) -> Any:
    """Import the library of a format, or say how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise MissingExtraError(package, "io", purpose) from None


@contextmanager
def complaints(*loggers: str, level: int = logging.WARNING) -> Iterator[list[str]]:
    """Keep the log of a library off the screen, and collect messages of at least ``level``."""
    found: list[str] = []

    def keep(entry: logging.LogRecord) -> bool:
        if entry.levelno >= level:
            found.append(entry.getMessage().splitlines()[0])
        return False

    heard = [logging.getLogger(name) for name in loggers]
    for logger in heard:
        logger.addFilter(keep)
    try:
        yield found
    finally:
        for logger in heard:
            logger.removeFilter(keep)


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


def name_given(error: EmatwinError, path: Path, given: Path) -> None:
    """Let an error name the file that the user gave, not the unpacked one."""
    error.args = (str(error).replace(str(path), str(given)),)


def as_float(values: Any, name: str, path: Path) -> np.ndarray:
    """A fresh (S,) float64 array; clock times become seconds since the first of them.

    Raises `RecordError` if the channel holds something else than numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind == "M":
        array = array - first_known(array)
    if array.dtype.kind == "m":
        since = array.astype("timedelta64[ns]")
        array = np.where(np.isnat(since), np.nan, since.astype(np.int64) * 1e-9)
    if array.dtype.kind not in "biuf":
        said = f"Channel {name!r} of {path} must hold real numbers; it holds {array.dtype}"
        raise RecordError(f"{said}. Choose another channel or export it as numbers.")
    return np.array(array, dtype=np.float64, order="C").reshape(-1)


def first_known(times: np.ndarray) -> Any:
    """The first of some clock times (S,) that is not missing, if any."""
    return next(iter(times[~np.isnat(times)]), np.datetime64("NaT"))


def moment(stamp: np.datetime64, zone: tzinfo | None = None) -> datetime | None:
    """A clock time as a datetime, to the microsecond; None for no time or one out of range."""
    found = stamp.astype("datetime64[us]").item()
    return found.replace(tzinfo=zone) if isinstance(found, datetime) else None


def matrix_columns(name: str, shape: Sequence[int]) -> list[tuple[str, int, Any]]:
    """Channel names, lengths and indices in an array: a vector, or up to 64 columns ``name[k]``."""
    sides = sorted(side for side in shape if side != 1)
    if len(sides) == 1:
        return [(name, sides[0], ...)]
    if len(sides) != 2 or sides[0] > 64:
        return []
    count, length = sides
    across = max(axis for axis, side in enumerate(shape) if side == count)
    return [(f"{name}[{k}]", length, (*[slice(None)] * across, k)) for k in range(count)]
