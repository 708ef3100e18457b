"""``ematwin channels`` as its users meet it: a file, a map, a page."""

import tomllib
from pathlib import Path

import numpy as np

from bench_files import german_csv
from devtools import seen_at
from ematwin.testing.reader_contract import bench_channels
from refusals import refused


def bench_file(folder: Path, command: str = "Sollwert [°]") -> Path:
    channels = bench_channels()
    a, b = (1e3 * channels[name] for name in ("current_a", "current_b"))
    columns = {
        "Zeit [ms]": 1e3 * channels["time"], command: np.degrees(channels["command"]),
        "Strom U [mA]": a, "Strom V [mA]": b, "Kanal <b>": channels["time"],
    }  # fmt: skip
    return german_csv(folder / "bench.csv", columns)


def test_a_map_is_shown_and_written_and_can_be_read(done, tmp_path: Path) -> None:
    bench_file(tmp_path)
    answer = done("channels", "bench.csv", "--write", "map.toml", "--plot", "page.html")
    assert "Sollwert [°]" in answer.out
    assert "▁" in answer.out
    assert "20000 Hz" in answer.out
    assert "Next: ematwin identify bench.csv --actuator servo48 --map map.toml" in answer.out
    table = tomllib.loads((tmp_path / "map.toml").read_text("utf-8"))
    assert table["columns"]["command"] == {"channel": "Sollwert [°]", "unit": "°"}
    (seen,) = seen_at([tmp_path / "page.html"], tmp_path)
    for width, found in seen.items():
        assert found["figures"], width
        assert (found["wider"], found["cut"], found["out"]) == (0, 0, []), width
    assert "<b>" not in (tmp_path / "page.html").read_text("utf-8").split("</head>")[1]


def test_what_is_open_is_asked_and_not_written(ematwin, done, tmp_path: Path) -> None:
    bench_file(tmp_path, "Sollwert")
    answer = done("channels", "bench.csv", "--write", "map.toml", "--json")
    told = answer.told
    assert not told["map"]["complete"]
    assert told["map"]["columns"]["command"]["units"] == ["rad", "deg"]
    text = (tmp_path / "map.toml").read_text("utf-8")
    assert "command" not in tomllib.loads(text)["columns"]
    assert '# command = { channel = "Sollwert", unit = "deg" }' in text
    refused(ematwin("identify", "bench.csv", "--map", "map.toml"), "no channel for command")
