"""Results in a notebook and in pandas: tables, HTML that is escaped, figures, bars."""

import sys
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ematwin
from ematwin import plots
from ematwin.errors import InputError, MissingExtraError, RecordError
from ematwin.estimation.identification import Identification
from ematwin.monitoring.detection import Detection
from ematwin.showing.text import with_interval
from ematwin.testing.reader_contract import bench_channels

BENCH = bench_channels()


@pytest.fixture(scope="module")
def record() -> ematwin.Recording:
    return ematwin.simulate(actuator="rm1605", faults={"friction": 2.0})


@pytest.fixture(scope="module")
def found(record: ematwin.Recording) -> Identification:
    return ematwin.identify(record, "rm1605", exact=True)


@pytest.mark.parametrize(
    ("value", "low", "high", "said"),
    [
        (0.0452, 0.0438, 0.0467, ("0.045", "0.044 to 0.047")),
        (6.04, 5.8, 8.0, ("6.0", "5.8 to 8.0")),
        (6.8e3, 6.71e3, 6.92e3, ("6800", "6710 to 6920")),
        (-0.0009, -0.0031, 0.0022, ("-0.001", "-0.003 to 0.002")),
        (-0.0001, -0.05, 0.05, ("0.00", "-0.05 to 0.05")),
        (149.9, 149.92, 150.04, ("149.90", "149.92 to 150.04")),
        (2.1e-6, 2e-6, 2.35e-6, ("2.1e-6", "2.0e-6 to 2.4e-6")),
        (0.3, 0.0, np.inf, ("0.3", "0 to inf")),
        (1.25, 1.25, 1.25, ("1.25", "1.25 to 1.25")),
    ],
)
def test_numbers_have_the_digits_that_their_interval_deserves(value, low, high, said) -> None:
    assert with_interval(value, low, high) == said


def test_an_interval_never_excludes_its_own_value() -> None:
    drawn = np.random.default_rng(1)
    for _ in range(2000):
        ends = np.sort(drawn.normal(0.0, 10.0 ** drawn.uniform(-8, 8), 3) + drawn.normal())
        number, between = with_interval(ends[1], ends[0], ends[2])
        low, high = (float(end) for end in between.split(" to "))
        assert low <= float(number) <= high
        assert not number.startswith("-0.0") or float(number) < 0.0


class Tags(HTMLParser):
    """Tags that are open, to see that all are closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.seen.add(tag)
        if tag not in ("progress",):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in ("progress",):
            assert self.open.pop() == tag


def parsed(html: str) -> Tags:
    tags = Tags()
    tags.feed(html)
    assert tags.open == []
    return tags


def test_a_dataframe_is_read_like_a_file_with_units_and_a_map() -> None:
    frame = pd.DataFrame(
        {"Zeit [ms]": 1e3 * BENCH["time"], "Soll [deg]": np.degrees(BENCH["command"]),
         "i_a": BENCH["current_a"], "i_b [mA]": 1e3 * BENCH["current_b"]}
    )  # fmt: skip
    read = ematwin.read(frame, {"time": "Zeit [ms]", "command": "Soll [deg]"})
    np.testing.assert_allclose(read.command, BENCH["command"], atol=1e-12)
    np.testing.assert_allclose(read.current_b, BENCH["current_b"], atol=1e-12)
    assert read.provenance["format"] == "DataFrame"
    assert any("current_a in A" in text for text in read.provenance["assumed"])
    assert ematwin.propose_map(frame).entries["current_a"].unit == "A"  # the only plausible one
    del frame["i_a"]
    with pytest.raises(RecordError, match="DataFrame has no channel for current_a"):
        ematwin.read(frame, {"time": "Zeit [ms]", "command": "Soll [deg]"})


def test_a_recording_goes_to_pandas_and_back(record: ematwin.Recording) -> None:
    frame = record.to_frame()
    back = ematwin.Recording.from_dataframe(frame)
    for (name, values), (other, again) in zip(record.columns(), back.columns(), strict=True):
        assert name == other
        np.testing.assert_array_equal(values, again)
    by_index = ematwin.Recording.from_dataframe(frame.set_index("time"))
    np.testing.assert_array_equal(by_index.time, record.time)
    moments = pd.Timestamp("2026-11-21 08:00") + pd.to_timedelta(record.time, unit="s")
    dated = ematwin.Recording.from_dataframe(frame.drop(columns="time").set_index(moments))
    np.testing.assert_allclose(dated.time, record.time, atol=1e-9)
    assert dated.start is not None
    assert dated.start.hour == 8
    again = ematwin.read(frame, actuator="rm1605")  # with the units that the frame keeps
    assert again.provenance["assumed"] == []
    with pytest.raises(RecordError, match="no column time"):
        ematwin.Recording.from_dataframe(frame.drop(columns="time"))


def test_identify_takes_a_dataframe(record: ematwin.Recording, found: Identification) -> None:
    again = ematwin.identify(record.to_dataframe(), "rm1605", exact=True)
    assert again.verdict.faults == found.verdict.faults
    assert again.values == pytest.approx(found.values, rel=1e-6, abs=1e-9)
    with pytest.raises(InputError, match="leave columns out"):
        ematwin.identify(record, "rm1605", columns={"current": "x"})


def test_every_result_is_a_table(record: ematwin.Recording, found: Identification) -> None:
    table = found.to_frame()
    assert list(table.index) == [row.name for row in found.physical]
    assert table.loc["friction", "present"]
    assert table.loc["friction", "low"] <= table.loc["friction", "value"]
    assert found.estimate.to_frame().loc["friction", "standard_error"] > 0.0
    assert table.loc["load", "low"] <= table.loc["load", "value"]  # it was searched, not held
    told = ematwin.identifiability(actuator="rm1605", exact=True)
    assert "smallest" in told.to_frame()
    assert "source" in found.actuator.to_frame()
    assert ematwin.Faults(friction=0.25).to_frame().loc["friction", "value"] > 0.0
    least = ematwin.minimize(lambda x: float(x @ x), [-1.0], [1.0], "random", 5, 4)
    assert least.to_frame()["cost"].is_monotonic_decreasing
    for result in (record, found, found.estimate, told, found.actuator, least):
        assert isinstance(result.to_dataframe(), pd.DataFrame)


def test_results_show_their_verdict_first(record: ematwin.Recording, found: Identification) -> None:
    html = found._repr_html_()
    assert html.index(escape(found.verdict.sentence)) < html.index("<table")
    told = ematwin.identifiability(actuator="rm1605", exact=True)
    for result in (
        record, found, found.estimate, found.verdict, found.actuator, told,
        ematwin.Faults(friction=0.25), ematwin.Faults(),
        ematwin.minimize(lambda x: float(x @ x), [-1.0], [1.0], "random", 5, 4),
    ):  # fmt: skip
        shown = result._repr_html_()
        parsed(shown)
        assert len(shown) < 20_000


def test_what_a_file_says_is_escaped(record: ematwin.Recording) -> None:
    evil = record.changed(labels={"run": "<script>alert(1)</script>"}, source="<img src=x>")
    tags = parsed(evil._repr_html_())
    assert not {"script", "img"} & tags.seen
    assert "&lt;script&gt;" in evil._repr_html_()


def test_figures_are_public_functions(record: ematwin.Recording, found: Identification) -> None:
    for kind in ("faults", "fit", "convergence"):
        assert found.plot(kind).data
    assert record.plot().data
    with pytest.raises(InputError, match="no figure 'pie'"):
        found.plot("pie")
    with pytest.raises(AttributeError, match="plot_nothing"):
        _ = plots.plot_nothing


def test_faults_are_drawn_as_deviations_coloured_by_the_verdict(found: Identification) -> None:
    drawn = plots.plot_faults(found)
    bars_of = {trace.name: trace for trace in drawn.data}
    assert list(bars_of["fault"].y) == ["friction"]
    healthy = bars_of["agrees with healthy"]
    assert max(abs(x) for x in healthy.x) < max(abs(x) for x in bars_of["fault"].x)
    assert bars_of["fault"].marker.color != healthy.marker.color
    truth = bars_of["true (simulated)"]
    place = list(truth.y).index("friction")
    assert truth.x[place] == pytest.approx(bars_of["fault"].x[0], abs=3.0)


def test_a_measured_recording_shows_no_truth(found: Identification) -> None:
    from dataclasses import replace

    drawn = plots.plot_faults(replace(found, provenance={"source": "file"}))
    assert "true (simulated)" not in [trace.name for trace in drawn.data]


def test_figures_are_thinned_to_their_extremes() -> None:
    long = ematwin.Recording(
        np.arange(200_000) / 1e4, {"current": np.r_[np.zeros(100_000), 9.0, np.zeros(99_999)]}
    )
    trace = plots.plot_recording(long).data[0]
    assert len(trace.x) < 5000
    assert max(trace.y) == 9.0


def test_without_pandas_one_sentence_says_what_to_install(record, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match=r'pip install "ematwin\[pandas\]"'):
        record.to_frame()
    assert "samples" in record._repr_html_()


def test_detection_tells_faults_apart_and_names_runs(tmp_path: Path) -> None:
    from synthetic_detection import detection

    result: Detection = detection(12)
    drawn = plots.plot_trend(result)
    colors = {trace.name: trace.marker.color for trace in drawn.data if trace.mode == "markers"}
    assert len(set(colors.values())) == len(colors) >= 4
    ticks = drawn.layout[f"xaxis{len(result.runs[0].magnitudes) + 1}"].ticktext
    assert ticks[0] == "1"
    assert result.to_frame().loc["run 1", "grade"] == "healthy"
    assert len(result.to_frame("motion")) == len(result.motions)
    assert result._repr_html_().index("raise an alarm") < result._repr_html_().index("<table")
    with pytest.raises(InputError, match="each must be run or motion"):
        result.to_frame("day")
    dated = plots.plot_trend(detection(6, dated=True))
    assert dated.layout[f"xaxis{len(result.runs[0].magnitudes) + 1}"].type == "date"
