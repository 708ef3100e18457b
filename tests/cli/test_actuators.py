"""``ematwin actuators`` and ``ematwin scenarios``: what is shipped, with units and sources."""

import json
import math

from ematwin import Actuator
from ematwin.plant.kinds import shipped_actuators
from ematwin.plant.scenario import shipped_scenarios


def test_shipped_sets_are_listed(ematwin):
    lines = ematwin("actuators").out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_actuators())
    assert "48 V brushless servo motor" in lines[0]
    assert json.loads(ematwin("actuators", "--json").out).keys() == shipped_actuators().keys()


def test_one_set_is_shown_with_the_unit_and_source_of_every_value(ematwin):
    text = ematwin("actuators", "servo48").out
    told = json.loads(ematwin("actuators", "servo48", "--json").out)
    rows = {place: row for place, *row in Actuator.load("servo48").parameters()}
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
    assert [line.split()[0] for line in lines] == list(shipped_scenarios())
    told = json.loads(ematwin("scenarios", "--json").out)
    assert told["default"]["duration"] == 0.5
