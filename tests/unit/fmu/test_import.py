"""FMUs of others as actuators: answers, reuse, failures that cost one sentence, bad files."""

import runpy
import shutil
import sys
import zipfile

import fmpy
import numpy as np
import psutil
import pytest

import ematwin
from ematwin.errors import EmatwinError
from ematwin.models.registry import load_actuator, model_of
from ematwin.numerics.side_by_side import cores
from reference_fmus import EXAMPLE, FILE, van_der_pol

WRONG = {  # C that runs with every evaluation, and what is said of it
    "if (M(mu) > 4.0) *(volatile int *)0 = 0;": "crashed",
    "if (M(mu) > 4.0) for (volatile int n = 0;; n++);": "did not answer within 2 s",
    "if (M(mu) > 4.0) exit(3);": "ended its process",
}


@pytest.fixture(scope="session")
def file(tmp_path_factory):
    """The TOML file of an oscillator, beside its FMU."""
    return van_der_pol(tmp_path_factory.mktemp("oscillator") / "files")


@pytest.fixture(scope="session")
def axis(tmp_path_factory, archive):
    """An exported linear axis, and a file that has it as an FMU: units and bounds are stated."""
    folder = tmp_path_factory.mktemp("axis")

    def made(fmi):
        shutil.copy(archive("emps", "twin", fmi), folder / f"axis-{fmi}.fmu")
        path = folder / f"axis-{fmi}.toml"
        path.write_text(AXIS.format(fmi=fmi), encoding="utf-8")
        return path

    return made


AXIS = """\
kind = "fmu"
name = "axis"
description = "the linear axis as an FMU"

[fmu]
file = "axis-{fmi}.fmu"

[inputs]
command = {{ variable = "reference" }}

[outputs]
voltage = {{ variable = "voltage" }}
position = {{ variable = "position", unit = "m", noise = "0.02 mm" }}

[nominal]
mass = {{ variable = "carriage.mass", value = 95154, unit = "g", source = "EMPS", upper = 2e5 }}

[faults]
friction = {{ variable = "friction", lower = 0.5, upper = 3 }}
"""


def oscillation(mu, samples, interval):
    """Euler's method with the step of 0.01 s, as the Reference FMU is described; (2, S)."""
    x, rows = np.array([2.0, 0.0]), []
    for n in range(samples * round(interval / 0.01)):
        if n % round(interval / 0.01) == 0:
            rows.append(x)
        x = x + 0.01 * np.array([x[1], mu * (1.0 - x[0] ** 2) * x[1] - x[0]])
    return np.array(rows).T


def test_it_answers_as_its_equation_does(file):
    found = ematwin.simulate(actuator=file, faults={"wear": 1.4})
    expected = oscillation(1.4, len(found), found.interval)
    np.testing.assert_allclose([found.channels["x0"], found.channels["x1"]], expected, atol=1e-9)


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_exported_actuator_answers_as_itself(axis, fmi):
    """Units of the file are converted; FMI 2 draws the same lines between samples."""
    scenario = model_of(load_actuator("emps")).load_scenario(None)
    expected = ematwin.simulate(
        scenario=scenario, actuator="emps", faults={"friction": 1.7}, noise=ematwin.Noise()
    )
    found = ematwin.simulate(
        scenario=scenario, actuator=axis(fmi), faults={"friction": 1.7}, sample_rate=1000.0
    )
    for name in ("voltage", "position"):
        one, other = (record.channels[name][:2000] for record in (found, expected))
        # FMI 3 holds inputs over a step
        close = 1e-9 if fmi == 2 else 1e-3 * np.abs(other).max()
        np.testing.assert_allclose(one, other, atol=close)


def test_a_recording_may_begin_anywhere(file, tmp_path):
    """What ``start`` names takes the first recorded values."""
    shutil.copy(file.parent / "VanDerPol.fmu", tmp_path)
    path = tmp_path / file.name
    text = FILE.replace('"x0", noise', '"x0", start = "x0", noise')
    path.write_text(text.replace('"x1", noise', '"x1", start = "x1", noise'), encoding="utf-8")
    record = ematwin.simulate(actuator=file, faults={"wear": 1.2})
    late = record.between(4.0, 12.0)
    for actuator, least, most in ((path, 0.0, 1e-12), (file, 0.1, np.inf)):
        comparison = model_of(load_actuator(actuator)).compare(late, load_actuator(actuator))
        cost = comparison.costs({"wear": np.array([1.2])}, 1)[0]
        assert least <= cost / comparison.scale <= most


def test_instances_are_reused_on_all_cores(file):
    actuator = load_actuator(file)
    record = ematwin.simulate(actuator=actuator)
    comparison = model_of(actuator).compare(record, actuator)
    values = {"wear": np.linspace(0.5, 2.0, 40)}
    costs = comparison.costs(values, 40)
    ours = {child.pid for child in psutil.Process().children() if "worker.py" in _line(child)}
    np.testing.assert_array_equal(comparison.costs(values, 40), costs)
    again = {child.pid for child in psutil.Process().children() if "worker.py" in _line(child)}
    assert ours == again
    assert len(ours) >= min(2, cores())


def _line(process):
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""


@pytest.mark.parametrize("slip", WRONG)
def test_a_broken_fmu_costs_one_sentence(tmp_path, slip):
    path = van_der_pol(tmp_path / "broken", slip)
    path.write_text(FILE.replace('"10 s"', '"2 s"'), encoding="utf-8")
    healthy = ematwin.simulate(actuator=path)
    with pytest.raises(EmatwinError) as caught:
        ematwin.simulate(actuator=load_actuator(path).changed({"nominal.damping": 5.0}))
    said = str(caught.value)
    assert WRONG[slip] in said
    assert "VanDerPol.fmu" in said
    assert "mu = 5" in said
    assert "\n" not in said
    again = ematwin.simulate(actuator=path)
    np.testing.assert_array_equal(again.channels["x0"], healthy.channels["x0"])


def test_an_fmu_that_fails_says_why(tmp_path):
    """A status of error is a candidate that diverged; the FMU's own words are in the sentence."""
    path = van_der_pol(tmp_path / "failing", "if (M(mu) > 4.0) { M(x0) = 0.0 / 0.0; }")
    actuator = load_actuator(path)
    with pytest.raises(EmatwinError, match="diverged"):
        ematwin.simulate(actuator=actuator.changed({"nominal.damping": 5.0}))
    comparison = model_of(actuator).compare(ematwin.simulate(actuator=actuator), actuator)
    costs = comparison.costs({"nominal.damping": np.array([1.0, 5.0, 1.0])}, 3)
    assert costs[0] == costs[2] == 0.0
    assert costs[1] == np.inf


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"VanDerPol.fmu"', '"missing.fmu"', "Cannot read the FMU .*missing.fmu"),
        ('"VanDerPol.fmu"', '"van-der-pol.toml"', "is no FMU that can be read"),
        ('"x0", noise', '"der(x)", noise', r"a variable 'der\(x\)', .* Did you mean der\(x"),
        ('"x0", noise', '"mu", noise', "must be a real output or local of the FMU, and mu is"),
        ('"time" }', '"x0" }', "must be a real input or independent"),
        ('times = "damping"', 'times = "drag"', "must multiply one of the parameters damping"),
        ('times = "damping"', 'variable = "mu"', "faults.wear and nominal.damping are one"),
        ('times = "damping", ', "", "needs variable"),
        ("value = 1.0", "value = 7.0", "less than or equal to 6, received 7"),
        ('unit = ""', 'unit = "Q"', "has no unit that is known, received 'Q'"),
        ("[faults]\nwear", "[fault]\nwear", "faults is missing"),
        ("upper = 6", "uper = 6", "uper is not a name"),
        ("[faults]\nwear", "[faults]\nload", "time, command and load"),
        ('"10 s"', '"-1 s"', "time_limit must be greater than 0"),
    ],
)
def test_a_bad_file_is_refused_with_a_sentence(file, tmp_path, old, new, sentence):
    assert old in FILE
    shutil.copy(file.parent / "VanDerPol.fmu", tmp_path)
    path = tmp_path / "van-der-pol.toml"
    path.write_text(FILE.replace(old, new), encoding="utf-8")
    with pytest.raises(EmatwinError, match=sentence) as caught:
        load_actuator(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('unit = "m"', 'unit = "V"', r"outputs.position must have .* such as 'm'.* received 'V'"),
        ('unit = "g"', 'unit = "s"', "nominal.mass must have a unit such as 'kg'"),
        ("95154", "-5", "nominal.mass must be greater than or equal to"),
        ("upper = 3", "upper = 300", "upper bound of faults.friction is 300 .* FMU allows"),
    ],
)
def test_units_and_ranges_of_the_fmu_hold(axis, tmp_path, old, new, sentence):
    given = axis(2)
    shutil.copy(given.with_suffix(".fmu"), tmp_path)
    path = tmp_path / given.name
    text = given.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(EmatwinError, match=sentence):
        load_actuator(path)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({f"binaries/{fmpy.platform}/VanDerPol.so": "binaries/plan9/VanDerPol.so"},
         rf"runs on plan9, and this is {fmpy.platform}"),
        ({f"binaries/{fmpy.platform}/VanDerPol.so": "sources/VanDerPol.so"},
         "runs on no platform"),
        ({"modelDescription.xml": "description.xml"}, "is no FMU that can be read"),
    ],
)  # fmt: skip
def test_an_archive_that_cannot_run_here_is_refused(file, tmp_path, changed, sentence):
    with (
        zipfile.ZipFile(file.parent / "VanDerPol.fmu") as old,
        zipfile.ZipFile(tmp_path / "VanDerPol.fmu", "w") as new,
    ):
        for name in old.namelist():
            new.writestr(changed.get(name, name), old.read(name))
    path = shutil.copy(file, tmp_path)
    with pytest.raises(EmatwinError, match=sentence):
        load_actuator(path)


def test_without_fmpy_the_command_is_named(file, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(ImportError, match=r'pip install "ematwin\[fmi\]"'):
        load_actuator(file)


def test_a_saved_file_knows_its_fmu(file, tmp_path):
    """A calibration elsewhere finds the FMU, and refuses another one in its place."""
    actuator = load_actuator(file)
    for name, text in (("saved.toml", None), ("template.toml", actuator.template())):
        path = tmp_path / name
        actuator.save(path) if text is None else path.write_text(text, encoding="utf-8")
        assert load_actuator(path).fingerprint == actuator.fingerprint
    copy = tmp_path / "VanDerPol.fmu"
    shutil.copy(file.parent / "VanDerPol.fmu", copy)
    with zipfile.ZipFile(copy, "a") as archive:
        archive.writestr("documentation/new.txt", "new")
    path = tmp_path / "saved.toml"
    path.write_text(
        path.read_text(encoding="utf-8").replace(str(file.parent / "VanDerPol.fmu"), str(copy)),
        encoding="utf-8",
    )
    with pytest.raises(EmatwinError, match=r"is not the FMU for which .* was written"):
        load_actuator(path)


def test_a_saved_file_is_in_si(axis, tmp_path):
    actuator = load_actuator(axis(2))
    actuator.save(tmp_path / "saved.toml")
    again = load_actuator(tmp_path / "saved.toml")
    assert again.fingerprint == actuator.fingerprint
    assert again.value("nominal.mass") == pytest.approx(95.154)
    assert again.limits("nominal.mass")[1] == pytest.approx(200.0)
    with pytest.raises(EmatwinError, match=r"nominal.mass must be less than or equal to 200"):
        again.changed({"nominal.mass": 300.0})


def test_a_recording_in_a_file_needs_no_column_for_time(file, tmp_path):
    """The command of an FMU that moves by itself is its time."""
    record = ematwin.simulate(actuator=file, noise=ematwin.Noise(white=0.01))
    path = tmp_path / "record.csv"
    rows = np.column_stack([record.time, record.channels["x0"], record.channels["x1"]])
    np.savetxt(path, rows, delimiter=",", header="time,x0,x1", comments="")
    found = ematwin.read(path, actuator=file)
    np.testing.assert_allclose(found.channels["command"], record.time, atol=1e-9)


def test_a_reference_fmu_is_recovered_within_its_intervals(file):
    """Another damping than the file says, two noisy recordings, and a fault in a third."""
    recover = runpy.run_path(str(EXAMPLE / "recover.py"))
    assert recover["recovered"](file, 0) == (True, True, True)
