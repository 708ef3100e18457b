"""Floats between pyarrow and numpy, by their buffers."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from ematwin.recordings.formats.arrow import as_floats, as_integers, from_numpy


@pytest.mark.parametrize(
    "values", [[1.0, 2.0, 3.0], [1.0, None, 3.0], [None, None], [], [float("nan"), 1e300]]
)
@pytest.mark.parametrize("skipped", [0, 1])
def test_floats_are_those_of_pyarrow(values, skipped) -> None:
    column = pa.array(values, pa.float64())[skipped:]
    expected = column.to_numpy(zero_copy_only=False)
    np.testing.assert_array_equal(as_floats(column), expected)


def test_a_long_column_with_nulls_anywhere() -> None:
    rng = np.random.default_rng(1)
    values = rng.standard_normal(1000)
    column = pa.array(values, mask=rng.random(1000) < 0.3)[17:901]
    np.testing.assert_array_equal(as_floats(column), column.to_numpy(zero_copy_only=False))


def test_integers_and_back() -> None:
    column = pa.array([5, 7, 9], pa.int64())[1:]
    np.testing.assert_array_equal(as_integers(column), [7, 9])
    assert as_integers(pa.array([], pa.int64())).size == 0
    for values in (np.array([1.0, np.nan]), np.arange(10.0)[::3], np.empty(0)):
        np.testing.assert_array_equal(as_floats(from_numpy(values)), values)
    assert from_numpy(["a", "b"]).to_pylist() == ["a", "b"]


def test_reading_and_writing_import_no_pandas(tmp_path) -> None:
    code = (
        "import sys, ematwin\n"
        f"path = {str(tmp_path)!r} + '/record'\n"
        "record = ematwin.simulate('monitor')\n"
        "for kind in ('.csv', '.parquet'):\n"
        "    ematwin.write(record, path + kind)\n"
        "    ematwin.read(path + kind)\n"
        "print({'pandas', 'scipy.signal', 'pint', 'rich'} & set(sys.modules))\n"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "set()"
