"""The example package, found by its entry point: every command works for another kind."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import ematwin as library
from own_model import installed, laid_out, on_path
from refusals import refused

SENSOR = "white=0.02,bits=12,full_scale=5"


@pytest.fixture(scope="module", autouse=True)
def site(tmp_path_factory) -> Iterator[None]:
    """The package, as an installer leaves it, where Python looks for packages."""
    with on_path(laid_out(tmp_path_factory.mktemp("site-packages"))):
        yield


@pytest.fixture
def healthy(tmp_path: Path) -> list[str]:
    """Healthy recordings of five days, no two of them quite alike."""
    random = np.random.default_rng(1)
    sensor = library.Noise(white=0.02, bits=12, full_scale=5)
    spread = {"brushes": 0.015, "magnets": 0.005, "friction": 0.02, "backlash": 0.02}
    names = [f"healthy{n}.parquet" for n in range(1, 6)]
    for n, file in enumerate(names, 1):
        day = {name: random.normal(1.0, sigma) for name, sigma in spread.items()}
        day["load"] = random.normal(0.0, 0.01)
        recording = library.simulate(actuator="dcg25", faults=day, noise=sensor, seed=n)
        library.write(recording, tmp_path / file)
    return names


@pytest.fixture
def recorded(done) -> Callable:
    """Simulate into a file, with the sensor and a day's small differences."""

    def write(path: str, seed: int, **faults: float) -> None:
        given = [f"--fault={name}={value}" for name, value in faults.items()]
        options = ("--actuator", "dcg25", "--noise", SENSOR, "--seed", seed, "--out", path)
        done("simulate", *options, *given)

    return write


def test_actuators_and_scenarios_list_what_the_package_ships(done):
    assert "dcg25" in done("actuators").out
    told = done("actuators", "dcg25", "--json").told["parameters"]
    assert told["motor.resistance"]["value"] == 2.32
    assert told["motor.resistance"]["unit"] == "ohm"
    assert told["motor.resistance"]["source"]
    assert told["gear.backlash"]["value"] == pytest.approx(0.01745, abs=1e-5)


def test_a_recording_is_simulated_and_its_fault_identified(done, recorded, tmp_path):
    recorded("worn.parquet", 1, friction=1.6, backlash=2.0)
    told = done("identify", "worn.parquet", "--actuator", "dcg25", "--json", "--exact").told
    assert told["kind"] == "dc-gearmotor"
    assert told["faults"]["friction"] == pytest.approx(1.6, rel=0.02)
    assert told["faults"]["backlash"] == pytest.approx(2.0, rel=0.02)
    assert told["faults"]["brushes"] == pytest.approx(1.0, rel=0.02)
    assert set(told["present"]) == {"friction", "backlash"}
    assert told["physical"]["backlash"]["unit"] == "deg"
    page = done("identify", "worn.parquet", "--actuator", "dcg25", "--report", "worn.html").out
    assert "wrote worn.html" in page
    assert (tmp_path / "worn.html").stat().st_size > 10_000


def test_a_parameter_is_searched_by_its_place(ematwin, done, recorded):
    recorded("healthy.parquet", 1)
    asked = ("identify", "healthy.parquet", "--actuator", "dcg25", "--only")
    told = done(*asked, "motor.inertia,motor.torque_constant", "--json").told
    assert told["faults"]["motor.inertia"] == pytest.approx(1.08e-6, rel=0.05)
    assert "chosen, not measured" in ematwin(*asked, "steps.twin").err


def test_calibrate_learns_the_actuator_and_detect_judges_it(done, recorded, healthy, tmp_path):
    told = done("calibrate", *healthy, "--actuator", "dcg25", "--out", "arm.toml", "--json").told
    assert told["actuator"] == "arm"
    assert (tmp_path / "arm.toml").is_file()
    recorded("good.parquet", 20, friction=1.008)
    recorded("dry.parquet", 21, friction=1.5)
    recorded("loose.parquet", 22, backlash=3.0)
    later = ("good.parquet", "dry.parquet", "loose.parquet")
    options = ("--actuator", "arm.toml", "--report", "later.html", "--json")
    judged = done("detect", *later, *options).told["verdicts"]
    good, dry, loose = judged
    assert [one["grade"] for one in judged] == ["healthy", "fault", "fault"]
    assert not good["alarm"]
    assert dry["alarm"] is loose["alarm"] is True
    assert [dry["fault"], loose["fault"]] == ["friction", "backlash"]
    friction = [one["magnitudes"]["friction"]["value"] for one in (dry, good)]  # N m
    assert friction[0] / friction[1] == pytest.approx(1.5 / 1.008, rel=0.05)
    assert (tmp_path / "later.html").stat().st_size > 10_000
    found = done("identify", "dry.parquet", "--actuator", "arm.toml", "--json").told
    assert found["verdict"]["grade"] == "fault"
    assert found["present"] == dry["faults"] == ["friction"]


def test_what_is_missing_is_one_sentence(ematwin, done, recorded, tmp_path):
    recorded("one.parquet", 1)
    assert "Faults of dcg25" in done("identify", "one.parquet").out  # of the only kind that fits
    (tmp_path / "one.csv").write_text("time,speed\n0,1\n0.1,2\n")
    rows = "".join(f"{n},0,{n % 3},0,{n % 5}\n" for n in range(50))  # a row each ms
    (tmp_path / "ms.csv").write_text(f"time,command,voltage,current,position\n{rows}")
    for name, wanted in (("one.csv", ""), ("ms.csv", "it looks like ms. State it")):
        refused(ematwin("identify", name, "--actuator", "dcg25"), wanted)


def test_a_load_that_the_kind_does_not_take_is_refused(ematwin, tmp_path):
    (tmp_path / "loaded.toml").write_text(
        'duration = "1 s"\ncommand = [{ type = "ramp", rate = 1 }]\n'
        'load = [{ type = "step", value = 1 }]\n',
        encoding="utf-8",
    )
    answer = ematwin("simulate", "--actuator", "dcg25", "--scenario", "loaded.toml")
    refused(answer, "leave the load out")


def test_a_broken_kind_beside_it_is_refused_alone(ematwin, done, tmp_path):
    installed(tmp_path, "broken", models="crank = no_such_module:MODEL")
    (tmp_path / "crank.toml").write_text('kind = "crank"\nname = "c"\ndescription = "d"\n')
    with on_path(tmp_path):
        assert "dcg25" in done("simulate", "--actuator", "dcg25").out
        assert "Warning: The kind of actuator 'crank' cannot be" in done("actuators").out
        answer = ematwin("simulate", "--actuator", "crank.toml")
    refused(answer, "'crank' cannot be loaded from no_such_module:MODEL")
