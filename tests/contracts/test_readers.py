"""Each reader of ours against the contract, on files made by the libraries of the formats."""

import gzip
import struct
import tempfile
import zipfile
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from mcap_ros2.writer import Writer as McapWriter

from bench_files import write_mdf, write_tdms
from ematwin.errors import EmatwinError, FileError, InputError
from ematwin.models.reading import read
from ematwin.recordings.read import assumptions
from ematwin.testing.reader_contract import ReaderContract, bench_channels


class TestCsv(ReaderContract):
    suffix = ".csv"

    def write(self, path, channels, units):
        rows = zip(*(map(repr, values.tolist()) for values in channels.values()), strict=True)
        path.write_text("\n".join([",".join(channels), *(",".join(row) for row in rows)]) + "\n")


class TestGermanCsv(ReaderContract):
    suffix = ".txt"
    states_units = True

    def write(self, path, channels, units):
        lines = ["Prüfstand 3;;;;", ";".join(channels), ";".join(f"[{u}]" for u in units.values())]
        for row in zip(*(values.tolist() for values in channels.values()), strict=True):
            lines.append(";".join(repr(value).replace(".", ",") for value in row))
        path.write_bytes("\r\n".join([*lines, ""]).encode("cp1252"))


class TestTwinCat(ReaderContract):
    """As Scope 3.4 writes it: German signs, a time base for channels of one rate, EOF."""

    suffix = ".csv"
    states_units = True
    end, sign = "\nEOF\n", "\t"

    def write(self, path, channels, units):
        names = [name for name in channels if name != "time"]
        ticks = 132_959_733_843_760_000
        last = ticks + round(1e7 * channels["time"][-1])
        lines = [
            ["Name", "scope"], ["File", "scope.csv"],
            ["Starttime of export", str(ticks), "Montag, 2. Mai 2022", "15:56:24.376"],
            ["Endtime of export", str(last), "Montag, 2. Mai 2022", "15:56:25.375"],
            [], [], ["Name", *names], ["SymbolComment", *["" for _ in names][1:]],
            ["SampleTime[ms]", *["0,05" for _ in names]],
            ["Unit", *[f"{units[name]} (Quantity)" for name in names]], [],
        ]  # fmt: skip
        columns = [1e3 * channels["time"], *(channels[name] for name in names)]
        for row in zip(*(values.tolist() for values in columns), strict=True):
            lines.append([repr(value).replace(".", ",") for value in row])
        text = "\n".join(self.sign.join(line) for line in lines)
        path.write_text(text + self.end, encoding="utf-8")


class TestTwinCatFullTimestamps(TestTwinCat):
    """A time column for each channel, in ticks; a delimiter of its own; no EOF."""

    end, sign = "\n", ";"

    def write(self, path, channels, units):
        super().write(path, channels, units)
        head, _, rows = path.read_text().rpartition("\n\n")
        lines = []
        for line in rows.splitlines():
            time, *cells = line.split(";")
            ticks = 132_959_733_843_760_000 + round(1e4 * float(time.replace(",", ".")))
            lines.append(";".join(f"{ticks};{cell}" for cell in cells))
        blocks = []
        for line in head.splitlines():
            key, *cells = line.split(";")
            own = len(cells) == len(channels) - 1
            blocks.append(";".join(f"{key};{cell}" for cell in cells) if own else line)
        path.write_text("\n".join([*blocks, "", *lines]) + self.end)


class TestParquet(ReaderContract):
    suffix = ".parquet"
    states_units = True

    def write(self, path, channels, units):
        schema = pa.schema(
            [pa.field(n, pa.float64(), metadata={"unit": units[n]}) for n in channels]
        )
        pq.write_table(pa.table(channels, schema=schema), path, row_group_size=700)


class TestGzip(ReaderContract):
    suffix = ".csv.gz"

    def write(self, path, channels, units):
        TestCsv().write(path, channels, units)
        path.write_bytes(gzip.compress(path.read_bytes()))


class TestZip(ReaderContract):
    suffix = ".zip"
    states_units = True

    def write(self, path, channels, units):
        TestParquet().write(path, channels, units)
        content = path.read_bytes()
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("day 1/bench.parquet", content)


class TestExcel(ReaderContract):
    suffix = ".xlsx"
    states_units = True

    @pytest.fixture
    def channels(self):
        """With the 15 digits that Excel keeps."""
        return {name: np.round(values, 12) for name, values in bench_channels().items()}

    def write(self, path, channels, units):
        book = openpyxl.Workbook()
        book.active.title = "Notes"
        book.active["A1"] = "Bench 3"
        sheet = book.create_sheet("Run 1")
        sheet.append(["Operator", "A. N."])
        sheet.append(list(channels))
        sheet.append([f"[{unit}]" for unit in units.values()])
        for row in zip(*(values.tolist() for values in channels.values()), strict=True):
            sheet.append(row)
        book.save(path)


class TestULog(ReaderContract):
    suffix = ".ulg"

    def write(self, path, channels, units):
        names = [name for name in channels if name != "time"]
        fields = ";".join(["uint64_t timestamp", *(f"double {name}" for name in names)])
        parts = [b"ULog\x01\x12\x35\x01" + bytes(8)]
        content = [(b"B", bytes(40)), (b"F", f"bench:{fields};".encode()),
                   (b"A", b"\0" + struct.pack("<H", 0) + b"bench")]  # fmt: skip
        for n, time in enumerate(channels["time"]):
            values = [channels[name][n] for name in names]
            sample = struct.pack(f"<HQ{len(names)}d", 0, round(1e6 * time), *values)
            content.append((b"D", sample))
        parts += [struct.pack("<H", len(text)) + kind + text for kind, text in content]
        path.write_bytes(b"".join(parts))


class TestMcap(ReaderContract):
    suffix = ".mcap"

    def write(self, path, channels, units):
        names = [name for name in channels if name != "time"]
        with path.open("wb") as file:
            writer = McapWriter(file)
            schema = writer.register_msgdef(
                "bench_msgs/Sample", "\n".join(f"float64 {name}" for name in names)
            )
            for n, time in enumerate(channels["time"]):
                message = {name: float(channels[name][n]) for name in names}
                writer.write_message("/bench", schema, message, log_time=round(1e9 * time))
            writer.finish()


class TestMatlab5(ReaderContract):
    suffix = ".mat"

    def write(self, path, channels, units):
        scipy.io.savemat(path, {"run": channels, "note": "test"})


class TestMatlab5Compressed(ReaderContract):
    suffix = ".mat"

    def write(self, path, channels, units):
        scipy.io.savemat(path, channels, do_compression=True, oned_as="column")


class TestMatlab73(ReaderContract):
    suffix = ".mat"

    def write(self, path, channels, units):
        write_matlab73(path, {"run": channels})


def with_units(channels, units):
    named = {name: (values, units[name]) for name, values in channels.items() if name != "time"}
    return channels["time"], named


class TestMdf4(ReaderContract):
    suffix = ".mf4"
    states_units = True

    def write(self, path, channels, units):
        write_mdf(path, with_units(channels, units))


class TestMdf3(ReaderContract):
    suffix = ".mdf"
    states_units = True

    def write(self, path, channels, units):
        write_mdf(path, with_units(channels, units), version="3.30")


class TestTdms(ReaderContract):
    suffix = ".tdms"
    states_units = True

    def write(self, path, channels, units):
        wave = {"wf_increment": float(np.diff(channels["time"]).mean()), "wf_start_offset": 0.0}
        named = {
            f"bench/{name}": (values, {"unit_string": units[name], **wave})
            for name, values in channels.items()
        }
        write_tdms(path, named)


class TestHdf5(ReaderContract):
    suffix = ".h5"
    states_units = True

    def write(self, path, channels, units):
        with h5py.File(path, "w") as file:
            for name, values in channels.items():
                file[f"bench/{name}"] = values
                file[f"bench/{name}"].attrs["unit"] = units[name]


@pytest.mark.parametrize("first", ["s", np.bytes_("s")], ids=["variable", "fixed"])
def test_a_damaged_heap_of_hdf5_is_refused_and_not_read_for_ever(tmp_path, first):
    """The library itself steps on by zero bytes from there."""
    path = tmp_path / "bench.h5"
    channels = bench_channels()
    units = {name: "A" for name in channels} | {"time": first}  # which is read first
    TestHdf5().write(path, channels, units)
    content = bytearray(path.read_bytes())
    in_heap = sum(isinstance(unit, str) for unit in units.values())
    free = content.rindex(b"GCOL") + 16 + 24 * in_heap
    assert content[free : free + 2] == b"\0\0"
    content[free + 8 : free + 16] = (120).to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(FileError, match="its heap of texts is damaged"):
        read(path)


def write_matlab73(path, content):
    """The layout that MATLAB gives a 7.3 file: HDF5 behind a header of its own."""

    def put(group, name, value):
        if isinstance(value, dict):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, part in value.items():
                put(inner, key, part)
        else:
            data = group.create_dataset(name, data=np.atleast_2d(np.asarray(value)))
            data.attrs["MATLAB_class"] = np.bytes_("double")

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            put(file, name, value)
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as raw:
        raw.write(header)


@pytest.mark.parametrize(
    ("name", "advice"),
    [("run.db3", "ros2 bag convert"), ("run.xls", r"Save it as \.xlsx"), ("run.svdx", "as CSV")],
)
def test_a_format_that_is_not_read_gets_a_recipe(tmp_path, name, advice):
    (tmp_path / name).touch()
    with pytest.raises(InputError, match=advice):
        read(tmp_path / name)


def test_a_zip_of_several_files_is_refused_by_their_names(tmp_path):
    with zipfile.ZipFile(tmp_path / "days.zip", "w") as archive:
        for day in (1, 2):
            archive.writestr(f"day{day}.csv", "time,command\n0,0\n")
    with pytest.raises(FileError, match=r"holds day1\.csv, day2\.csv\. Unpack it"):
        read(tmp_path / "days.zip")


def test_a_log_that_power_loss_cut_off_is_read_up_to_there(tmp_path):
    path, channels = tmp_path / "flight.ulg", bench_channels()
    TestULog().write(path, channels, {})
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2 + 11])
    record = read(path)
    assert 0.4 < len(record) / len(channels["time"]) < 0.6
    np.testing.assert_array_equal(record.command, channels["command"][: len(record)])
    assert any("log flight.ulg ends within a message" in said for said in assumptions(record))


@pytest.mark.parametrize(
    "text",
    [
        "time,command\n0,0\n1,abc\n",
        "time,speed\n" + "".join(f"{n},0\n" for n in range(50)),
        "time,command,current\n" + "".join(f"{n % 30},0,1\n" for n in range(60)),
    ],
)
def test_an_error_names_the_packed_file_that_was_given(tmp_path, text):
    path = tmp_path / "bench.csv.gz"
    path.write_bytes(gzip.compress(text.encode()))
    with pytest.raises(EmatwinError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert str(Path(tempfile.gettempdir(), "ematwin-")) not in str(caught.value)
