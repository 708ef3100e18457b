"""``ematwin identify`` as its users meet it: processes, files, a browser."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

import ematwin as library
from bldc_inputs import HALF
from commands import loaded
from ematwin.recordings.tables import write_table
from refusals import refused

FAULTS = {"friction": 0.3, "backlash": 0.15}


@pytest.fixture(scope="module")
def record() -> library.Recording:
    return library.simulate("reference", HALF, FAULTS)


@pytest.fixture
def folder(tmp_path: Path, record: library.Recording) -> Path:
    library.write(record, tmp_path / "rec.parquet")
    return tmp_path


def test_answer_for_programs_holds_faults_and_how_they_were_found(done, folder: Path) -> None:
    answer = done("identify", "rec.parquet", "--algorithm", "pso", "--budget", 2000, "--json")
    found = answer.told
    assert found["evaluations"] == 2000
    assert found["algorithm"] == "pso"
    assert found["stopped"] == "budget"
    assert set(found["faults"]) == set(library.Faults().as_dict())
    assert {"cost", "seconds", "seed"} <= set(found)


def test_table_for_people_names_value_and_healthy_value(done, folder: Path) -> None:
    answer = done("identify", "rec.parquet", "--only", "friction,backlash", "--exact")
    said = r"Two faults: friction \+60\.?\d* % \(0\.048\d* N m, 95 % interval .*\) and backlash x"
    assert re.match(said, answer.out)
    row = next(line for line in answer.out.splitlines() if "│ friction" in line)
    assert "0.04" in row
    assert " 0.03" in row
    assert "held" in answer.out
    assert "simulations in" in answer.out


def test_a_verdict_names_options_and_not_arguments(done, tmp_path, record) -> None:
    library.write(record.changed(load=None), tmp_path / "bare.parquet")
    answer = done("identify", "bare.parquet", "--exact")
    assert "Record it, or say what it was (--load 0 if there was none)." in answer.out
    assert "load=0" not in answer.out


def test_algorithms_are_listed_with_their_sources(ematwin, done) -> None:
    listed = {row["name"]: row for row in done("algorithms", "--json").told}
    assert {"multistart", "ga", "pso", "de", "gwo", "da", "woa", "cma"} <= set(listed)
    assert "Mirjalili" in listed["gwo"]["source"]
    assert "Table 1" in listed["pso"]["tuned_on"]
    assert "author" in listed["gwo"]["departures"]
    assert "improved             in a study: ga-tuned" in ematwin("algorithms").out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--budget", "0"], "budget"),
        (["--algorithm", "pzo"], "pso"),
        (["--algorithm", "de", "--population", "0"], "population"),
        (["--only", "fricton"], "friction"),
        (["--hold", "gain=7"], "gain"),
        (["--seed", "-1"], "seed must be a whole number of at least 0, received -1"),
        (["--report", "nowhere/out.html"], "nowhere"),
        (["--uncertainty", "guess"], "uncertainty must be laplace, profile, posterior"),
        (["--threshold", "friction=2"], r"threshold of friction must lie in its range \[0, 1\]"),
        (["--threshold", "friction=abc"], "must be a number; received 'abc'"),
        (["--threshold", "friction"], "--threshold needs name=value"),
        (["--threshold", "friction=3 N*m"], r"in its range \[0.03, 0.09\]"),
        (["--threshold", "tear=0.5"], "no searched fault 'tear'.*name one of friction"),
    ],
)
def test_option_that_cannot_be_used_is_refused(ematwin, folder, options, said):
    exact = ("--exact",) if options[0] in ("--uncertainty", "--threshold") else ()
    refused(ematwin("identify", "rec.parquet", *exact, *options), said)


def test_an_identification_loads_no_package_that_it_does_not_need(ematwin, folder: Path) -> None:
    ematwin("identify", "rec.parquet", "--exact")  # whatever compiles loads more
    unneeded = {"scipy.special", "pandas", "pint", "plotly"}  # numba loads scipy.linalg
    done = loaded(unneeded, "identify", "rec.parquet", "--exact", folder=folder)
    assert (done.code, done.err.strip()) == (0, "")


def test_missing_extra_names_the_command_that_installs_it(ematwin, folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "cma", None)
    refused(
        ematwin("identify", "rec.parquet", "--algorithm", "cma"), r'pip install "ematwin\[bench\]"'
    )


def test_ctrl_c_keeps_the_best_found_and_says_so(done, folder: Path) -> None:
    done("identify", "rec.parquet", "--algorithm", "de", "--budget", "100")
    arguments = "rec.parquet --algorithm de --budget 10000000 --report out.html"
    process = subprocess.Popen(
        [sys.executable, "-m", "ematwin", "identify", *arguments.split()], cwd=folder, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        # imports, loads kernels, searches
        while psutil.Process(process.pid).cpu_times().user < 3.0:
            assert process.poll() is None
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert "Interrupted: this is the best found so far." in out, err
    assert (process.returncode, err) == (130, "Interrupted; nothing was left half-written.\n")
    assert (folder / "out.html").exists()


def test_units_that_were_assumed_are_told_and_a_hopeless_fit_is_called_one(done, tmp_path, record):
    left_out = {"command", "output_position", "output_speed", "motor_position", "motor_speed"}
    columns = {name: values for name, values in record.columns() if name not in left_out}
    columns["reference"] = np.degrees(record.command)  # and nobody says so
    write_table(tmp_path / "bench.parquet", columns)
    answer = done("identify", "bench.parquet", "--column", "command=reference", "--column",
                     "time=time", *(f"--column=i_{k}=current_{k}" for k in "abc"))  # fmt: skip
    assert re.search(r"^Assumed: .*command in rad", answer.out, re.MULTILINE | re.IGNORECASE)
    assert "these values mean nothing" in answer.out


@pytest.mark.parametrize("kind", ["servo48", "rm1605"])
def test_every_kind_answers_without_calibration_and_says_so(ematwin, done, tmp_path, kind):
    ematwin("simulate", "--actuator", kind, "--seed", "1", "--out", "rec.csv")
    answer = done("identify", "rec.csv", "--actuator", kind, "--report", "out.html")
    assert f"Not calibrated: {kind} is known as far as its tolerances go" in answer.out
    found = done("identify", "rec.csv", "--actuator", kind, "--json").told
    assert found["kind"] == {"servo48": "bldc", "rm1605": "ball-screw"}[kind]
    assert found["present"] == []
    estimate = library.Estimate.from_dict(found["estimate"])
    assert set(estimate.names) == set(found["searched"])


def test_uncertainty_is_told_to_people_and_programs(done, folder: Path) -> None:
    asked = (
        "identify", "rec.parquet", "--exact", "--only", "friction,backlash", "--uncertainty",
        "profile", "--threshold", "friction=0.2", "--threshold", "backlash=0.07 rad",
    )  # fmt: skip
    answer = done(*asked, "--report", "page.html")
    assert "95 % by profile" in answer.out
    assert "friction is beyond 0.2: above 99 %." in answer.out
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert re.search(r"Two faults: friction \+(59\.9|60)", page)
    assert "How sure: profile" in page
    assert "Profiles of the faults" in page
    told = done(*asked, "--json").told["uncertainty"]
    assert told["method"] == "profile"
    assert told["walks"]["friction"]["shape"] == "bounded"
    assert told["exceeds"]["backlash"]["threshold"] == "0.07 rad"
