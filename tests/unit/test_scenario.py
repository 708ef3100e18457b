"""Scenarios: each component against its closed form, units, recorded columns, refusals."""

import math

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ematwin.errors import InputError, ParameterError
from ematwin.models.bldc.model import MODEL
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Chirp, Profile, Ramp, Scenario, Sine, Step, shipped_scenarios
from refusals import refusal_of

T = np.linspace(0.0, 2.0, 2001)
number = st.floats(-1e3, 1e3, allow_subnormal=False)


def toml(tmp_path, body, name="s.toml"):
    path = tmp_path / name
    path.write_text(body, encoding="utf-8")
    return path


def refusal(path):
    return refusal_of(lambda: Scenario.load_file(path).histories(np.linspace(0.0, 0.1, 11)))


@given(value=number, start=st.floats(0, 2))
def test_a_step_is_zero_and_then_its_value(value, start):
    assert [float(v) for v in Step(value=value, time=start).at(T)] == [
        value if t >= start else 0.0 for t in T
    ]


@given(rate=number, start=st.floats(0, 1), length=st.floats(0, 3))
def test_a_ramp_rises_at_its_rate_and_is_held(rate, start, length):
    got = Ramp(rate=rate, start=start, stop=start + length).at(T)
    assert got == pytest.approx([rate * min(max(t - start, 0.0), length) for t in T], abs=1e-9)


@given(amplitude=number, frequency=st.floats(0.1, 50), phase=number, start=st.floats(0, 2))
def test_a_sine_is_its_formula_from_its_start_on(amplitude, frequency, phase, start):
    got = Sine(amplitude=amplitude, frequency=frequency, phase=phase, start=start).at(T)
    expected = [
        amplitude * math.sin(2 * math.pi * frequency * (t - start) + phase) if t >= start else 0.0
        for t in T
    ]
    assert got == pytest.approx(expected, abs=1e-6)


@given(amplitude=number, low=st.floats(0.1, 20), high=st.floats(0.1, 20), length=st.floats(0.2, 3))
def test_a_chirp_is_a_sine_whose_phase_is_the_integral_of_its_frequency(
    amplitude, low, high, length
):
    got = Chirp(amplitude=amplitude, f_start=low, f_end=high, start=0.1, duration=length).at(T)
    since = np.clip(T - 0.1, 0.0, length)
    turns = low * since + (high - low) / (2 * length) * since**2
    assert got == pytest.approx(amplitude * np.sin(2 * np.pi * turns), abs=1e-6)


def test_a_chirp_without_a_duration_ends_with_the_scenario_whatever_the_sampling():
    scenario = Scenario(duration=0.5, command=[Chirp(amplitude=1, f_start=5, f_end=25)])
    fine, _ = scenario.histories(np.arange(0.0, 0.5001, 1e-4))
    coarse, _ = scenario.histories(np.arange(0.0, 0.5, 7e-3))  # does not reach the end
    assert coarse == pytest.approx(fine[::70][: coarse.size], abs=1e-9)


def test_a_profile_runs_in_straight_lines_and_holds_its_ends():
    profile = Profile(time=[0.5, 1.0, 1.5], value=[1.0, 3.0, -1.0])
    at = profile.at(np.array([0.0, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0]))
    assert at.tolist() == [1.0, 1.0, 2.0, 3.0, 1.0, -1.0, -1.0]


def test_components_add_up():
    parts = [Step(value=0.1, time=0.3), Sine(amplitude=0.2, frequency=3)]
    command, load = Scenario(duration=2, command=parts, load=[Step(value=5)]).histories(T)
    assert np.array_equal(command, parts[0].at(T) + parts[1].at(T))
    assert (load == 5.0).all()


def test_shipped_scenarios_stay_within_the_travel_of_the_shipped_actuator():
    assert {"default", "ramp", "sine", "step"} <= set(shipped_scenarios())
    for name in shipped_scenarios():
        scenario = Scenario.load_file(name)
        assert scenario.name == name
        assert scenario.description
        MODEL.check_scenario(scenario, BldcActuator.load())


def test_values_in_a_file_may_carry_units(tmp_path):
    path = toml(
        tmp_path,
        """
        duration = "500 ms"
        [[command]]
        type = "ramp"
        rate = "36 deg/s"
        start = "100 ms"
        [[command]]
        type = "sine"
        amplitude = "60 arcmin"
        frequency = "0.004 kHz"
        phase = "90 deg"
        [[load]]
        type = "step"
        value = "0.02 kNm"
        time = "0.25 s"
        [[load]]
        type = "ramp"
        rate = "1 kN*m/minute"
        """,
    )
    scenario = Scenario.load_file(path)
    assert scenario.name == "s"
    assert scenario.duration == 0.5
    ramp, sine = scenario.command
    step, slope = scenario.load
    assert (ramp.rate, ramp.start) == pytest.approx((math.pi / 5, 0.1))
    assert (sine.amplitude, sine.frequency, sine.phase) == pytest.approx(
        (math.radians(1), 4.0, math.pi / 2)
    )
    assert (step.value, step.time, slope.rate) == pytest.approx((20.0, 0.25, 1000 / 60))


def _write(path, columns):
    if path.suffix == ".parquet":
        pq.write_table(pa.table(columns), path)
    else:
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
        path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_profile_comes_from_a_recorded_column_beside_the_scenario_file(tmp_path, suffix):
    _write(tmp_path / f"run{suffix}", {"time": [10.0, 10.5, 11.0], "position": [0.0, 0.01, 0.02]})
    path = toml(
        tmp_path,
        f'duration = 1\n[[command]]\ntype = "profile"\nfile = "run{suffix}"\ncolumn = "position"\n',
    )
    command, _ = Scenario.load_file(path).histories(np.array([0.0, 0.25, 1.0]))
    assert command == pytest.approx([0.0, 0.005, 0.02])  # times count from the first


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize(
    ("columns", "degree"),
    [
        ({"time": [5.0, 5.1, 5.3], "command": [0.0, 1.0, 0.0], "load": [0.0, 10.0, 20.0]}, 1.0),
        (
            {
                "time [ms]": [0.0, 100.0, 300.0], "command [deg]": [0.0, 1.0, 0.0],
                "load [kNm]": [0.0, 0.01, 0.02],
            },
            math.radians(1),
        ),
    ],
)  # fmt: skip
def test_recorded_columns_are_a_scenario_and_may_name_their_unit(tmp_path, suffix, columns, degree):
    scenario = Scenario.load_file(_write(tmp_path / f"flight{suffix}", columns))
    assert scenario.name == "flight"
    assert scenario.duration == pytest.approx(0.3)
    command, load = scenario.histories(np.array([0.0, 0.05, 0.1, 0.3]))
    assert command == pytest.approx([0.0, 0.5 * degree, degree, 0.0])
    assert load == pytest.approx([0.0, 5.0, 10.0, 20.0])


def test_a_record_of_ematwin_is_a_scenario_again(tmp_path):
    import ematwin

    record = ematwin.simulate("monitor", "default", sample_rate=5000)
    ematwin.write(record, tmp_path / "rec.parquet")
    scenario = Scenario.load_file(tmp_path / "rec.parquet")
    command, load = scenario.histories(record.time)
    assert np.allclose(command, record.command, rtol=0, atol=1e-12)
    assert np.allclose(load, record.load, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"time": [0.0, 0.2, 0.1], "command": [0.0, 0.0, 0.0]}, "point 2 (0.1 s) follows 0.2 s"),
        ({"time": [0.0, 0.1, 0.1], "command": [0.0, 0.0, 0.0]}, "time must increase"),
        ({"time": [0.0, 0.1], "command": [0.0, math.nan]}, "NaN"),
        ({"time": [0.0], "command": [0.0]}, "at least two"),
        ({"time": [0.0, 0.1], "kommand": [0.0, 0.0]}, "has no column 'command'; it has time"),
        ({"time": [0.0, 0.1], "command [V]": [0.0, 0.0]}, "unit of the kind rad; received 'V'"),
    ],
)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_recorded_columns_that_cannot_be_a_scenario_are_refused(tmp_path, columns, said, suffix):
    text = refusal(_write(tmp_path / f"bad{suffix}", columns))
    assert said in text
    assert "bad" in text


STEP = 'duration = 0.5\n[[command]]\ntype = "step"\nvalue = 0.01\n'
CHIRP = 'duration = 1\n[[command]]\ntype = "chirp"\namplitude = 0.1\nf_start = 1\nf_end = 2\n'
PROFILE = 'duration = 1\n[[command]]\ntype = "profile"\n'


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("", "missing"),
        ("duration = 1", "command is missing"),
        ("duration = 1\ncommand = []", "at least 1 item"),
        ("duration = 1\ncommand = 5", "received 5"),
        ("duration = 1\ncommand = [5]", "must be a table, received 5"),
        ("duration = = 1", "not valid TOML"),
        (STEP.replace("0.5", "0"), "greater than 0"),
        (STEP.replace("0.5", "nan"), "received nan"),
        (STEP.replace("0.5", "inf"), "received inf"),
        (STEP.replace("0.5", '"3 kg"'), "kind s; received 3 'kg'"),
        (STEP.replace('"step"', '"stp"'), "'stp'; choose one of 'step', 'ramp'"),
        (STEP.replace('type = "step"\n', ""), "has no type"),
        (STEP.replace("value", "valeu"), "valeu is not a name"),
        (STEP.replace("0.01", "nan"), "received nan"),
        (STEP.replace("0.01", '"1 Hz"'), "kind rad; received 1 'Hz'"),
        (STEP.replace("0.01", '"x"'), "received 'x'"),
        (STEP.replace("0.01", '"inf rad"'), "finite"),
        (STEP + 'time = "1 m"', "kind s; received 1 'm'"),
        (STEP + '[[load]]\ntype = "step"\nvalue = "1 rad"', "kind N*m; received 1 'rad'"),
        (CHIRP.replace("start = 1", "start = -1"), "received -1"),
        (CHIRP.replace("start = 1", 'start = "5 rad/s"'), "kind Hz; received 5 'rad/s'"),
        (CHIRP + "start = 3", "a chirp starts at 3 s, but the scenario ends at 1 s"),
        (PROFILE, "received neither"),
        (PROFILE + "time = [0, 1]\nvalue = [0]", "received 2 and 1"),
        (PROFILE + "time = [1, 0]\nvalue = [0, 1]", "point 1 (0 s) follows 1 s"),
        (PROFILE + 'time = [0, 1]\nfile = "x.csv"', "received file, time"),
    ],
)
def test_an_impossible_scenario_file_is_refused_in_one_sentence(tmp_path, body, said):
    assert said in refusal(toml(tmp_path, body))


def test_a_command_in_degrees_is_recognised():
    actuator = BldcActuator.load()
    with pytest.raises(ParameterError, match="looks like degrees"):
        MODEL.check_scenario(Scenario(duration=1, command=[Step(value=20.0)]), actuator)
    with pytest.raises(ParameterError, match="Shorten the command"):
        MODEL.check_scenario(Scenario(duration=1, command=[Step(value=0.6)]), actuator)
    MODEL.check_scenario(Scenario(duration=1, command=[Step(value=0.5)]), actuator)


def test_components_made_in_python_are_refused_in_one_sentence_too():
    with pytest.raises(ParameterError, match=r"step: value must be .*received 'x'; correct it\.$"):
        Step(value="x")
    with pytest.raises(ParameterError, match="time must increase"):
        Profile(time=[0, 0], value=[0, 1])
    with pytest.raises(ParameterError, match="at least two"):
        Scenario.from_columns(np.array([]), np.array([]))
    with pytest.raises(ParameterError, match="received 2 and 1"):
        Scenario.from_columns(np.array([0.0, 1.0]), np.array([0.0]))


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
