"""``ematwin actuators`` and ``ematwin scenarios``: what is shipped, with units and sources."""

import math
import re
import tomllib
from pathlib import Path

import pytest

from ematwin import BldcActuator
from ematwin.models.registry import load_actuator, shipped_actuators
from refusals import refused, untouched


def test_shipped_sets_are_listed(ematwin, done):
    lines = ematwin("actuators").out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_actuators())
    assert "48 V brushless servo motor" in next(one for one in lines if one.startswith("servo48 "))
    assert done("actuators", "--json").told.keys() == shipped_actuators().keys()


def test_one_set_is_shown_with_the_unit_and_source_of_every_value(ematwin, done):
    text = ematwin("actuators", "servo48").out
    told = done("actuators", "servo48", "--json").told
    rows = {place: row for place, *row in BldcActuator.load("servo48").parameters()}
    assert told["parameters"].keys() == rows.keys()
    actuator = BldcActuator.load("servo48")
    for place, (value, unit, meaning, source) in rows.items():
        assert told["parameters"][place] == {
            "value": value, "unit": unit, "meaning": meaning, "source": source,
            "tolerance": actuator.tolerance(place), "drift": actuator.drift(place),
        }  # fmt: skip
        (line,) = [line for line in text.splitlines() if line.startswith(f"{place} ")]
        assert meaning in line
        assert f"[{source}]" in line
    speed = told["parameters"]["controller.speed_limit"]
    assert math.isclose(speed["value"], 8000 * 2 * math.pi / 60)
    assert speed["unit"] == "rad/s"


def test_shipped_scenarios_of_every_kind_are_listed_once(ematwin, done):
    names = [line.split()[0] for line in ematwin("scenarios").out.splitlines()]
    assert len(set(names)) == len(names)
    assert {"default", "out-and-back", "there-and-back", "swing"} <= set(names)
    assert done("scenarios", "--json").told["default"]["duration"] == 0.5


def test_the_tolerance_of_each_parameter_is_shown(ematwin, tmp_path):
    def shown(name: str) -> dict[str, str]:
        return dict(re.findall(r"^(\w+\.\w+) .*?±([\d.]+ %)", ematwin("actuators", name).out, re.M))

    usual = shown("servo48")
    assert usual["motor.resistance"] == "10 %"
    assert usual["motor.viscous_damping"] == "100 %"
    assert "motor.pole_pairs" not in usual
    known = BldcActuator.load("servo48").with_tolerances({"motor.resistance": "2.5 %"})
    known.save(tmp_path / "known.toml")
    assert shown("known.toml") == {**usual, "motor.resistance": "2.5 %"}


@pytest.mark.parametrize("name", ["servo48", "rm1605"])
def test_a_template_is_written_to_be_made_ones_own(ematwin, tmp_path, name):
    answer = ematwin("actuators", name, "--out", "mine.toml")
    assert (answer.code, answer.err) == (0, "")
    assert answer.out.endswith("wrote mine.toml\n")
    mine, shipped = load_actuator(tmp_path / "mine.toml"), load_actuator(name)
    assert mine == shipped
    assert list(mine.parameters()) == list(shipped.parameters())
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    for _, _, _, meaning, _ in mine.parameters():
        assert f"# {meaning}" in text
    # in the units of the shipped file, which people edit more easily
    content = tomllib.loads(text)
    before = tomllib.loads(shipped_actuators()[name].read_text(encoding="utf-8"))
    assert {**content, "kind": before.get("kind", "bldc")} == {"kind": "bldc", **before}


def test_a_template_that_cannot_be_written_is_refused(tmp_path):
    for arguments, said in (
        (["--out", "mine.toml"], "needs the name of an actuator"),
        (["servo48", "--out", "mine.txt"], "end its name in .toml"),
        (["servo48", "--out", "none/mine.toml"], "is missing or read-only"),
    ):
        untouched(tmp_path, "actuators", *arguments, said=said)


def test_a_filled_in_sheet_is_not_overwritten_without_a_word(ematwin, tmp_path: Path) -> None:
    sheet = tmp_path / "sheet.toml"
    assert ematwin("actuators", "servo48", "--out", "sheet.toml").code == 0
    sheet.write_text(sheet.read_text() + "# mine\n")
    refused(
        ematwin("actuators", "servo48", "--out", "sheet.toml"),
        "sheet.toml exists, and may hold what you put in. Give another name, or replace it with "
        "--force.",
    )
    assert "# mine" in sheet.read_text()
    assert ematwin("actuators", "servo48", "--out", "sheet.toml", "--force").code == 0
    assert "# mine" not in sheet.read_text()
