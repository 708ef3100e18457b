"""``ematwin simulate`` and ``export-fmu``: records, plots, archives, answers for programs."""

import re
import zipfile

import numpy as np
import pytest

import ematwin as library
from ematwin.models.bldc.channels import current_envelope, phase_currents


def test_the_main_job_writes_a_record_and_a_plot(ematwin, tmp_path):
    answer = ematwin(
        "simulate", "--fault", "friction=0.25", "--fault", "backlash=0.1", "--model", "reference",
        "--seed", "1", "--out", "rec.parquet", "--plot", "rec.html",
    )  # fmt: skip
    assert (answer.code, answer.err) == (0, "")
    assert "wrote rec.parquet" in answer.out
    assert re.search(r"friction +0\.25 +0\.045 N m +0\.03 N m", answer.out)
    assert re.search(r"backlash +0\.1 +0\.0545 rad +0\.005 rad", answer.out)
    record = library.read(tmp_path / "rec.parquet")
    assert phase_currents(record) is not None
    assert record.provenance["faults"]["friction"] == 0.25
    assert record.provenance["seed"] == 1
    page = (tmp_path / "rec.html").read_text(encoding="utf-8")
    assert "faulty and healthy" in page
    assert len(page) < 1.5e6
    assert "The faults change the equivalent current by" in page
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rec.html", "rec.parquet"]


@pytest.mark.parametrize("model", ["reference", "monitor"])
def test_the_answer_for_programs_is_json_and_agrees_with_the_library(ematwin, tmp_path, model):
    answer = ematwin(
        "simulate", "--model", model, "--scenario", "step", "--fault", "short_a=0.3",
        "--noise", "white=0.02,bits=12", "--seed", "3", "--sample-rate", "5000",
        "--out", "rec.csv", "--json",
    )  # fmt: skip
    assert (answer.code, answer.err) == (0, "")
    told = answer.told
    record = library.simulate(
        model, "step", {"short_a": 0.3}, noise=library.Noise(white=0.02, bits=12), seed=3,
        sample_rate=5000,
    )  # fmt: skip
    written = library.read(tmp_path / "rec.csv")
    for name, column in record.columns():
        assert getattr(written, name).tobytes() == column.tobytes(), name
    envelope = current_envelope(record)
    assert told["samples"] == len(record)
    assert told["sample_rate"] == pytest.approx(5000)
    assert told["current_rms"] == pytest.approx(np.sqrt(np.mean(envelope**2)))
    assert told["current_peak"] == pytest.approx(envelope.max())
    assert told["faults"] == library.Faults(short_a=0.3).as_dict()
    assert told["physical"]["short_a"] == {
        "value": pytest.approx(12.0), "healthy": 0.0, "unit": "turns"
    }  # fmt: skip
    assert (told["model"], told["actuator"], told["scenario"]) == (model, "servo48", "step")
    assert (told["out"], told["plot"], told["seed"]) == ("rec.csv", None, 3)


def test_two_runs_with_one_seed_write_the_same_file(ematwin, tmp_path):
    for name in ("one.parquet", "two.parquet"):
        ematwin("simulate", "--model", "monitor", "--noise", "white=0.05", "--seed", "9",
                "--out", name)  # fmt: skip
    assert (tmp_path / "one.parquet").read_bytes() == (tmp_path / "two.parquet").read_bytes()


def test_files_of_the_users_own_are_taken(ematwin, tmp_path):
    from ematwin.models.registry import shipped_actuators

    shipped = shipped_actuators()["servo48"].read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(shipped.replace('name = "servo48"', 'name = "mine"'))
    (tmp_path / "flight.csv").write_text("time [ms],command [deg]\n0,0\n100,0.2\n300,0\n")
    answer = ematwin("simulate", "--model", "monitor", "--actuator", "mine.toml",
                     "--scenario", "flight.csv", "--step", "5e-6", "--json")  # fmt: skip
    told = answer.told
    assert (told["actuator"], told["scenario"]) == ("mine", "flight")
    assert told["samples"] == 6001


def test_help_and_version_are_at_hand(ematwin):
    for arguments in ([], ["--help"], ["-h"]):
        answer = ematwin(*arguments)
        assert answer.code == 0
        assert "simulate" in answer.out
    assert "--fault" in ematwin("simulate", "--help").out
    assert ematwin("--version").out == f"ematwin {library.__version__}\n"


def test_the_archive_is_written_and_named(ematwin, tmp_path):
    answer = ematwin("export-fmu", "emps", "--out", "axis.fmu", "--fmi", "2", "--json")
    assert (answer.code, answer.err) == (0, "")
    found = answer.told
    actuator = library.load_actuator("emps")
    assert (found["kind"], found["fmi"]) == ("linear-axis", 2)
    assert found["fingerprint"] == actuator.fingerprint
    with zipfile.ZipFile(tmp_path / "axis.fmu") as archive:
        assert archive.testzip() is None
        (tmp_path / "again.toml").write_bytes(archive.read("resources/actuator.toml"))
    assert library.load_actuator(tmp_path / "again.toml").fingerprint == actuator.fingerprint
