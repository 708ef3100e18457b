"""``ematwin design`` and ``identifiability`` from the shell."""

import json
from pathlib import Path

import pytest

from ematwin.models.scenario import Scenario
from refusals import refused, untouched

QUICK = ("--exact", "--budget", "3", "--actuator", "rm1605")


def test_a_command_is_written_shown_and_checked(done, tmp_path: Path) -> None:
    answer = done(
        "design", *QUICK, "--out", "test.toml", "--report", "page.html", "--check", "1",
        "--limit", "travel=130 mm",
    )  # fmt: skip
    assert "backlash" in answer.out
    assert "observed" in answer.out  # beside what is expected, in the table
    assert Scenario.load_file(tmp_path / "test.toml").duration == 12.96
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "The price" in page
    assert "times better" in page


def test_two_explanations_are_told_apart(ematwin, tmp_path: Path) -> None:
    answer = ematwin(
        "design", "--budget", "12", "--out", "next.toml", "--json", "--report", "next.html",
        "--discriminate", "friction=0.05", "--discriminate", "transmission.efficiency_opposing=0.8",
    )  # fmt: skip
    told = answer.told
    assert told["told"] is True
    assert told["distance"] > 3.0 * told["default_distance"]
    assert (tmp_path / "next.toml").is_file()


def test_what_identify_leaves_is_taken_from_its_answer(ematwin, tmp_path: Path) -> None:
    known = {"friction": 1.2, "gain": 1.0}
    left = {"faults": known, "other_answers": [{"friction": 1.0, "gain": 0.9}]}
    (tmp_path / "found.json").write_text(json.dumps(left), encoding="utf-8")
    answer = ematwin(
        "design", *QUICK, "--out", "next.toml", "--json", "--discriminate", "found.json"
    )
    assert answer.told["first"] == known
    (tmp_path / "found.json").write_text(json.dumps({**left, "other_answers": []}))
    answer = ematwin("design", *QUICK, "--out", "other.toml", "--discriminate", "found.json")
    refused(answer, "leaves one explanation only")
    assert not (tmp_path / "other.toml").exists()


DESIGN = ("design", *QUICK, "--out", "test.toml")


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ((*DESIGN, "--limit", "current=0.01"), r"keeps the limits \(current 0.01\)"),
        ((*DESIGN, "--limit", "pressure=1 mm"),
         "no limit 'pressure'.*; choose of travel, speed, current"),
        ((*DESIGN, "--limit", "current=3 V"), "--limit current must have a unit of the kind A"),
        ((*DESIGN, "--discriminate", "friction=1"), "needs two explanations"),
        ((*DESIGN, "--duration", "0 s"), "--duration must be a positive number"),
        ((*DESIGN, "--learn"),
         "--learn proposes tests of the healthy actuator and takes no --exact"),
        (("identifiability", "nonsense"), "There is no scenario 'nonsense'"),
        (("identifiability", "--miss", "0.7"), "--miss must lie between 0 and 0.5, received 0.7"),
        (("identifiability", "--fault", "wear=1"), "wear"),
        (("identifiability", "--report", "page.pdf"), "html"),
    ],
)  # fmt: skip
def test_wrong_input_gets_one_sentence(tmp_path, command, said):
    untouched(tmp_path, *command, said=said)


def test_healthy_tests_are_written_numbered(ematwin, done, tmp_path: Path) -> None:
    learn = ("design", "--learn", "--actuator", "rm1605", "--duration", "4 s", "--out", "test.toml")
    answer = done(*learn, "--report", "page.html")
    assert "screw.friction_force" in answer.out
    assert "give ematwin calibrate all healthy recordings" in " ".join(answer.out.split())
    for name in ("test.toml", "test-2.toml", "test-3.toml"):
        assert Scenario.load_file(tmp_path / name).duration == 4.0
    assert "Expected standard error" in (tmp_path / "page.html").read_text(encoding="utf-8")
    (tmp_path / "test.toml").unlink()
    refused(ematwin(*learn), "test-2.toml exists")
    assert not (tmp_path / "test.toml").exists()


# identifiability


def test_commands_are_ranked_and_shown(done, tmp_path: Path) -> None:
    answer = done("identifiability", "ramp", "default", "--exact", "--report", "page.html")
    assert answer.out.index("default, 0.5 s") < answer.out.index("ramp, 2 s")
    assert "Best command first" in answer.out
    assert "correlation" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_programs_get_all_of_it(ematwin) -> None:
    answer = ematwin("identifiability", "--actuator", "rm1605", "--json", "--fault", "friction=1.3")
    told = answer.told["commands"][0]
    assert told["faults"]["friction"] == 1.3
    assert {"friction", "backlash", "gain"} <= {one["name"] for one in told["told"]}


def test_indices_of_sobol_are_shown_on_request(done, tmp_path: Path) -> None:
    options = ("--actuator", "rm1605", "--exact", "--sobol", "--report", "page.html")
    answer = done("identifiability", *options)
    assert "Sobol indices" in answer.out
    assert "by itself" in (tmp_path / "page.html").read_text(encoding="utf-8")
    told = done("identifiability", *options[:4], "--json").told["commands"][0]
    assert set(told["sobol"]["total"]) == {"position_error", "current"}
