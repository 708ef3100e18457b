"""Recording: checked at the door; CSV and Parquet give it back bit for bit."""

import json
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import ematwin
from ematwin import Recording
from ematwin.errors import FileError, InputError, RecordError
from ematwin.models.bldc.channels import PHASES, UNITS, phase_currents
from ematwin.models.registry import model_of
from refusals import refusal_of

N = 50


def columns(**changed):
    """Columns of a small good record; None leaves one out."""
    time = np.arange(N) / 1000.0
    good = {
        "time": time,
        "command": 0.01 * np.sin(time),
        "current_a": np.sin(time),
        "current_b": np.sin(time - 2.0),
        "current_c": -np.sin(time) - np.sin(time - 2.0),
    }
    return {name: value for name, value in {**good, **changed}.items() if value is not None}


def refusal(**changed):
    return refusal_of(lambda: Recording(**columns(**changed)), RecordError)


def phases_refused(**changed):
    recording = Recording(**columns(**changed))
    return refusal_of(lambda: model_of("bldc").check_channels(recording), RecordError)


def changed_at(name, index, value):
    column = columns()[name].copy()
    column[index] = value
    return {name: column}


def test_a_good_record_tells_its_rate_and_columns():
    record = Recording(**columns())
    assert record.sample_rate == pytest.approx(1000.0)
    assert record.interval == pytest.approx(1e-3)
    assert len(record) == N
    assert [name for name, _ in record.columns()] == ["time", "command", *PHASES]
    assert phase_currents(record).shape == (N, 3)
    assert "50 samples, 0 to 0.049 s at 1000 Hz: time, command, current_a" in repr(record)


SWAPPED, GAPPED = columns()["time"], columns()["time"]
SWAPPED[[20, 21]] = SWAPPED[[21, 20]]
GAPPED[25:] += 0.01


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"time": SWAPPED}, r"sample 21 \(0.02 s\) follows 0.021 s.*Sort the record"),
        (changed_at("time", 7, 0.006), "time must increase: sample 7 "),
        (changed_at("time", 30, 0.0305), "time must be regular: the step to sample 30 "
         r"\(0.0305 s\) is 0.0015 s where 0.001 s is usual. Resample"),
        ({"time": GAPPED}, r"the step to sample 25 \(0.035 s\) is 0.011 s"),
        ({"time": np.zeros(0)}, "received 0"), ({"time": np.zeros(1)}, "received 1"),
        ({"command": np.zeros(N - 1)}, r"Column command has shape \(49,\) but time has \(50,\)"),
        ({"current_a": np.zeros(N - 1)}, r"Column current_a has shape \(49,\)"),
        ({"command": ["a"] * N}, "must hold numbers"),
        ({"command": np.zeros((N, 1))}, r"shape \(50, 1\)"),
        ({"provenance": {"made by": object()}}, "provenance must hold JSON values"),
    ],
)  # fmt: skip
def test_what_is_no_record_is_refused_with_the_place(changed, said):
    assert re.search(said, refusal(**changed))


@given(offset=st.floats(0, 1e6), rate=st.floats(10, 1e5))
def test_times_that_are_regular_but_for_their_rounding_pass(offset, rate):
    time = offset + np.arange(N) / rate
    if np.diff(time).min() > 0.0:
        assert len(Recording(**columns(time=time))) == N


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["time", "command", "current_b"])
def test_nan_and_infinity_are_refused_with_the_place(name, value):
    text = refusal(**changed_at(name, 13, value))
    assert name in text
    assert "sample 13" in text


def test_a_missing_phase_is_named():
    text = phases_refused(current_b=None)
    assert "current_a, current_c but not current_b" in text
    assert "bench.csv run 7 has" in phases_refused(
        current_b=None, source="bench.csv", labels={"run": "7"}
    )


def test_a_record_without_any_current_is_refused():
    assert "no current" in phases_refused(current_a=None, current_b=None, current_c=None)


finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | finite | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=8,
)


@st.composite
def records(draw):
    """Any record: any rate and start, any finite values, any JSON as provenance."""
    size = draw(st.integers(2, 40))
    rate = draw(st.sampled_from([1.0, 1000.0, 20_000.0, 12_345.678, 1e5 / 3.0]))
    values = {"time": draw(st.floats(-100, 100)) + np.arange(size) / rate}
    column = hnp.arrays(np.float64, size, elements=finite)
    values["command"] = draw(column)
    names = draw(st.sampled_from([PHASES, ("current",), (*PHASES, "current")]))
    others = ("load", "motor_position", "motor_speed", "output_position", "output_speed")
    chosen = draw(st.lists(st.sampled_from(others), unique=True))
    for name in (*names, *chosen):
        values[name] = draw(column)
    return Recording(**values, provenance=draw(st.dictionaries(st.text(max_size=8), json_values)))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@given(record=records())
def test_any_record_survives_its_file_bit_for_bit(tmp_path_factory, suffix, record):
    path = tmp_path_factory.mktemp("round") / f"record{suffix}"
    ematwin.write(record, path)
    back = ematwin.read(path)
    assert [name for name, _ in back.columns()] == [name for name, _ in record.columns()]
    for name, column in record.columns():
        assert getattr(back, name).tobytes() == column.tobytes(), name
    if record.provenance:
        assert json.dumps(back.provenance, sort_keys=True) == json.dumps(
            record.provenance, sort_keys=True
        )


def test_a_written_file_says_its_units_to_other_programs(tmp_path):
    import pyarrow.parquet as pq

    ematwin.write(Recording(**columns()), tmp_path / "record.parquet")
    note = json.loads(pq.read_schema(tmp_path / "record.parquet").metadata[b"ematwin"])
    assert note["units"] == {name: UNITS[name] for name in columns()}
    ematwin.write(Recording(**columns()), tmp_path / "record.csv")
    first, header = (tmp_path / "record.csv").read_text().splitlines()[:2]
    assert json.loads(first.removeprefix("# ematwin "))["units"]["current_a"] == "A"
    assert header.replace('"', "") == "time,command,current_a,current_b,current_c"


def test_what_cannot_be_written_leaves_nothing(tmp_path):
    old = tmp_path / "record.csv"
    old.write_text("old")
    with pytest.raises(FileError, match="Cannot write"):
        ematwin.write(Recording(**columns()), tmp_path / "none" / "record.csv")
    with pytest.raises(InputError, match="Cannot tell how to write"):
        ematwin.write(Recording(**columns()), tmp_path / "record.xlsx")
    assert list(tmp_path.iterdir()) == [old]
    assert old.read_text() == "old"
