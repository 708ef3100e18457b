"""Each grade of a verdict, and the reason for it."""

import math

import pytest

from ematwin.estimation.constants import EXPLAINED
from ematwin.estimation.verdict import judged, most_misfit

NAMES = ("friction", "short_a", "eccentricity", "gain")
SAID = {
    "friction": "friction +50 % (0.045 N m, 95 % interval 0.043 to 0.047)",
    "short_a": "3.2 shorted turns in phase a (95 % interval 2.9 to 3.5)",
    "eccentricity": "eccentricity 0.20 (95 % interval 0.18 to 0.22)",
    "gain": "gain -20 % (120 1/s, 95 % interval 118 to 122)",
}
BESIDE = {name: text.replace("95 % interval ", "") for name, text in SAID.items()}
WARM = "Turns missing from all phases alike cannot be told from warm magnets."


def verdict(probable=None, *, faulty=None, large=None, calibrated=True, reach=None, obstacles=()):
    """Of an actuator whose faults are absent but for those that are ``probable``."""
    probability = dict.fromkeys(NAMES, 0.0) | (probable or {})
    return judged(
        probability,
        max(probability.values()) if faulty is None else faulty,
        large or {},
        calibrated=calibrated,
        reach=dict.fromkeys(NAMES, 0.01) | (reach or {}),
        found=SAID,
        ranges={name: f"{name}, so much" for name in SAID},
        obstacles=obstacles,
        ambiguities={"short_a": WARM},
    )


def test_an_actuator_without_a_change_is_healthy() -> None:
    found = verdict()
    assert (found.grade, found.faults, found.reason) == ("healthy", (), "")
    assert found.sentence == "Healthy: no fault larger than 2 % of its range."
    assert str(found) == found.sentence


def test_a_fault_that_is_certain_is_named() -> None:
    for calibrated in (True, False):
        found = verdict({"friction": 0.96}, calibrated=calibrated)
        assert (found.grade, found.faults, found.reason) == ("fault", ("friction",), "")
        assert found.sentence == (
            f"Fault: {SAID['friction']}. No other fault larger than 2 % of its range."
        )


@pytest.mark.parametrize(("probable", "none"), [({}, "no fault"), ({"gain": 1}, "No other fault")])
def test_no_bound_is_stated_that_an_interval_exceeds(probable, none) -> None:
    found = verdict(probable, reach={"short_a": 0.06, "friction": 0.04})
    assert f"{none} found; the least certain is short_a, so much" in found.sentence
    assert "2 %" not in found.sentence


def test_several_faults_are_named_in_one_sentence() -> None:
    found = verdict({"friction": 0.99, "gain": 0.98})
    assert found.faults == ("friction", "gain")
    assert found.sentence.startswith(f"Two faults: {SAID['friction']} and {BESIDE['gain']}.")


def test_a_fault_that_one_of_several_is_is_a_change_without_a_name() -> None:
    found = verdict({"friction": 0.6, "short_a": 0.4}, faulty=0.99)
    assert (found.grade, found.faults) == ("changed", ())
    assert found.sentence == f"Changed: {found.reason}"
    assert found.reason.startswith(
        f"{SAID['friction']}, 60 % probable or short_a, so much, 40 % probable; the recording"
    )
    assert found.reason.endswith(WARM)  # what else may be the cause, where there is something


def test_a_probable_fault_beside_a_certain_one_is_told_and_not_named() -> None:
    found = verdict({"friction": 0.99, "short_a": 0.7})
    assert (found.grade, found.faults) == ("fault", ("friction",))
    assert found.reason == f"Perhaps also {SAID['short_a']}, 70 % probable. {WARM}"
    assert found.sentence == f"Fault: {SAID['friction']}. {found.reason}"


@pytest.mark.parametrize(
    ("calibrated", "advice"),
    [(True, "Use a command that moves the actuator more"), (False, "Calibrate with healthy")],
)
def test_a_fault_that_is_as_likely_as_not_gives_no_verdict(calibrated, advice) -> None:
    found = verdict({"friction": 0.6}, calibrated=calibrated)
    assert (found.grade, found.faults) == ("none", ())
    assert found.sentence == f"No verdict: {found.reason}"
    assert found.reason.startswith(f"A fault is 60 % probable: {SAID['friction']}, 60 % probable.")
    assert advice in found.reason
    # several that are improbable one by one
    assert verdict({"friction": 0.3, "gain": 0.3}, faulty=0.51).grade == "none"


def test_nobody_is_healthy_who_may_have_a_large_fault_unseen() -> None:
    found = verdict({"friction": 0.2}, large={"friction": 0.06, "gain": 0.04})
    assert (found.grade, found.faults) == ("none", ())
    assert "A fault of friction would hardly show in this recording." in found.reason


def test_a_small_fault_that_is_less_likely_than_not_is_told_beside_health() -> None:
    found = verdict({"friction": 0.3}, large={"friction": 0.04})
    assert (found.grade, found.faults) == ("healthy", ())
    assert found.reason == "A fault is 30 % probable: friction, so much, 30 % probable."
    assert found.sentence.endswith(found.reason)
    assert verdict({"friction": 0.04}).reason == ""


def test_an_obstacle_forbids_a_verdict_on_whatever_is_found() -> None:
    obstacles = ["The motor hardly turns. Move it.", "current_a is saturated."]
    for probable in ({}, {"friction": 0.99}):
        found = verdict(probable, obstacles=obstacles)
        assert (found.grade, found.faults) == ("none", ())
        assert found.reason == " ".join(obstacles)
        assert found.sentence == f"No verdict: {found.reason}"


@pytest.mark.parametrize(
    ("healthy", "limit"),
    [
        (math.nan, 0.03),  # nobody knows what is usual
        (0.0, EXPLAINED),
        (0.004, EXPLAINED),  # a good fit, whatever healthy recordings left
        (0.02, 0.04),  # twice as much as they did
        (0.07, 0.1),  # no twin that misses a tenth is a ground for a verdict
        (0.2, 0.1),
    ],
)
def test_a_misfit_is_allowed_that_healthy_recordings_make_likely(healthy, limit) -> None:
    assert most_misfit(healthy) == pytest.approx(limit)


def test_scatter_of_the_reference_excuses_no_misfit_beyond_the_worst() -> None:
    assert most_misfit(0.004, True, scatter=0.003) == pytest.approx(0.01)
    assert most_misfit(0.067, True, scatter=6.0) == pytest.approx(0.1)
