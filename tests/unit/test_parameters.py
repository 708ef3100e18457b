"""Parameter files: each value with unit and source, in SI inside, impossible ones refused."""

import pickle
import re
import tomllib
from pathlib import Path

import pytest
import tomli_w

from ematwin.errors import ParameterError
from ematwin.models.bldc.faults import FIXED
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.parameter_set import quantity
from refusals import refusal_of

SHIPPED = BldcActuator.shipped()["servo48"].read_text(encoding="utf-8")


def edited(tmp_path: Path, place: str, **leaf: object) -> Path:
    """The shipped file with one value, unit or tolerance replaced."""
    section, name = place.split(".")
    table = tomllib.loads(SHIPPED)
    table[section][name] |= leaf
    path = tmp_path / "edited.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path


def refusal(path: Path) -> str:
    return refusal_of(lambda: BldcActuator.load(path), ParameterError)


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
        ("controller.speed_limit", 8000, "rpm", 837.7580410),
        ("controller.speed_limit", 8000, "1/min", 837.7580410),
        ("controller.speed_limit", 8000, "U/min", 837.7580410),
        ("controller.speed_limit", 8000, "min-1", 837.7580410),
        ("motor.emf_constant", 7.8749256, "V/1000rpm", 0.0752),
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
        ("motor.resistance", "ohms per furlong"),
        ("controller.speed_limit", "Hz"),  # a frequency is no angular speed
        ("controller.position_gain", "Hz"),  # the bandwidth in Hz is not the gain in 1/s
        ("transmission.travel_high", ""),  # a bare number is no angle
        ("transmission.ratio", "deg"),
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
        ("drive.current_limit", 22500),  # mA
        ("steps.monitor", 1e-6),  # us
    ],
)
def test_an_impossible_value_is_refused_with_what_was_received(tmp_path, place, value):
    text = refusal(edited(tmp_path, place, value=value))
    assert place.split(".")[1] in text
    assert {22500: "mA", 1e-6: "received 1e-12 s"}.get(value, "received") in text


def test_a_file_that_is_not_toml_is_refused(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("motor = [", encoding="utf-8")
    assert "not valid TOML" in refusal(path)
    path.write_bytes(b"\xff\xfe\x00binary")
    assert "not text" in refusal(path)


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


# Tolerances and drift


def test_a_tolerance_is_that_of_the_kind_unless_the_file_states_one(tmp_path):
    assert BldcActuator.load().tolerance("motor.resistance") == 0.1
    for written in ("5 %", "5%", " 5.0 % ", 0.05):
        path = edited(tmp_path, "motor.resistance", tolerance=written)
        actuator = BldcActuator.load(path)
        assert actuator.tolerance("motor.resistance") == pytest.approx(0.05)
        assert actuator.tolerance("motor.inductance") == 0.3
        assert actuator.drift("motor.resistance") == 0.35
    one_of_none = BldcActuator.load(edited(tmp_path, "drive.diode_drop", tolerance="200 %"))
    assert one_of_none.tolerance("drive.diode_drop") == 2.0
    assert one_of_none.drift("drive.diode_drop") is None
    assert BldcActuator.load().tolerance("drive.diode_drop") is None


def test_only_what_can_be_searched_has_a_tolerance_or_drifts():
    actuator = BldcActuator.load()
    for place in FIXED:
        assert actuator.tolerance(place) is None
        assert actuator.drift(place) is None
        with pytest.raises(ParameterError, match=rf"{place} is chosen or counted"):
            actuator.with_tolerances({place: "5 %"})


@pytest.mark.parametrize(
    "given",
    [0, 0.0, -0.05, "0 %", "-5 %", "201 %", 2.01, 5, 10**400, "5 V", "5", "%", "", "much", True,
     "nan %", float("nan"), float("inf"), "5 % or so"],
)  # fmt: skip
def test_an_impossible_tolerance_is_refused(tmp_path, given):
    text = refusal(edited(tmp_path, "motor.resistance", tolerance=given))
    assert "The tolerance of motor.resistance must be above 0 % and at most 200 %" in text
    assert f"received {given!r}; correct it." in text
    with pytest.raises(ParameterError, match=r"motor\.resistance must be above 0 %"):
        BldcActuator.load().with_tolerances({"motor.resistance": given})


def test_tolerances_survive_whatever_is_made_of_an_actuator(tmp_path):
    known = BldcActuator.load().with_tolerances({"motor.resistance": 1 / 3, "motor.inertia": 0.05})
    known.save(tmp_path / "saved.toml")
    (tmp_path / "template.toml").write_text(known.template(), encoding="utf-8")
    made = (
        known.changed({"motor.resistance": 2.3}),
        known.model_copy(update={"name": "other"}),
        known.with_arrays({"motor.resistance": 2.3}),
        pickle.loads(pickle.dumps(known)),
        BldcActuator.from_dict(known.as_table()),
        BldcActuator.load(tmp_path / "saved.toml"),
        BldcActuator.load(tmp_path / "template.toml"),
    )
    for one in made:
        assert one.tolerance("motor.resistance") == 1 / 3
        assert one.tolerance("motor.inertia") == 0.05
        assert one.tolerance("motor.inductance") == 0.3
    leaves = known.as_table()["motor"]
    assert leaves["inertia"]["tolerance"] == "5 %"
    assert "tolerance" not in leaves["inductance"]


def test_a_tolerance_is_no_part_of_the_fingerprint():
    actuator = BldcActuator.load()
    assert actuator.with_tolerances({"motor.inertia": 0.01}).fingerprint == actuator.fingerprint


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"tolerance": 0.0}, "tolerance of the quantity 'mass' must be above 0 %"),
        ({"drift": 3.0}, "drift of the quantity 'mass' must be above 0 %"),
        ({"tolerance": 0.1, "exact": True}, "'mass' is exact, received tolerance=0.1"),
        ({"drift": 0.1, "exact": True}, "'mass' is exact, received tolerance=None"),
    ],
)
def test_a_kind_that_states_an_impossible_tolerance_is_refused(stated, said):
    with pytest.raises(ParameterError, match=said):
        quantity("kg", "mass", **stated)


# All that is wrong, at once


def file_with(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    """The shipped file with texts replaced, each of them once."""
    text = SHIPPED
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "bad.toml"
    path.write_text(text, encoding="utf-8")
    return path


WRONG = {
    "wrong unit": (
        "resistance = { value = 2.13, unit = \"ohm\"", "resistance = { value = 2.13, unit = \"H\"",
        "motor.resistance must have a unit of the kind ohm; received 2.13 'H'. Correct the unit.",
    ),
    "no source": (
        'pole_pairs = { value = 2, unit = "", source = "assumed" }',
        'pole_pairs = { value = 2, unit = "" }',
        "motor.pole_pairs must be { value = ..., unit = ..., source = ... }, received "
        "{'value': 2, 'unit': ''}; complete it.",
    ),
    "empty source": (
        'source = "assumed: small low-inertia rotor"', 'source = " "',
        "motor.inertia must name the source of its value, received ' '; say where it comes from.",
    ),
    "bad tolerance": (
        'supply_voltage = { value = 48, unit = "V",',
        'supply_voltage = { value = 48, unit = "V", tolerance = "5 V",',
        "The tolerance of drive.supply_voltage must be above 0 % and at most 200 %, such as "
        "\"5 %\" or 0.05, received '5 V'; correct it.",
    ),
    "no number": (
        "diode_drop = { value = 0.8", 'diode_drop = { value = "0.8"',
        "drive.diode_drop must be a number, received '0.8'; correct it.",
    ),
    "impossible value": (
        "current_limit = { value = 22.5", "current_limit = { value = -22.5",
        "drive.current_limit must be greater than 0, received -22.5; correct it.",
    ),
    "missing parameter": (
        'position_gain = { value = 150, unit = "1/s", source = "design choice: 24 Hz position '
        'loop" }\n', "", "controller.position_gain is missing; add it.",
    ),
    "bare value": (
        'travel_low = { value = -30, unit = "deg", source = "design choice" }',
        "travel_low = -30",
        "transmission.travel_low must be { value = ..., unit = ..., source = ... }, received -30; "
        "complete it.",
    ),
}  # fmt: skip


def test_all_problems_are_listed_in_the_order_of_the_file(tmp_path):
    path = file_with(
        tmp_path, *((old, new) for old, new, _ in reversed(WRONG.values())),
        ("[steps]", "[steps]\ncolour = 1"), ("ratio = {", "rattio = {"),
    )  # fmt: skip
    unknown = (
        f"transmission.rattio is not a name that {path} knows; correct its spelling to "
        "transmission.ratio.",
        f"steps.colour is not a name that {path} knows; remove it or correct its spelling.",
    )
    listed = [*unknown, *(said for _, _, said in WRONG.values())]
    said = " ".join(f"({n}) {text}" for n, text in enumerate(listed, start=1))
    assert refusal(path) == f"{path} needs 10 corrections: {said}"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("resistance = {", "resistence = {", ("motor.resistence", "motor.resistance")),
        ("[controller]", "[controler]", ("controler", "controller")),
        ('name = "servo48"', 'nmae = "servo48"', ("nmae", "name")),
        (
            'resistance = { value = 2.13, unit = "ohm", source',
            'resistance = { value = 2.13, unit = "ohm", sorce',
            ("motor.resistance.sorce", "motor.resistance.source"),
        ),
    ],
)
def test_a_misspelt_name_is_told_with_the_closest_and_what_it_holds_is_still_checked(
    tmp_path, old, new, said
):
    path = file_with(tmp_path, (old, new))
    wrong, right = said
    sentence = f"{wrong} is not a name that {path} knows; correct its spelling to {right}."
    assert refusal(path) == f"{path}: {sentence}"
    path = file_with(tmp_path, (old, new), ("value = 150", 'value = "150"'))
    assert refusal(path) == (
        f"{path} needs 2 corrections: (1) {sentence} (2) controller.position_gain must be a "
        "number, received '150'; correct it."
    )


def test_a_long_list_is_cut(tmp_path):
    text = re.sub(r"(?<=unit = )\"[^\"]+\"", '"candela"', SHIPPED)
    path = tmp_path / "bad.toml"
    path.write_text(text, encoding="utf-8")
    count = len(re.findall("candela", text))
    said = refusal(path)
    assert f"needs {count} corrections: (1) motor.resistance must have" in said
    assert "(12) " in said
    assert "(13) " not in said
    assert said.endswith(f" And {count - 12} more.")


# Templates


@pytest.mark.parametrize("as_written", [True, False])
def test_a_template_reads_back_as_the_same_actuator(tmp_path, as_written):
    actuator = BldcActuator.load().model_copy(
        update={"description": 'with "quotes", \\ and\na line # that is none'}
    )
    path = tmp_path / "mine.toml"
    path.write_text(
        actuator.template(tomllib.loads(SHIPPED) if as_written else None), encoding="utf-8"
    )
    assert BldcActuator.load(path) == actuator
    unit = tomllib.loads(path.read_text(encoding="utf-8"))["motor"]["inductance"]["unit"]
    assert unit == ("mH" if as_written else "H")


def test_a_template_says_what_each_parameter_means_and_how_far_it_may_be_off():
    lines = BldcActuator.load().with_tolerances({"motor.inertia": "5 %"}).template().splitlines()
    entries = [n for n, line in enumerate(lines) if " = { value" in line]
    rows = list(BldcActuator.load().parameters())
    assert len(entries) == len(rows)
    for n, (place, _, _, meaning, _) in zip(entries, rows, strict=True):
        assert lines[n].startswith(place.split(".")[1])
        assert lines[n - 1].startswith(f"# {meaning}")
    comments = {lines[n].split()[0]: lines[n - 1] for n in entries}
    assert comments["resistance"].endswith("; tolerance 10 %; drift 35 %")
    assert comments["inertia"].endswith("; tolerance 5 %")
    assert comments["pole_pairs"] == "# pole pairs"


def test_a_value_that_was_changed_is_not_written_as_it_stood_before():
    changed = BldcActuator.load().changed({"motor.inductance": 1e-3})
    written = tomllib.loads(changed.template(tomllib.loads(SHIPPED)))["motor"]
    assert (written["inductance"]["value"], written["inductance"]["unit"]) == (1e-3, "H")
    assert written["inertia"]["unit"] == "g*cm^2"


def test_an_output_inertia_that_was_not_reflected_is_refused():
    shipped = BldcActuator.load()
    with pytest.raises(ParameterError, match=r"1e\+05 times that of the rotor.*square of the rat"):
        shipped.changed({"transmission.output_inertia": 0.25})
    direct = {"transmission.output_inertia": 0.0026, "transmission.ratio": 1}
    assert shipped.changed(direct).transmission.output_inertia == 0.0026
