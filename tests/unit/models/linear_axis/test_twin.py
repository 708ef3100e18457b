"""The twin of a linear axis beside its naive version, and what its recordings tell of the start."""

import numpy as np
import pytest

import ematwin
from ematwin.errors import InputError, ParameterError, RecordError
from ematwin.estimation.problem import Problem
from ematwin.models.linear_axis.comparison import repeats
from ematwin.models.linear_axis.model import MODEL, controller_voltage
from ematwin.models.linear_axis.parameters import LinearAxis, loop_radius, velocity_gain_limit
from ematwin.models.linear_axis.twin import follow
from ematwin.models.scenario import Scenario, Sine, Step
from ematwin.recordings.recording import Recording
from naive import linear_axis as naive

AXIS = LinearAxis.load().changed({
    "friction.coulomb_ratio": 1.2, "friction.standstill_ratio": 0.6, "drive.offset": 3.0,
    "steps.twin": 2.5e-5,
})  # fmt: skip
SWINGS = [
    Step(value=0.0042),
    Sine(amplitude=0.004, frequency=3.0, phase=-np.pi / 2),
    Sine(amplitude=0.0002, frequency=11.0, phase=-np.pi / 2),
]
# for 0.4 s one way
THERE = Scenario(duration=0.4, command=[Sine(amplitude=0.01, frequency=1.0, phase=-np.pi / 2)])


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Half a second with several reversals, and a pulse that saturates the voltage."""
    scenario = Scenario(
        duration=0.5, command=SWINGS, load=[Step(value=8.0, time=0.3), Step(value=-8.0, time=0.32)]
    )
    return ematwin.simulate(scenario=scenario, actuator=AXIS)


@pytest.mark.parametrize("standstill", [0.6, 1.0, 1.8])
def test_closed_loop_equals_the_naive_one(recording, standstill):
    axis = AXIS.changed({"friction.standstill_ratio": standstill})
    start = Recording(recording.time, {n: recording.channels[n] for n in ("reference", "pulses")})
    voltage, position = follow(axis, start, {}, 1).values()
    slow_voltage, slow_position = naive.simulate(
        axis, recording.reference, recording.pulses, recording.reference[0], 0.0, 0.0, 5e-6
    )
    # the naive rule is of first order
    assert np.abs(voltage[0] - slow_voltage).max() < 0.01 * np.abs(voltage).max()
    assert np.abs(position[0] - slow_position).max() < 2e-3 * np.ptp(position)


def test_open_loop_equals_the_naive_one(recording):
    slow = naive.simulate(
        AXIS, recording.reference, recording.pulses, recording.position[0], 0.0,
        recording.voltage[0], 5e-6, recorded=recording.voltage,
    )[1]  # fmt: skip
    position = follow(AXIS, recording, {}, 1, closed=False)["position"][0]
    assert np.abs(position - slow).max() < 2e-3 * np.ptp(recording.position)


def test_pulses_come_on_top_of_the_controller_and_within_the_limit(recording):
    expected = controller_voltage(recording, AXIS)[2:]
    np.testing.assert_allclose(recording.voltage[2:], expected, atol=1e-9)
    assert np.abs(recording.voltage).max() == pytest.approx(10.0)
    alone = controller_voltage(recording.changed(pulses=None), AXIS)[2:]
    assert np.abs(recording.voltage[2:] - alone).max() > 2.0


def test_friction_of_one_direction_is_seen_in_that_direction_only():
    out = ematwin.simulate(scenario=THERE, actuator=AXIS)
    friction = AXIS.friction
    other = AXIS.changed({
        "friction.coulomb": 1.1 * friction.coulomb,
        "friction.coulomb_ratio": 1.1**2 * friction.coulomb_ratio,
    })  # fmt: skip
    # forward friction is as before: mean times 1.1, ratio times 1.1 squared
    again = ematwin.simulate(scenario=THERE, actuator=other)
    assert np.ptp(out.position) > 0.015
    forward = out.time < 0.35
    np.testing.assert_allclose(again.voltage[forward], out.voltage[forward], atol=1e-9)


# The controller


def test_an_unstable_controller_is_refused_with_the_limit():
    with pytest.raises(ParameterError, match=r"unstable.*limit is \d+.*V s/m") as caught:
        AXIS.changed({"controller.velocity_gain": 20_000.0})
    said = float(str(caught.value).split("limit is ")[1].split()[0])
    assert loop_radius(AXIS, 0.999 * said / AXIS.controller.velocity_gain) < 1.0
    assert loop_radius(AXIS, 1.001 * said / AXIS.controller.velocity_gain) > 1.0


def test_the_limit_is_where_small_motions_begin_to_grow():
    """Simulated without Coulomb friction, for which the limit holds."""
    unchecked = {"controller.velocity_gain": 20_000.0, "friction.viscous_ratio": 1.0}
    limit = velocity_gain_limit(AXIS.with_arrays(unchecked))
    smooth = {
        "friction.coulomb": 1e-9, "friction.coulomb_ratio": 1.0, "drive.offset": 0.0,
        "friction.viscous_ratio": 1.0, "drive.voltage_limit": 1e9,
    }  # fmt: skip
    last = []
    for factor in (0.97, 1.03):
        axis = AXIS.changed(smooth).with_arrays({"controller.velocity_gain": factor * limit})
        time = np.arange(3000) * 1e-3
        step = Recording(time, {"reference": np.where(time > 0.0, 1e-6, 0.0)})
        voltage = follow(axis, step, {}, 1)["voltage"]
        last.append(np.abs(voltage[0, -200:]).max() / np.abs(voltage[0, :200]).max())
    assert last[0] < 1e-3
    assert last[1] > 1.0


def test_a_slow_controller_is_refused_as_well():
    with pytest.raises(ParameterError, match="unstable with controller"):
        AXIS.changed({"controller.sample_time": 0.02})


def test_a_repeated_reference_counts_once():
    one = np.r_[np.linspace(0.0, 1.0, 500), np.linspace(1.0, 0.0, 500)]
    assert repeats(np.tile(one, 4)) == pytest.approx(4.0, rel=0.01)
    assert repeats(np.tile(one, 4)[:3900]) == pytest.approx(3.9, rel=0.01)
    assert repeats(np.cumsum(np.random.default_rng(1).normal(size=3000))) == 1.0
    assert repeats(np.zeros(100)) == 1.0


# What is counted as independent


def test_recordings_of_one_motion_count_once_together(recording):
    one = MODEL.compare(recording, AXIS)
    shorter = MODEL.compare(recording.between(0.0, 0.49), AXIS)
    other = MODEL.compare(recording.between(0.2, 0.5), AXIS)
    again = [one.beside([one, shorter, other]), shorter.beside([one, shorter, other])]
    assert [x.independent / y.independent for x, y in zip(again, (one, shorter), strict=True)] == (
        pytest.approx([0.5, 0.5])
    )
    assert other.beside([one, shorter, other]) is other
    assert again[0].beside([one, shorter, other]).independent == again[0].independent
    problem = Problem([one, one, one], [MODEL.unknown(AXIS, "friction")])
    assert sum(x.independent for x in problem.comparisons) == pytest.approx(one.independent)


# Recordings that cannot be


@pytest.mark.parametrize(
    ("name", "alter", "said"),
    [
        ("voltage", lambda v: -v, "opposite to what the controller gives"),
        ("voltage", lambda v: 0.0 * v, "the channel is dead"),
        ("voltage", lambda v: 1e3 * v, "is limited to 10 V"),
        ("position", lambda x: 1e6 * x, "its unit is probably mm"),
        ("position", lambda x: x + 1.0, "more than the travel"),
    ],
)
def test_a_recording_that_cannot_be_is_refused_with_the_likely_cause(recording, name, alter, said):
    with pytest.raises(RecordError, match=said) as caught:
        MODEL.check(recording.changed(**{name: alter(recording.channels[name])}), AXIS)
    assert "\n" not in str(caught.value)


def test_another_controller_is_doubtful(recording):
    assert MODEL.check(recording, AXIS) == []
    other = AXIS.changed({"controller.velocity_gain": 200.0})
    assert "from what the controller of" in MODEL.check(recording, other)[0]
    assert "its gains" in MODEL.check(recording.changed(pulses=None), AXIS)[0]


def test_a_recording_at_another_rate_is_refused(recording):
    half = Recording(recording.time[::2], {n: x[::2] for n, x in recording.channels.items()})
    with pytest.raises(
        RecordError, match=r"every 0\.002 s and the controller of emps every 0\.001"
    ):
        MODEL.check(half, AXIS)
    with pytest.raises(InputError, match="one sample for each update of the controller"):
        ematwin.simulate(actuator=AXIS, sample_rate=500.0)


def test_open_loop_names_the_channel_that_it_lacks(recording):
    with pytest.raises(RecordError, match="has no voltage, which an open-loop simulation needs"):
        follow(AXIS, recording.changed(voltage=None), {}, 1, closed=False)


def test_motion_one_way_gives_no_verdict():
    out = ematwin.simulate(scenario=THERE, actuator=AXIS)
    assert "never moves backward" in MODEL.excitation(out, AXIS)[0]
    found = ematwin.identify(out, AXIS, exact=True)
    assert found.verdict.grade == "none"
    assert "never moves backward" in found.verdict.reason
