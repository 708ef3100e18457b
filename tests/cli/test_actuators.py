"""``ematwin actuators`` and ``ematwin scenarios``: what is shipped, with units and sources."""

import json
import math

from ematwin import BldcActuator
from ematwin.models.registry import shipped_actuators
from ematwin.models.scenario import shipped_scenarios


def test_shipped_sets_are_listed(ematwin):
    lines = ematwin("actuators").out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_actuators())
    assert "48 V brushless servo motor" in lines[0]
    assert json.loads(ematwin("actuators", "--json").out).keys() == shipped_actuators().keys()


def test_one_set_is_shown_with_the_unit_and_source_of_every_value(ematwin):
    text = ematwin("actuators", "servo48").out
    told = json.loads(ematwin("actuators", "servo48", "--json").out)
    rows = {place: row for place, *row in BldcActuator.load("servo48").parameters()}
    assert told["parameters"].keys() == rows.keys()
    for place, (value, unit, meaning, source) in rows.items():
        assert told["parameters"][place] == {
            "value": value, "unit": unit, "meaning": meaning, "source": source
        }  # fmt: skip
        (line,) = [line for line in text.splitlines() if line.startswith(f"{place} ")]
        assert meaning in line
        assert f"[{source}]" in line
    speed = told["parameters"]["controller.speed_limit"]
    assert math.isclose(speed["value"], 8000 * 2 * math.pi / 60)
    assert speed["unit"] == "rad/s"


def test_a_file_is_shown_like_a_shipped_set(ematwin, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(shipped_actuators()["servo48"].read_bytes())
    assert ematwin("actuators", "mine.toml").out == ematwin("actuators", "servo48").out


def test_shipped_scenarios_are_listed(ematwin):
    lines = ematwin("scenarios").out.splitlines()
    names = [line.split()[0] for line in lines]
    assert names == [*shipped_scenarios(), *shipped_scenarios("ematwin.models.ball_screw")]
    told = json.loads(ematwin("scenarios", "--json").out)
    assert told["default"]["duration"] == 0.5


def test_faults_and_channels_of_a_kind_are_shown(ematwin):
    told = json.loads(ematwin("actuators", "rm1605", "--json").out)
    assert told["kind"] == "ball-screw"
    assert told["channels"]["set_point"]["unit"] == "m"
    assert told["unknowns"]["friction"]["role"] == "fault"
    text = ematwin("actuators", "servo48").out
    assert "eccentricity_phase" in text
    assert "motor shaft angle" in text


def test_a_shipped_set_is_copied_to_be_made_ones_own(ematwin, tmp_path):
    answer = ematwin("actuators", "servo48", "--out", "mine.toml")
    assert (answer.code, answer.err) == (0, "")
    mine = BldcActuator.load(tmp_path / "mine.toml")
    assert mine.fingerprint == BldcActuator.load("servo48").fingerprint
    assert list(mine.parameters()) == list(BldcActuator.load("servo48").parameters())
    refused = ematwin("actuators", "--out", "mine.toml")
    assert refused.code == 2
    assert "needs the name of an actuator" in refused.err
