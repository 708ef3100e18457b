"""``examples/emps.py`` and the commands on an axis recorded like EMPS: made up, and the real one.

The real recording is not part of ematwin. Where the environment variable EMPS_DATA names its file,
what docs/real-recordings.md says of it is tested as well.
"""

import os
import re
from pathlib import Path

import numpy as np
import pytest

import ematwin as library
import made_up_emps as made_up
from commands import script
from ematwin.models.registry import load_actuator

EXAMPLE = Path(__file__).parents[2] / "examples" / "emps.py"
REAL = Path(os.environ.get("EMPS_DATA", "there-is-none"))
real = pytest.mark.skipif(
    not REAL.is_file(), reason="EMPS_DATA does not name the estimation recording of EMPS"
)


@pytest.fixture(scope="module")
def answer(tmp_path_factory) -> dict:
    """What is found of the made-up axis from one recording, and of another with pulses."""
    folder = tmp_path_factory.mktemp("emps")
    estimation = made_up.write(folder / "estimation.mat")
    judge = made_up.write(folder / "judge.mat", pulses=True)
    done = script(EXAMPLE, estimation, "--judge", judge, "--json")
    assert (done.code, done.err) == (0, "")
    return done.told


def test_intervals_hold_the_truth_of_an_axis_that_the_twin_is_not(answer):
    true = {"mass": made_up.AXIS.mass}
    for name in ("viscous", "coulomb"):
        values = getattr(made_up.AXIS, name)
        true |= {f"{name}_forward": values[0], f"{name}_backward": values[1]}
    for name, value in true.items():
        row = answer["parameters"][name]
        assert row["low"] <= value <= row["high"], name
        assert row["low"] <= row["value"] <= row["high"], name
    mass = answer["parameters"]["mass"]
    assert mass["value"] == pytest.approx(made_up.AXIS.mass, rel=0.01)
    assert mass["high"] - mass["low"] < 0.05 * made_up.AXIS.mass


def test_pulses_are_predicted_as_well_as_the_recording_that_was_learnt_from(answer):
    assert set(answer) == {"parameters", "estimation", "judge"}
    for title in ("estimation", "judge"):
        scores = answer[title]
        assert scores["force_percent"] < 4.0
        assert scores["position_percent"] < 0.003
        assert scores["open_loop_rmse_mm"] < 3.0
        assert scores["open_loop_interval"]["inside_percent"] > 80.0


def test_tables_say_the_same_to_people(tmp_path):
    done = script(EXAMPLE, made_up.write(tmp_path / "one.mat"))
    assert done.code == 0
    assert "mass" in done.out
    assert "open loop" in done.out
    assert "judge" not in done.out


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"qm": None}, r"lacks qm \(position\); it holds t, qg, vir, gtau, kp, kv"),
        ({"vir": np.ones((5, 1))}, "all columns must be equally long"),
        ({"vir": -made_up.recorded()["vir"]}, "opposite to what the controller gives"),
        ({"qm": np.full_like(made_up.recorded()["qm"], np.nan)}, "NaN or infinite"),
        ({"kv": np.array([[9e4]])}, "unstable with controller.velocity_gain"),
        ({"kp": np.array([[1.0, 2.0]])}, "kp must be one finite number"),
        ({"t": made_up.recorded()["t"] * 2.0}, r"every 0.002 s and the controller"),
        ({"qg": np.array(["text"])}, "qg must be one column of numbers"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(tmp_path, changed, said):
    refused(script(EXAMPLE, made_up.write(tmp_path / "wrong.mat", **changed), "--json"), said)


def refused(done, said):
    """An example ends with one sentence and nothing else."""
    assert (done.code, done.out, done.err.count("\n")) == (1, "", 1)
    assert re.search(said, done.err), done.err


def test_a_missing_or_foreign_file_or_a_wrong_judge_is_refused(tmp_path):
    foreign = tmp_path / "notes.mat"
    foreign.write_text("no MATLAB file")
    for path in (foreign, tmp_path / "nowhere.mat", tmp_path):
        refused(script(EXAMPLE, path), re.escape(str(path)))
    good = made_up.write(tmp_path / "good.mat")
    bad = made_up.write(tmp_path / "bad.mat", vir=None)
    refused(script(EXAMPLE, good, "--judge", bad, "--json"), r"vir \(voltage\)")


def test_a_recording_that_is_too_short_to_hold_a_half_back_says_so(tmp_path):
    content = {n: made_up.recorded()[n][:3000] for n in ("t", "qg", "qm", "vir")}
    done = script(EXAMPLE, made_up.write(tmp_path / "short.mat", **content), "--held-back")
    assert "lasts 3 s; a held-back half ends at 4.4 s" in done.err


def recording_of(content: dict) -> library.Recording:
    """The columns of a MATLAB file as channels."""
    names = {"reference": "qg", "position": "qm", "voltage": "vir"}
    channels = {name: content[column].ravel() for name, column in names.items()}
    return library.Recording(content["t"].ravel(), channels)


def test_commands_calibrate_and_identify_a_file(done, tmp_path):
    """A sound calibration finds its own recording healthy; a symmetric screw does not.

    Both frictions of the made-up axis are asymmetric.
    """
    library.write(recording_of(made_up.recorded()), tmp_path / "axis.parquet")
    template = load_actuator("emps-symmetric").changed({
        "carriage.mass": 88.0, "drive.gain": made_up.GAIN,
        "controller.position_gain": made_up.K_POSITION,
        "controller.velocity_gain": made_up.K_VELOCITY,
    })  # fmt: skip
    template.save(tmp_path / "sound.toml")
    judged = done("identify", "axis.parquet", "--actuator", "sound.toml", "--json")
    verdict = judged.told["verdict"]
    assert verdict["grade"] == "fault"
    assert sorted(verdict["faults"]) == ["dry_asymmetry", "viscous_asymmetry"]
    done("calibrate", "axis.parquet", "--actuator", "emps", "--out", "own.toml")
    again = done("identify", "axis.parquet", "--actuator", "own.toml", "--json")
    assert again.told["verdict"]["grade"] == "healthy", again.out


# The real recording


@pytest.fixture(scope="module")
def published(tmp_path_factory) -> dict:
    done = script(EXAMPLE, REAL, "--json")
    assert done.code == 0, done.err
    return done.told


@real
def test_real_mass_is_that_of_the_authors(published):
    """Janot et al. (2019): 95.109 and 95.154 kg."""
    row = published["parameters"]["mass"]
    assert row["value"] == pytest.approx(95.1, rel=0.03)
    assert row["low"] < 95.109 < row["high"]


@real
def test_real_closed_loop_is_as_close_as_stated(published):
    """docs/real-recordings.md; published 5.848 and .0138 %, symmetric friction."""
    scores = published["estimation"]
    assert scores["force_percent"] < 2.7
    assert scores["position_percent"] < 6.2e-4
    assert scores["open_loop_rmse_mm"] < 4.0


@real
def test_real_friction_is_asymmetric_and_flagged():
    """The authors put it down to fatigue of the screw."""
    from scipy.io import loadmat

    found = library.identify(recording_of(loadmat(REAL)), "emps-symmetric")
    assert found.verdict.grade == "fault"
    assert found.verdict.faults == ("viscous_asymmetry",)
    low, high = found.intervals["viscous_asymmetry"]
    assert low < 240.4 / 166.7 < high
    _, (low, high) = found.contrasts["asymmetry"]
    assert 1.1 < low < 0.5 * (240.4 / 166.7 + 20.63 / 20.14) < high < 1.4
