"""The numbers of a scenario that may be designed, as a box and back."""

import numpy as np
import pytest

from ematwin.errors import InputError, ParameterError
from ematwin.experiments.space import DesignSpace
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Chirp, Profile, Scenario, Sine, Step

LIMITS = {"travel": 0.004, "speed": 0.5, "load": 8.0}


def space_of(actuator: str, **limits: float) -> DesignSpace:
    model = model_of(load_actuator(actuator))
    return DesignSpace(model, model.load_scenario(), limits)


@pytest.mark.parametrize("actuator", ["servo48", "rm1605", "emps", "servo400"])
def test_each_kind_says_what_may_be_designed(actuator: str) -> None:
    model = model_of(load_actuator(actuator))
    space = space_of(actuator)
    assert len(space.numbers) >= 2
    time = np.linspace(0.0, model.load_scenario().duration, 400)
    given = model.load_scenario().histories(time)
    for own, same in zip(given, space.scenario(space.start).histories(time), strict=True):
        assert np.array_equal(own, same)


def test_every_point_keeps_travel_and_load() -> None:
    space = space_of("servo48", **LIMITS)
    rng = np.random.default_rng(3)
    moved = 0
    for point in rng.random((40, len(space.numbers))):
        made = space.scenario(point)
        command, load = made.histories(np.linspace(0.0, made.duration, 1001))
        assert np.abs(command).max() <= LIMITS["travel"] * (1.0 + 1e-9)
        assert np.abs(load).max() <= LIMITS["load"] * (1.0 + 1e-9)
        moved += np.abs(command).max() > 0.0
    assert moved == 40


def test_without_a_load_none_is_designed() -> None:
    model = model_of(load_actuator("servo48"))
    space = DesignSpace(model, model.load_scenario("sine"), {"travel": 0.01, "load": 0.0})
    assert {one.history for one in space.numbers} == {"command"}


def test_a_recorded_command_alone_leaves_nothing_to_design() -> None:
    model = model_of(load_actuator("rm1605"))
    time = np.linspace(0.0, 1.0, 100)
    recorded = Scenario.from_columns(time, 0.1 * time)
    with pytest.raises(InputError, match="its parts are recorded"):
        DesignSpace(model, recorded, {"travel": 0.1})


def test_a_longer_scenario_is_the_same_in_proportion() -> None:
    given = Scenario(
        duration=1.0,
        command=[Step(value=1.0, time=0.5), Sine(amplitude=0.1, frequency=3.0, start=0.2)],
        load=[Profile(time=[0.0, 1.0], value=[0.0, 2.0])],
    )
    longer = given.lasting(2.0)
    assert longer.duration == 2.0
    assert longer.command[0].time == 1.0
    assert (longer.command[1].frequency, longer.command[1].start) == (3.0, 0.4)
    assert longer.load[0].time == [0.0, 2.0]


def test_a_profile_from_a_file_keeps_its_times(tmp_path) -> None:
    given = Scenario(duration=1.0, command=[Profile(file=tmp_path / "a.csv", column="command")])
    with pytest.raises(ParameterError, match="times of the file"):
        given.lasting(2.0)


def test_a_saved_scenario_loads_as_it_was(tmp_path) -> None:
    given = Scenario(
        name="mine",
        duration=0.3,
        command=[Chirp(amplitude=0.001, f_start=2.0, f_end=9.0), Step(value=-0.002, time=0.1)],
        load=[Step(value=3.0)],
    )
    given.save(tmp_path / "mine.toml")
    assert Scenario.load_file(tmp_path / "mine.toml") == given
    with pytest.raises(InputError, match=r"\.toml"):
        given.save(tmp_path / "mine.yaml")


def test_a_command_that_is_no_position_is_bounded_by_its_own_name() -> None:
    class Driven(type(model_of("linear-axis"))):  # type: ignore[misc]
        command, demands, designable = "voltage", (), {}

    (limit,) = Driven().limited
    assert (limit.name, limit.unit) == ("voltage", "V")
    scenario = Scenario(duration=1.0, command=[Chirp(amplitude=5.0, f_start=1.0, f_end=9.0)])
    space = DesignSpace(Driven(), scenario, {"voltage": 2.0})
    command, _ = space.scenario(np.ones(len(space.numbers))).histories(np.linspace(0.0, 1.0, 501))
    assert 1.0 < np.abs(command).max() <= 2.0 + 1e-9
