"""What is measured on one motion: shared noise of the sensors, magnitudes, residuals."""

from dataclasses import replace

import numpy as np
import pytest

from ematwin.errors import InputError, RecordError
from ematwin.monitoring.coupling import coupling, decoupled_current
from ematwin.monitoring.features import Layout
from ematwin.monitoring.measure import REPORTED, Bench, check_alike, reported_values
from ematwin.monitoring.phases import phases
from ematwin.monitoring.simulate import simulate_motion
from ematwin.monitoring.twin import MAGNITUDES
from made_up_rig import NOISE, command, motion, rig

SET_POINT, INTERVAL = command()
LAYOUT = Layout.of(phases(SET_POINT, INTERVAL, 1.4))
CALM = np.zeros(SET_POINT.size, dtype=bool)
for phase in LAYOUT.phases:
    if phase.steady:
        CALM[phase.samples] = True


def coupled(share: float, seed: int = 0):
    """A motion whose current holds a share (A/m) of the noise of its position sensor."""
    random = np.random.default_rng(seed)
    noise = random.normal(0.0, 2e-4, SET_POINT.size)
    clean = motion(noise=(0.0, 0.0))
    own = random.normal(0.0, 0.005, SET_POINT.size)
    return replace(
        clean,
        position_error=clean.position_error + noise,
        current=clean.current + own + share * noise,
    )


# Coupling


@pytest.mark.parametrize("share", [-300.0, -50.0, 0.0, 50.0, 300.0])
def test_the_share_that_sensors_have_in_common_is_recovered(share):
    found = [coupling(coupled(share, seed), CALM) for seed in range(20)]
    assert np.mean(found) == pytest.approx(share, abs=3.0)
    assert np.std(found) < 8.0


def test_wear_is_no_coupling():
    """What the actuator does slowly is not what sensors share at once."""
    for changed in ({}, {"friction": 1.5}, {"backlash": 1e-3}, {"load": 300.0}):
        assert abs(coupling(motion(noise=(1e-6, 1e-6), **changed), CALM)) < 60.0, changed


def test_the_decoupled_current_does_not_depend_on_the_sign_of_the_share():
    alone = coupled(0.0)
    for share in (-300.0, 300.0):
        one = coupled(share)
        freed = decoupled_current(one, coupling(one, CALM))
        before = np.diff(one.current - alone.current, 2)
        after = np.diff(freed - decoupled_current(alone, coupling(alone, CALM)), 2)
        assert np.std(after[CALM[2:]]) < 0.1 * np.std(before[CALM[2:]])


def test_a_silent_position_sensor_shares_nothing():
    one = replace(motion(), position_error=np.zeros(SET_POINT.size))
    assert coupling(one, CALM) == 0.0
    np.testing.assert_array_equal(decoupled_current(one, 0.0), one.current)


# Magnitudes


def measured(*motions):
    return Bench(list(motions), SET_POINT, INTERVAL, LAYOUT).measure(rig())


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"friction": 1.3},
        {"friction": 0.8},
        {"load": 300.0},
        {"load": -300.0},
        {"backlash": 5e-4},
        {"backlash": 2e-3},
        {"gain": 1.1},
        {"gain": 0.8},
        {"friction": 1.3, "load": -300.0, "backlash": 5e-4, "gain": 1.1},
    ],
    ids=str,
)
def test_the_magnitudes_of_a_motion_are_recovered_under_noise(changed):
    """Friction and gain to 2 %, backlash to 0.06 mm, load to 40 N (of 3 kN of friction)."""
    true = {"friction": 1.0, "backlash": rig().screw.backlash, "gain": 1.0, "load": 0.0}
    true |= changed
    found = measured(*(motion(seed, **changed) for seed in range(4))).magnitudes
    allowed = {"friction": 0.02, "backlash": 6e-5, "gain": 0.02, "load": 40.0}
    for name, most in allowed.items():
        seen = found[:, MAGNITUDES.index(name)]
        assert np.abs(seen - true[name]).max() < most, (name, seen)


def test_without_noise_they_are_recovered_to_a_thousandth():
    true = {"friction": 1.3, "load": 250.0, "backlash": 5e-4, "gain": 1.1}
    (found,) = measured(motion(noise=(0.0, 0.0), **true)).magnitudes
    for name, value in true.items():
        assert found[MAGNITUDES.index(name)] == pytest.approx(value, rel=3e-3), name


def test_an_actuator_that_starts_off_its_place_is_no_fault():
    one = motion()
    late = replace(one, position_error=one.position_error + 0.0)
    late.position_error[0] += 5e-4
    found = measured(one, late).magnitudes
    np.testing.assert_allclose(found[1, :3], found[0, :3], rtol=0.05, atol=5e-5)


def test_what_the_twin_explains_leaves_noise_only():
    found = measured(motion(friction=1.3, load=200.0, backlash=5e-4))
    assert np.std(found.current) == pytest.approx(NOISE[0], rel=0.15)
    assert np.std(found.position_error) == pytest.approx(NOISE[1], rel=0.15)


def test_motions_are_measured_independently_of_each_other():
    motions = [motion(1), motion(2, friction=1.4), motion(3, load=-300.0)]
    together = measured(*motions)
    for n, one in enumerate(motions):
        alone = measured(one)
        np.testing.assert_array_equal(alone.magnitudes[0], together.magnitudes[n])
        np.testing.assert_array_equal(alone.current[0], together.current[n])


def test_reported_values_are_logarithms_of_ratios_and_metres():
    bench = Bench([motion(), motion(roughness=0.1)], SET_POINT, INTERVAL, LAYOUT)
    features = bench.features(bench.measure(rig()))
    values = dict(zip(REPORTED, reported_values(LAYOUT, features).T, strict=True))
    np.testing.assert_allclose(np.exp(values["friction"]), features[:, 0])
    np.testing.assert_array_equal(values["backlash"], features[:, 1])
    np.testing.assert_allclose(np.exp(values["gain"]), features[:, 2])
    assert values["roughness"][1] - values["roughness"][0] > np.log(1.4)


# Simulated motions


def test_a_simulated_motion_repeats_with_its_seed():
    for name in ("current", "position_error"):
        first, again, other = (getattr(motion(seed, roughness=0.1), name) for seed in (7, 7, 8))
        np.testing.assert_array_equal(first, again)
        assert np.std(first - other) > 0.0


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"friction": 0.0}, "friction must be at least 0.001, received 0"),
        ({"backlash": -1e-3}, "backlash must be at least 0, received -0.001"),
        ({"gain": np.nan}, "gain must be at least 0.001, received nan"),
        ({"roughness": -0.1}, "roughness"),
        ({"load": np.inf}, "load must be a finite number, received inf"),
    ],
)
def test_an_impossible_motion_is_not_simulated(changed, said):
    with pytest.raises(InputError, match=said):
        simulate_motion(rig(), SET_POINT, INTERVAL, **changed)


# Motions that do not belong together


def refusal(*motions, set_point=SET_POINT, interval=INTERVAL) -> str:
    with pytest.raises(RecordError) as caught:
        check_alike(list(motions), set_point, interval)
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith(".")
    return text


GOOD = motion(load=100.0, labels={"run": "7"})
WRONG = {
    "another rate": (replace(GOOD, time=1.1 * GOOD.time), "is sampled each 0.044 s where 0.04 s"),
    "cut short": (
        replace(
            GOOD, time=GOOD.time[:-9], set_point=GOOD.set_point[:-9], current=GOOD.current[:-9],
            position_error=GOOD.position_error[:-9],
        ),
        "has 241 samples where 250 are needed",
    ),
    "another command": (replace(GOOD, set_point=0.9 * SET_POINT), "off by up to 0.008 m of 0.08 m"),
    "inches": (replace(GOOD, set_point=SET_POINT / 0.0254), "correct its unit"),
    "negative current": (replace(GOOD, current=-GOOD.current), "change its sign"),
    "dead current": (replace(GOOD, current=np.full(250, 3.0)), "the channel is dead"),
    "turned error": (replace(GOOD, position_error=-GOOD.position_error), "has the wrong sign"),
    "error in mm": (
        replace(GOOD, position_error=1e3 * GOOD.position_error), "more than the travel"
    ),
    "position for error": (
        replace(GOOD, position_error=SET_POINT + 0.01), "a position was taken for an error"
    ),
}  # fmt: skip


@pytest.mark.parametrize(("wrong", "said"), WRONG.values(), ids=WRONG)
def test_a_motion_of_another_kind_is_refused_by_its_name(wrong, said):
    text = refusal(GOOD, wrong)
    assert "simulated run 7" in text
    assert said in text


def test_a_command_that_never_moves_is_refused():
    still = replace(GOOD, set_point=np.zeros(250))
    assert "never moves" in refusal(still, set_point=still.set_point)


def test_faults_are_not_taken_for_wrong_units_or_signs():
    motions = [
        motion(friction=2.5), motion(backlash=4e-3), motion(gain=0.5), motion(load=1500.0),
        motion(load=-1500.0), motion(roughness=0.5),
    ]  # fmt: skip
    check_alike(motions, SET_POINT, INTERVAL)
