"""Parameter files: each value with unit and source, in SI inside, impossible ones refused."""

import re
import tomllib
from pathlib import Path

import pytest

from ematwin.errors import FileError, ParameterError
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.parameter_set import Section

SHIPPED = BldcActuator.shipped()["servo48"].read_text(encoding="utf-8")


def edited(tmp_path: Path, place: str, **leaf: object) -> Path:
    """The shipped file with one value, unit or source replaced, or left out where None."""
    section, name = place.split(".")
    table = tomllib.loads(SHIPPED)
    entry = {**table[section][name], **leaf}
    inner = ", ".join(
        f"{key} = {_toml(value)}" for key, value in entry.items() if value is not None
    )
    pattern = rf"(\[{section}\][^\[]*?\n{name} = )\{{.*?\}}\n"
    text, count = re.subn(pattern, lambda m: f"{m[1]}{{ {inner} }}\n", SHIPPED, flags=re.DOTALL)
    assert count == 1
    path = tmp_path / "edited.toml"
    path.write_text(text, encoding="utf-8")
    return path


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, int | float) else f'"{value}"'


def refusal(path: Path) -> str:
    with pytest.raises(ParameterError) as caught:
        BldcActuator.load(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith(".")
    return text


def test_shipped_values_are_converted_to_si():
    actuator = BldcActuator.load("servo48")
    assert actuator.motor.inductance == pytest.approx(0.72e-3)
    assert actuator.motor.inertia == pytest.approx(2.5e-6)
    assert actuator.controller.speed_limit == pytest.approx(8000 * 2 * 3.141592653589793 / 60)
    assert actuator.transmission.travel_high == pytest.approx(30 * 3.141592653589793 / 180)
    assert actuator.steps.reference == pytest.approx(1e-6)
    assert actuator.motor.pole_pairs == 2


def test_every_shipped_value_names_unit_meaning_and_source():
    for name in BldcActuator.shipped():
        rows = list(BldcActuator.load(name).parameters())
        fields = [
            field
            for section in BldcActuator.model_fields.values()
            if isinstance(section.annotation, type) and issubclass(section.annotation, Section)
            for field in section.annotation.model_fields
        ]
        assert len(rows) == len(fields)
        for place, value, _unit, meaning, source in rows:
            assert isinstance(value, int | float), place
            assert meaning, place
            assert source, place
            assert source != "set by the user", place


def test_the_default_is_the_shipped_set():
    assert BldcActuator.load() == BldcActuator.load("servo48")


@pytest.mark.parametrize("leaf", ["value", "unit", "source"])
def test_a_value_without_its_value_unit_or_source_is_refused(tmp_path, leaf):
    text = refusal(edited(tmp_path, "motor.resistance", **{leaf: None}))
    assert "motor.resistance" in text


def test_an_empty_source_is_refused(tmp_path):
    assert "source" in refusal(edited(tmp_path, "motor.resistance", source=" "))


@pytest.mark.parametrize(
    ("place", "value", "unit", "si"),
    [
        ("motor.resistance", 2130, "mohm", 2.13),
        ("motor.inductance", 720, "uH", 0.72e-3),
        ("motor.emf_constant", 7.8749256, "V/krpm", 0.0752),
        ("motor.emf_constant", 0.0752, "N*m/A", 0.0752),
        ("motor.friction_torque", 15, "mNm", 0.015),
        ("motor.friction_torque", 0.015, "Nm", 0.015),
        ("controller.speed_limit", 837.758, "rad/s", 837.758),
        ("transmission.efficiency_opposing", 90, "percent", 0.9),
        ("transmission.travel_high", 0.5235987755982988, "rad", 0.5235987755982988),
        ("steps.monitor", 0.01, "ms", 1e-5),
    ],
)
def test_values_may_stand_in_any_unit_of_their_kind(tmp_path, place, value, unit, si):
    actuator = BldcActuator.load(edited(tmp_path, place, value=value, unit=unit))
    section, name = place.split(".")
    assert getattr(getattr(actuator, section), name) == pytest.approx(si, rel=1e-6)


@pytest.mark.parametrize(
    ("place", "unit"),
    [
        ("motor.resistance", "H"),
        ("motor.resistance", "ohms per furlong"),
        ("motor.inertia", "kg"),
        ("drive.current_limit", "V"),
        ("controller.speed_limit", "Hz"),  # a frequency is no angular speed
        ("controller.position_gain", "Hz"),  # the bandwidth in Hz is not the gain in 1/s
        ("transmission.travel_high", ""),  # a bare number is no angle
        ("transmission.ratio", "deg"),
        ("motor.pole_pairs", "N"),
    ],
)
def test_a_unit_of_another_kind_is_refused(tmp_path, place, unit):
    text = refusal(edited(tmp_path, place, unit=unit))
    assert place in text
    assert repr(unit) in text


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("motor.inductance", -0.72),
        ("motor.resistance", 0),
        ("motor.inertia", 0),
        ("motor.pole_pairs", 1.5),
        ("motor.leakage_share", 0),
        ("transmission.output_inertia", 0.0),
        ("transmission.backlash", -0.1),
        ("transmission.efficiency_aiding", 1.2),
        ("transmission.static_ratio", 0.5),
        ("transmission.travel_low", 5),
        ("drive.supply_voltage", float("inf")),
        ("drive.supply_voltage", float("nan")),
    ],
)
def test_an_impossible_value_is_refused_with_what_was_received(tmp_path, place, value):
    text = refusal(edited(tmp_path, place, value=value))
    assert place.split(".")[1] in text
    assert "received" in text


@pytest.mark.parametrize("value", ["much", True])
def test_a_value_that_is_no_number_is_refused(tmp_path, value):
    assert "must be a number" in refusal(edited(tmp_path, "motor.resistance", value=value))


def test_milliamperes_taken_for_amperes_are_recognised(tmp_path):
    assert "mA" in refusal(edited(tmp_path, "drive.current_limit", value=22500))


@pytest.mark.parametrize("model", ["reference", "monitor"])
def test_a_step_longer_than_the_stable_one_is_refused(tmp_path, model):
    text = refusal(edited(tmp_path, f"steps.{model}", value=1, unit="ms"))
    assert f"step of the {model} model" in text
    assert "received 0.001 s" in text


def test_an_absurdly_short_step_is_refused(tmp_path):
    assert "received 1e-12 s" in refusal(edited(tmp_path, "steps.monitor", value=1e-6))


def test_the_longest_step_is_that_of_the_fastest_mode():
    actuator = BldcActuator.load()
    motor, control = actuator.motor, actuator.controller
    assert actuator.largest_stable_step("monitor") == pytest.approx(
        motor.inertia / (control.speed_gain + motor.viscous_damping)
    )
    assert actuator.largest_stable_step("reference") < actuator.largest_stable_step("monitor")
    stiffer = actuator.changed({"transmission.contact_stiffness": 1e6, "steps.reference": 1e-7})
    assert stiffer.largest_stable_step("reference") < actuator.largest_stable_step("reference")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("resistance = {", "resistence = {", "motor.resistence"),
        ("[motor]", "[moter]", "moter"),
        ('name = "servo48"\n', "", "name is missing"),
        ("[motor]", "[[motor]]", "motor"),
    ],
)
def test_a_misspelt_or_missing_name_is_named(tmp_path, old, new, said):
    path = tmp_path / "bad.toml"
    path.write_text(SHIPPED.replace(old, new, 1), encoding="utf-8")
    assert said in refusal(path)


def test_a_file_that_is_not_toml_is_refused(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("motor = [", encoding="utf-8")
    assert "not valid TOML" in refusal(path)
    path.write_bytes(b"\xff\xfe\x00binary")
    assert "not text" in refusal(path)


def test_a_missing_file_and_an_unknown_set_are_refused(tmp_path):
    with pytest.raises(FileError, match="Cannot read the actuator file"):
        BldcActuator.load(tmp_path / "none.toml")
    with pytest.raises(ParameterError, match=r"There is no actuator 'servo49'. Shipped: servo48"):
        BldcActuator.load("servo49")


def test_a_variant_keeps_what_it_does_not_change():
    actuator = BldcActuator.load()
    variant = actuator.changed({"motor.resistance": 2.3})
    assert variant.motor.resistance == 2.3
    assert variant.motor.inductance == actuator.motor.inductance
    assert actuator.motor.resistance == 2.13
    with pytest.raises(ParameterError, match="not a parameter"):
        actuator.changed({"motor.resistence": 2.3})
    with pytest.raises(ParameterError, match="received -1"):
        actuator.changed({"motor.inductance": -1.0})


def test_equal_values_have_one_fingerprint_whatever_their_unit(tmp_path):
    same = BldcActuator.load(edited(tmp_path, "motor.resistance", value=2130, unit="mohm"))
    assert same.fingerprint == BldcActuator.load().fingerprint
    other = BldcActuator.load().changed({"motor.resistance": 2.14})
    assert other.fingerprint != BldcActuator.load().fingerprint


def test_kernels_get_phase_values_on_the_motor_shaft():
    actuator = BldcActuator.load()
    c = kernel_constants(actuator)
    assert c.resistance == actuator.motor.resistance / 2
    assert c.inductance == actuator.motor.inductance / 2
    assert c.k_e == actuator.motor.emf_constant / 2
    assert c.half_gap == actuator.transmission.backlash / 2
    assert c.travel_high == pytest.approx(actuator.transmission.travel_high * 500)
    assert c.c_opposing == pytest.approx(1 / 0.9 - 1)
    assert c.c_aiding == pytest.approx(1 - 0.85)
