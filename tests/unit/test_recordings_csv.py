"""Text tables as they are met in practice."""

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from ematwin.errors import FileError, InputError, RecordError
from ematwin.models.reading import read, write
from ematwin.recordings.formats.csv_dialect import sniff
from ematwin.recordings.read import assumptions
from ematwin.recordings.recording import Recording
from ematwin.testing.reader_contract import bench_channels

CHANNELS = bench_channels(duration=0.01)


def table(delimiter: str = ",", decimal: str = ".", end: str = "\n", tail: str = "") -> str:
    rows = zip(*(values.tolist() for values in CHANNELS.values()), strict=True)
    return "".join(
        delimiter.join(repr(value).replace(".", decimal) for value in row) + tail + end
        for row in rows
    )


HEADER = ",".join(CHANNELS)


def record_of(tmp_path: Path, content: str | bytes, **options: object) -> Recording:
    path = tmp_path / "bench.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    record = read(path, options or None)
    for name, values in CHANNELS.items():
        np.testing.assert_array_equal(getattr(record, name), values)
    return record


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_delimiters_and_decimal_signs(tmp_path: Path, delimiter: str, decimal: str) -> None:
    if delimiter == decimal:
        return
    record = record_of(tmp_path, HEADER.replace(",", delimiter) + "\n" + table(delimiter, decimal))
    said = record.provenance["assumed"][0]
    assert repr(delimiter) in said
    assert f"decimal sign {decimal!r}" in said


def test_leading_zero_rows_do_not_hide_the_decimal_comma(tmp_path: Path) -> None:
    rows = [f"{k};0;0;0;0\n" for k in range(30_000)]
    rows += [f"{k};{k / 7:.5f};1,5;-1,5;0\n".replace(".", ",") for k in range(30_000, 60_000)]
    path = tmp_path / "late.csv"
    path.write_text(";".join(CHANNELS) + "\n" + "".join(rows))
    assert sniff(path).decimal == ","


@pytest.mark.parametrize(
    "head",
    [
        "\ufeff" + HEADER + "\n",
        "Bench 3\nDate,2026-11-21\n\n" + HEADER + "\n",
        "# made by a program\n# run 7\n" + HEADER + "\n",
        "# " + HEADER + "\n",
        ",".join(f'"{name}"' for name in CHANNELS) + "\n",
        ",".join(f" {name} " for name in CHANNELS) + "\n",
        HEADER + "\ns,rad,A,A,A\n",
        HEADER + "\n[s],[rad],[A],[A],[A]\n\n",
        "sep=,\n" + HEADER + "\n",
    ],
    ids=[
        "byte order mark", "preamble", "comments", "commented header", "quoted", "blanks",
        "units", "bracketed units", "sep line",
    ],
)  # fmt: skip
def test_headers(tmp_path: Path, head: str) -> None:
    record_of(tmp_path, head + table())


@pytest.mark.parametrize("preamble", ["Rig;3;run;7", "Rig;blue;Smith;dry", "Rig 3;;;"])
def test_names_of_one_letter_below_a_preamble_are_no_units(tmp_path: Path, preamble: str) -> None:
    path = tmp_path / "letters.csv"
    rows = [f"{n / 1000};{n % 7};{n % 5};{n % 3}" for n in range(50)]
    path.write_text("\n".join([preamble, "t;A;v;B", *rows]), encoding="utf-8")
    assert sniff(path).names == ["t", "A", "v", "B"]
    assert not any(sniff(path).units)


def test_units_of_one_letter_below_names_are_units(tmp_path: Path) -> None:
    path = tmp_path / "letters.csv"
    rows = [f"{n / 1000};{n % 7};{n % 5};{n % 3}" for n in range(50)]
    for names in ("time;i;u;p", "t;I;U;P"):
        path.write_text("\n".join([names, "s;A;V;W", *rows]), encoding="utf-8")
        assert sniff(path).names == names.split(";")
        assert sniff(path).units == ["s", "A", "V", "W"]


def test_units_row_is_applied(tmp_path: Path) -> None:
    path = tmp_path / "units.csv"
    path.write_text("t,cmd,i_a,i_b\nms,deg,mA,mA\n0,1,5,-5\n0.1,2,6,-7\n0.2,3,7,-9\n")
    record = read(path)
    np.testing.assert_allclose(record.time, [0, 1e-4, 2e-4])
    np.testing.assert_allclose(record.command, np.radians([1, 2, 3]))
    np.testing.assert_allclose(record.current_c, [0, 1e-3, 2e-3])


def test_columns_of_the_same_name_are_told_apart_by_their_place(tmp_path: Path) -> None:
    path = tmp_path / "twice.csv"
    path.write_text("t,cmd,cmd,i_a,i_b\n0,1,5,5,-5\n0.1,2,6,6,-7\n0.2,3,7,7,-9\n")
    with pytest.raises(RecordError, match=r"several channels for command: cmd \(2\), cmd \(3\)"):
        read(path)
    np.testing.assert_allclose(read(path, {"command": "cmd (3)"}).command, [5, 6, 7])


def test_line_ends_and_trailing_empty_columns(tmp_path: Path) -> None:
    record_of(tmp_path, HEADER + ",\r\n" + table(end="\r\n", tail=","))
    record_of(tmp_path, HEADER + "\r\n" + table(end="\r\n", tail=",,"))


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16", "utf-16-be", "utf-8"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    record_of(tmp_path, f"{mark}Prüfstand\n{HEADER}\n{table()}".encode(encoding))


def test_no_header_numbers_the_columns(tmp_path: Path) -> None:
    numbered = {name: str(n + 1) for n, name in enumerate(CHANNELS)}
    record = record_of(tmp_path, table(), **numbered)
    assert any("no header" in said for said in record.provenance["assumed"])


@pytest.mark.parametrize(
    "text",
    [
        "t;cmd;i\n+0,0;+1,5E+0;+2\n+0,1;-1,5;+3\n+0,2;0,5;-4\n",
        't,cmd,i\n0,"1,5","2,5"\n1,"-1,5","2,5"\n2,"0,5","2,5"\n',
    ],
    ids=["plus signs", "quoted decimal commas"],
)
def test_numbers_are_read_as_programs_spell_them(tmp_path: Path, text: str) -> None:
    (tmp_path / "bench.csv").write_text(text)
    assert read(tmp_path / "bench.csv").command.tolist() == [1.5, -1.5, 0.5]


def test_placeholders_and_empty_fields_are_holes(tmp_path: Path) -> None:
    path = tmp_path / "holes.csv"
    rows = [f"{k / 1000:.3f},{k},{'-' if 10 <= k < 15 else k}\n" for k in range(50)]
    path.write_text("t,cmd,i\n" + "".join(rows))
    with pytest.raises(RecordError, match="current has no values in a stretch of 5 samples"):
        read(path)
    assert read(path, gaps="mask").provenance["masked_s"] == [[0.009, 0.015]]
    path.write_text("t,cmd,i\n" + "".join(f"{k / 1000:.3f},{k},NaN\n" for k in range(50)))
    with pytest.raises(RecordError, match="current holds no value at all"):
        read(path)


@pytest.mark.parametrize("name", ["t", "Zeit", "Zeitstempel", "timestamp", "time_stamp"])
@pytest.mark.parametrize(
    ("clock", "start"),
    [
        ("2026-11-21 08:00:59.900", datetime(2026, 11, 21, 8, 0, 59, 900_000)),
        ("2026-11-21T08:00:59.900Z", datetime(2026, 11, 21, 8, 0, 59, 900_000, UTC)),
        ("2026-11-21T08:00:59.900+01:00", datetime(2026, 11, 21, 7, 0, 59, 900_000, UTC)),
        ("03.11.2026 08:00:59,900", datetime(2026, 11, 3, 8, 0, 59, 900_000)),
        ("3/11/2026 8:00:59.900 PM", datetime(2026, 3, 11, 20, 0, 59, 900_000)),
        ("3/11/2026 12:00:59.900 AM", datetime(2026, 3, 11, 0, 0, 59, 900_000)),
        ("23/11/2026 08:00:59.900", datetime(2026, 11, 23, 8, 0, 59, 900_000)),
        ("08:00:59.900", None),
        ("23:59:59.900", None),  # over midnight
    ],
)
def test_clock_times_count_from_the_first(tmp_path, name, clock, start):
    first, _, rest = clock.partition("900")
    later = {"00:59": "01:00", "59:59": "00:00"}[first[-6:-1]]
    following = first[:-6].replace("23:", "00:") if start is None else first[:-6]
    rows = [
        (f"{first}{900 + k}" if k < 100 else f"{following}{later}{first[-1]}{k - 100:03d}") + rest
        for k in range(200)
    ]
    path = tmp_path / "clock.csv"
    path.write_text(f"{name};cmd;i\n" + "".join(f"{row};{k};{k}\n" for k, row in enumerate(rows)))
    found = read(path)
    np.testing.assert_allclose(found.time, np.arange(200) / 1000.0, atol=1e-9)
    assert found.start == start
    said = [text for text in assumptions(found) if "Dates in" in text]
    assert len(said) == ("/" in clock)


def test_clock_times_of_whole_seconds_and_holes(tmp_path: Path) -> None:
    path = tmp_path / "clock.csv"
    rows = [f"09:14:{n // 10:02d};{n};{n}\n" for n in range(400)]
    path.write_text("Zeit;cmd;i\n" + "".join(rows))
    assert read(path).sample_rate == pytest.approx(10.0, rel=1e-3)
    for cell, said in (("", "time is NaN"), ("25:14:00", "'25:14:00' is no clock time")):
        rows[7] = f"{cell};7;7\n"
        path.write_text("Zeit;cmd;i\n" + "".join(rows))
        with pytest.raises(RecordError, match=said):
            read(path)


def test_a_column_of_time_goes_before_one_of_clock_times(tmp_path: Path) -> None:
    path = tmp_path / "both.csv"
    rows = [f"09:14:02.{n:03d},{n / 500},{n},{n}\n" for n in range(100)]
    path.write_text("timestamp,t [s],cmd,i\n" + "".join(rows))
    assert read(path).sample_rate == pytest.approx(500.0)


def test_options_of_csv_are_refused_for_others(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    write(record_of(tmp_path, HEADER + "\n" + table()), path)
    with pytest.raises(InputError, match="only for CSV files"):
        read(path, {"delimiter": ";"})


@pytest.mark.parametrize(
    ("content", "error", "said"),
    [
        ("", FileError, "empty"),
        (" \n\n", FileError, "empty"),
        (HEADER + "\n", FileError, "no rows"),
        ("text\nmore text\nand more\n", RecordError, "no rows of numbers"),
        (HEADER + "\n" + table()[:-30] + "\n", FileError, "truncated"),
        (
            HEADER + "\n0,0,0,0,0\n1,x,1,1,1\n" * 1 + "2,2,2,2,2\n3,3,3,3,3\n",
            RecordError,
            "Column command of .* holds 'x'",
        ),
        ("time,command,current\n0,on,1\n1,off,2\n", RecordError, "holds text"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path, content, error, said):
    path = tmp_path / "bad.csv"
    path.write_text(content)
    with pytest.raises(error, match=said) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert "bad.csv" in str(caught.value)


def test_a_newer_format_and_another_unit_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    write(Recording(**CHANNELS), path)
    text = path.read_text()
    path.write_text(text.replace('"format": 1', '"format": 9'))
    with pytest.raises(RecordError, match="newer ematwin"):
        read(path)
    text = re.sub(r'"checksums?": ("\w+"|\{[^}]*\}), ', "", text)  # as 0.1 wrote it
    path.write_text(text.replace('"time": "s"', '"time": "ms"'))
    with pytest.raises(RecordError, match="time in ms"):
        read(path)


def test_a_map_over_our_own_file_keeps_its_origin(tmp_path: Path) -> None:
    path = tmp_path / "own.parquet"
    write(Recording(**CHANNELS, provenance={"model": "reference"}), path)
    record = read(path, {"i_a": "current_a", "i_b": "current_b"})
    assert record.provenance["origin"] == {"model": "reference"}
    assert record.provenance["columns"]["current_a"]["unit_from"] == "file"
