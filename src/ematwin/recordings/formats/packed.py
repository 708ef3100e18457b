"""Files in a file: a table in gzip or zip, and the sheet of an Excel workbook, as the table itself.

The content is unpacked into a temporary folder, deleted with the file, and read by its reader.
"""

import csv
import gzip
import shutil
import zipfile
from datetime import date, datetime, time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ematwin.errors import EmatwinError, FileError
from ematwin.recordings.formats.base import (
    RecordedFile,
    load_library,
    name_given,
    open_file,
    refusing,
)


def open_packed(path: Path, **options: Any) -> RecordedFile:
    """Open the content of a gzip or zip file or a workbook; ``options`` are for text tables."""
    suffix = path.suffix.lower()
    folder = TemporaryDirectory(prefix="ematwin-")
    content = {".gz": _ungzipped, ".zip": _unzipped}.get(suffix, _sheet)
    with refusing(path, suffix[1:]):
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
        names = [
            one.filename
            for one in archive.infolist()
            if not one.is_dir() and not Path(one.filename).name.startswith((".", "_"))
            and "__MACOSX" not in one.filename
        ]  # fmt: skip
        if len(names) != 1:
            listed = ", ".join(names[:5]) or "nothing"
            raise FileError(
                f"{path} must hold one file, and holds {listed}. Unpack it, and give the folder."
            )
        inside = folder / Path(names[0]).name
        with archive.open(names[0]) as source, inside.open("wb") as target:
            shutil.copyfileobj(source, target)
    return inside, ""


def _sheet(path: Path, folder: Path) -> tuple[Path, str]:
    """The longest sheet of a workbook as a text table, and a note on other sheets."""
    library = load_library("openpyxl", "openpyxl", "Reading Excel files")
    book = library.load_workbook(path, read_only=True, data_only=True)
    sheet = max(book.worksheets, key=lambda one: one.max_row or 0)
    inside = folder / f"{path.stem}.csv"
    with inside.open("w", newline="", encoding="utf-8") as target:
        writer = csv.writer(target, delimiter=";")
        for row in sheet.iter_rows(values_only=True):
            writer.writerow(_as_text(cell) for cell in row)
    others = len(book.worksheets) - 1
    book.close()
    return inside, f"sheet “{sheet.title}” was read, and not the other {others}" if others else ""


def _as_text(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, float):
        return repr(cell)
    return cell.isoformat() if isinstance(cell, date | datetime | time) else str(cell)
