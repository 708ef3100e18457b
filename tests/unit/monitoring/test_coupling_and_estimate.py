"""What is measured on one motion: shared noise of the sensors, values, residuals."""

from functools import cache

import numpy as np
import pytest

from ematwin.errors import InputError, RecordError
from ematwin.models.ball_screw.model import MODEL
from ematwin.models.phases import calm
from ematwin.monitoring.identify import detect
from ematwin.monitoring.measure import Bench, Motion
from made_up_rig import NOISE, command, motion, rig, simulate_motion
from refusals import refusal_of

SET_POINT, INTERVAL = command()
CALM = calm(SET_POINT, INTERVAL, 1.4)


def coupled(share: float, seed: int = 0):
    """A motion whose current holds a share (A/m) of the noise of its position sensor."""
    random = np.random.default_rng(seed)
    noise = random.normal(0.0, 2e-4, SET_POINT.size)
    clean = motion(noise=(0.0, 0.0))
    own = random.normal(0.0, 0.005, SET_POINT.size)
    return clean.changed(
        position_error=clean.position_error + noise, current=clean.current + own + share * noise
    )


def compared(one):
    return MODEL.compare(one, rig(), settling_time=1.4)


def share_of(one) -> float:
    return compared(one).statistics["sensor_coupling"]


def freed(one) -> np.ndarray:
    """The current as it is compared with that of the twin."""
    return compared(one).measured()["current"]


# Coupling


@pytest.mark.parametrize("share", [-300.0, -50.0, 0.0, 50.0, 300.0])
def test_the_share_that_sensors_have_in_common_is_recovered(share):
    found = [share_of(coupled(share, seed)) for seed in range(20)]
    assert np.mean(found) == pytest.approx(share, abs=3.0)
    assert np.std(found) < 8.0


def test_wear_is_no_coupling():
    """What the actuator does slowly is not what sensors share at once."""
    for changed in ({}, {"friction": 1.5}, {"backlash": 1e-3}, {"load": 300.0}):
        assert abs(share_of(motion(noise=(1e-6, 1e-6), **changed))) < 60.0, changed


def test_the_decoupled_current_does_not_depend_on_the_sign_of_the_share():
    alone = coupled(0.0)
    for share in (-300.0, 300.0):
        one = coupled(share)
        before = np.diff(one.current - alone.current, 2)
        after = np.diff(freed(one) - freed(alone), 2)
        assert np.std(after[CALM[2:]]) < 0.1 * np.std(before[CALM[2:]])


def test_a_position_does_for_a_position_error():
    one = motion(3, friction=1.2)
    other = one.changed(position=one.set_point - one.position_error, position_error=None)
    candidates = {"friction": np.array([1.0, 1.3])}
    first, second = (MODEL.compare(x, rig()).residuals(candidates, 2) for x in (one, other))
    np.testing.assert_allclose(second, first, atol=1e-9)
    assert MODEL.starts(rig(), other)[0] == pytest.approx(MODEL.starts(rig(), one)[0])
    assert MODEL.check(other, rig()) == []


# Values


def fitted(*motions):
    bench = Bench(rig(), Motion(SET_POINT, INTERVAL, 1.4), motions)
    return bench, bench.fit()


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
def test_the_values_of_a_motion_are_recovered_under_noise(changed):
    """Friction and gain to 2 %, backlash to 0.06 mm, load to 40 N (of 3 kN of friction)."""
    true = {"friction": 1.0, "backlash": rig().screw.backlash, "gain": 1.0, "load": 0.0}
    true |= changed
    bench, fit = fitted(*(motion(seed, **changed) for seed in range(4)))
    allowed = {"friction": 0.02, "backlash": 6e-5, "gain": 0.02, "load": 40.0}
    for estimate in bench.measured(fit).estimates:
        for name, most in allowed.items():
            assert abs(estimate[name] - true[name]) < most, name
            # the standard errors that come with them are neither lost nor wild
            assert 0.0 < estimate.standard_errors[name] < 3.0 * most, name


def test_what_the_twin_explains_leaves_noise_only():
    _, fit = fitted(motion(friction=1.3, load=200.0, backlash=5e-4))
    np.testing.assert_allclose(fit.residuals.std(axis=(0, 2)), NOISE, rtol=0.15)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"friction": 0.0}, r"Fault friction must lie in \[0.05, 6\], received 0"),
        ({"backlash": -1e-3}, r"Fault backlash must lie in \[0, 0.005\] m, received -0.001"),
        ({"gain": np.nan}, r"Fault gain must lie in \[0.3, 3\], received nan"),
        ({"roughness": -0.1}, "Symptom roughness"),
        ({"load": np.inf}, "Nuisance load must lie in"),
        ({"wear": 1.0}, "Unknown fault 'wear'"),
    ],
)
def test_an_impossible_motion_is_not_simulated(changed, said):
    with pytest.raises(InputError, match=said):
        simulate_motion(rig(), SET_POINT, INTERVAL, **changed)


# Motions that do not belong together


@cache
def good():
    return motion(load=100.0, labels={"run": "7"})


WRONG = {
    "another rate": (
        lambda x: x.changed(time=1.1 * x.time),
        "is sampled every 0.044 s where 0.04 s",
    ),
    "cut short": (lambda x: x.between(0.0, 240 * INTERVAL), "has 241 samples where 250 are needed"),
    "another command": (
        lambda x: x.changed(set_point=0.9 * SET_POINT),
        "off by up to 0.008 m of 0.08 m of travel",
    ),
    "inches": (lambda x: x.changed(set_point=SET_POINT / 0.0254), "correct its unit"),
    "negative current": (lambda x: x.changed(current=-x.current), "change its sign"),
    "dead current": (lambda x: x.changed(current=np.full(250, 3.0)), "current stands still at 3 A"),
    "no current": (lambda x: x.changed(current=None), "has no current"),
    "turned error": (lambda x: x.changed(position_error=-x.position_error), "has the wrong sign"),
    "error in mm": (
        lambda x: x.changed(position_error=1e3 * x.position_error),
        "more than the travel",
    ),
    "position for error": (
        lambda x: x.changed(position_error=SET_POINT + 0.01),
        "a position was taken for an error",
    ),
}


@pytest.mark.parametrize(("wrong", "said"), WRONG.values(), ids=WRONG)
def test_a_motion_of_another_kind_is_refused_by_its_name(report, wrong, said):
    text = refusal_of(lambda: detect([wrong(good())], report), RecordError)
    assert "simulated run 7" in text
    assert said in text


def test_a_command_that_never_moves_is_refused():
    still = good().changed(set_point=np.zeros(250))
    bench = Motion(still.set_point, INTERVAL, 1.4)
    assert "never moves" in refusal_of(lambda: bench.check(still, rig()), RecordError)


def test_faults_are_not_taken_for_wrong_units_or_signs(report):
    changes = (
        {"friction": 2.5}, {"backlash": 4e-3}, {"gain": 0.5}, {"load": 1500.0}, {"load": -1500.0},
        {"roughness": 0.5},
    )  # fmt: skip
    found = detect([motion(n, **changed) for n, changed in enumerate(changes)], report)
    assert len(found.motions) == len(changes)
