"""What ematwin writes says whether it is still as it was written."""

import json
import random
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ematwin.errors import EmatwinError, FileError
from ematwin.models.reading import read
from ematwin.models.reading import write as write_public
from ematwin.recordings.formats.base import open_file
from ematwin.recordings.recording import Recording
from ematwin.testing.reader_contract import bench_channels


@pytest.fixture
def recording() -> Recording:
    channels = bench_channels(duration=0.02)
    return Recording(
        channels.pop("time"), channels, labels={"run": "1"}, units={"command": "rad"},
        start=datetime(2026, 11, 22, tzinfo=UTC), provenance={"by": "a,=1+1;@x", "n": [1, -2]},
    )  # fmt: skip


@pytest.fixture(params=[".parquet", ".csv"])
def path(request: pytest.FixtureRequest, tmp_path: Path, recording: Recording) -> Path:
    """A file that holds the recording."""
    path = tmp_path / f"rec{request.param}"
    write_public(recording, path)
    return path


def same(a: Recording, b: Recording) -> bool:
    return (
        list(a.channels) == list(b.channels)
        and all(np.array_equal(a.channels[name], b.channels[name]) for name in a.channels)
        and np.array_equal(a.time, b.time)
        and (a.labels, a.start, a.units, a.provenance) == (b.labels, b.start, b.units, b.provenance)
    )


def test_no_changed_byte_goes_unseen(path: Path) -> None:
    whole, before = path.read_bytes(), read(path)
    chance, seen = random.Random(2), 0
    for _ in range(150):
        changed = bytearray(whole)
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
        path.write_bytes(changed)
        try:
            assert same(read(path), before)
        except EmatwinError as error:
            seen += 1
            text = str(error)
            if "\n" in text:
                raise
    assert seen > 75


def test_the_damage_is_named(path: Path) -> None:
    if path.suffix == ".csv":
        text = path.read_text()
        lines = text.splitlines(keepends=True)
        first = lines[5].split(",")
        first[2] = "0.25"
        path.write_text("".join([*lines[:5], ",".join(first), *lines[6:]]))
    else:
        table = pq.read_table(path)
        name = table.column_names[2]
        values = table.column(name).to_numpy().copy()
        values[4] += 1e-9
        pq.write_table(table.set_column(2, name, pa.array(values)), path)
    with pytest.raises(
        FileError, match=r"changed since ematwin wrote it: column current_a differs"
    ):
        read(path)
    with (  # also where it is read through a map, column by column
        open_file(path) as file,
        pytest.raises(FileError, match="column current_a differs"),
    ):
        file.read(["current_a"])
    with open_file(path) as file:
        assert set(file.read(["command"])) == {"command"}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"labels"', '"labelz"', "what it says of itself differs"),
        ('"checksum"', '"chexksum"', "what it says of itself differs"),
        ('"checksums"', '"chexksums"', "what it says of itself differs"),
        ("}", "", "what it says of itself cannot be read"),
        ("ematwin", "ematwim", "has lost its"),
    ],
)
def test_changed_metadata_are_named(path, old, new, said):
    if path.suffix == ".csv":
        path.write_text(path.read_text().replace(old, new, 1))
    else:  # the file holds its metadata twice: a changed byte alone would change nothing
        table = pq.read_table(path)
        pairs = ((key.decode(), note.decode()) for key, note in table.schema.metadata.items())
        changed = {key.replace(old, new): note.replace(old, new, 1) for key, note in pairs}
        pq.write_table(table.replace_schema_metadata(changed), path)
    with pytest.raises(FileError, match=said):
        read(path)


def test_labels_that_look_like_formulas_come_back(tmp_path: Path) -> None:
    channels = bench_channels(duration=0.02)
    time = channels.pop("time")
    motions = [Recording(time, channels, labels={"condition": name}) for name in ("=1+1", "@dry")]
    path = tmp_path / "bench.csv"
    write_public(motions, path)
    starts = [line.split(",")[0].strip('"') for line in path.read_text().splitlines()]
    assert set(starts) == {"condition", "'=1+1", "'@dry"}
    back = read(path, split=True)
    assert [one.labels["condition"] for one in back] == ["=1+1", "@dry"]


def test_the_first_line_holds_no_formula(tmp_path: Path, recording: Recording) -> None:
    """Spreadsheets part it at its commas, or at semicolons."""
    path = tmp_path / "rec.csv"
    write_public(recording, path)
    line = path.read_text().splitlines()[0]
    for sign in ",;":
        assert not [part for part in line.split(sign) if part[:1] in "=+-@" and part]
    said = json.loads(line.removeprefix("# ematwin "))
    assert said["provenance"]["by"] == "a,=1+1;@x"
