"""Units that a user prefers: what is shown follows, what programs read stays SI; usual factors."""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pint
import pytest

import ematwin
from ematwin.errors import EmatwinError, ParameterError
from ematwin.exploring.explorer import Explorer
from ematwin.monitoring.detection import Magnitude
from ematwin.plots import plot_recording
from ematwin.quantities import _USUAL, preferred, to_si, use_units
from ematwin.report.identification import plot_answers
from refusals import refused


@pytest.fixture(autouse=True)
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A settings folder of the test's own; afterwards nothing is preferred."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    use_units(None)
    yield tmp_path / "ematwin" / "settings.toml"
    use_units("")


@pytest.mark.parametrize(
    ("units", "unit", "shown", "factor"),
    [
        ("angle=mrad, torque=mN m", "rad", "mrad", 1e3),
        ("angle=mrad, torque=mN m", "N*m", "mN m", 1e3),
        ("angle=mrad", "deg", "mrad", 1e3 * math.pi / 180.0),
        ({"angle": "deg"}, "rad", "deg", 180.0 / math.pi),
        ("angular speed=rpm", "rad/s", "rpm", 30.0 / math.pi),
        ("length=um", "mm", "um", 1e3),
        ("angle=mrad", "turns", "turns", 1.0),  # of a winding
        ("angle=mrad", "A", "A", 1.0),
        ("", "rad", "rad", 1.0),
    ],
)
def test_a_quantity_is_shown_in_its_unit(units, unit, shown, factor):
    use_units(units)
    assert preferred(unit) == (shown, pytest.approx(factor, rel=1e-12))


@pytest.mark.parametrize(
    ("units", "said"),
    [
        ("mrad", "must be quantity=unit"),
        ("angel=mrad", "must name quantities of angle, "),
        ("angle=mN m", "unit of the kind rad; received 1 'mN m'"),
        ("angular speed=Hz", "received 1 'Hz'"),
    ],
)
def test_units_that_cannot_be_shown_are_refused(units, said):
    with pytest.raises(EmatwinError, match=re.escape(said)):
        use_units(units)


def test_sentences_tables_and_figures_follow_and_programs_get_si(tmp_path):
    record = ematwin.simulate("monitor", faults={"friction": 0.25}, seed=1)
    use_units("torque=mN m, angle=mrad, current=mA")
    only = ["friction", "backlash"]
    found = ematwin.identify(record, exact=True, only=only, uncertainty="laplace")
    low, high = found.physical_values["friction"][1:]
    assert re.search(r"friction \+50.*? % \((?:45\.0|44\.9)\d* mN m, ", found.verdict.sentence)
    assert re.search(r"backlash +(?:5\.0|4\.9)\d* mrad", str(found))
    assert 0.04 < low < high < 0.05
    assert found.to_frame().loc["friction"]["value"] == pytest.approx(0.045, rel=1e-2)
    titles = {axis.title.text for axis in plot_recording(record).select_yaxes()}
    assert {"mrad", "mN m"} <= titles
    assert not {"rad", "N*m"} & titles
    (axis,) = plot_answers(found).select_yaxes()
    assert axis.title.text == "mA"
    found.report(tmp_path / "page.html")
    assert "mN m" in (tmp_path / "page.html").read_text()
    row = Magnitude("friction", "N*m", 0.045, 0.044, 0.046, (0.03, 0.031), 9.0)
    assert (str(row), row.healthy_text) == ("45.0 mN m (44.0 to 46.0)", "30 to 31")


def test_commands_that_simulate_follow(ematwin: Any, tmp_path: Path):
    said = ematwin("simulate", "--fault", "friction=0.25", "--model", "monitor", "--plot", "p.html",
                   "--units", "torque=mN m, current=mA").out  # fmt: skip
    assert re.search(r"friction +0.25 +45 mN m +30 mN m", said)
    assert re.search(r"\d{4} mA", said)
    page = (tmp_path / "p.html").read_text()
    assert "45 mN m" in page
    assert "0.045" not in page
    listed = ematwin("actuators", "servo48", "--units", "torque=mN m").out
    assert re.search(r"motor.friction_torque +15 mN m ", listed)


def test_sliders_and_traces_of_the_explorer_follow():
    explorer = Explorer(None, "servo48")
    si = explorer.setup()["channels"][0]
    use_units("torque=mN m, current=mA")
    shown = explorer.setup()["channels"][0]
    assert (si["unit"], shown["unit"]) == ("A", "mA")
    assert max(shown["healthy"]) == pytest.approx(1e3 * max(si["healthy"]), rel=1e-4)
    answer = explorer.answer({"friction": 0.25}, si["name"])
    assert answer["said"]["friction"] == "45 mN m"
    assert max(answer["twin"]) > 1e3
    profile = explorer.profile({}, "friction")
    assert (profile["unit"], profile["x"][0]) == ("mN m", pytest.approx(30.0))


def test_the_shell_keeps_units_and_an_option_goes_before_them(ematwin: Any, settings: Path):
    kept = ematwin("units", "torque=mN m")
    assert kept.code == 0, kept.err
    assert "torque          mN m" in kept.out
    assert ematwin("units", "--json").told["units"] == {"torque": "mN m"}
    assert preferred("N*m") == ("mN m", 1000.0)
    ematwin("units", "angle=mrad")  # adds to them
    assert settings.read_text() == '[units]\ntorque = "mN m"\nangle = "mrad"\n'
    ematwin("detect", "none.csv", "--units", "torque=uN m")
    assert preferred("N*m") == ("uN m", pytest.approx(1e6))
    ematwin("detect", "none.csv")
    assert preferred("N*m") == ("mN m", 1000.0)
    ematwin("units", "SI")
    assert "SI" in ematwin("units").out
    for text, said in (("[units]\nangle = 3", "received 1 '3'"), ("units", "Cannot read the")):
        settings.write_text(text)
        refused(ematwin("units"), said)


# The factors of usual units are those of pint

REGISTRY = pint.UnitRegistry(cache_folder=None)


@pytest.mark.parametrize(
    ("spelled", "proper"),
    [
        ("gcm²", "g*cm^2"), ("gcm2", "g*cm^2"), ("g cm²", "g*cm^2"), ("gcm^2", "g*cm^2"),
        ("kgcm²", "kg*cm^2"), ("kg cm2", "kg*cm^2"), ("kgm²", "kg*m^2"), ("kgmm²", "kg*mm^2"),
    ],
)  # fmt: skip
def test_inertias_may_be_spelled_as_on_data_sheets(spelled, proper) -> None:
    assert to_si(33.3, spelled, "kg*m^2", "it") == pytest.approx(
        float(REGISTRY.Quantity(33.3, proper).to("kg*m^2").magnitude), rel=1e-12
    )


def test_a_mass_in_another_power_of_length_is_refused() -> None:
    for unit in ("gcm", "gcm3", "gcm20", "kgs2"):
        with pytest.raises(ParameterError, match="must have a unit of the kind"):
            to_si(1.0, unit, "kg*m^2", "it")


@pytest.mark.parametrize(("unit", "si_unit"), _USUAL)
@pytest.mark.parametrize("value", [0.72, 25.0, 1.0 / 3.0, 8000.0])
def test_a_usual_unit_gives_to_the_last_bit_what_pint_gives(unit, si_unit, value) -> None:
    expected = float(REGISTRY.Quantity(value, unit).to(si_unit).magnitude)
    assert to_si(value, unit, si_unit, "it") == expected
