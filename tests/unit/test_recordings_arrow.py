"""Columns between pyarrow and numpy, without pandas."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import ematwin


def test_nulls_of_a_parquet_file_are_holes(tmp_path) -> None:
    rng = np.random.default_rng(1)
    time, missing = np.arange(100_000) / 1e4, rng.random(100_000) < 0.01
    columns = {"time": time, "command": time, "current": pa.array(time, mask=missing)}
    pq.write_table(pa.table(columns), tmp_path / "run.parquet", row_group_size=777)
    record = ematwin.read(tmp_path / "run.parquet", gaps="mask")
    np.testing.assert_allclose(record.current, time, atol=1e-9)  # filled by straight lines
    assert len(record.provenance["masked_s"]) > 500


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
