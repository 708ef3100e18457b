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


OBSTACLES = ["The motor hardly turns. Move it.", "current_a is saturated."]
FRICTION = "A fault is 60 % probable: " + SAID["friction"] + ", 60 % probable."
GIVEN = {
    "nothing": ({}, "healthy", (), "Healthy: no fault larger than 2 % of its range."),
    "one is certain": (
        {"probable": {"friction": 0.96}}, "fault", ("friction",),
        f"Fault: {SAID['friction']}. No other fault larger than 2 % of its range.",
    ),
    "by a data sheet": (
        {"probable": {"friction": 0.96}, "calibrated": False}, "fault", ("friction",), "Fault: ",
    ),
    "two are certain": (
        {"probable": {"friction": 0.99, "gain": 0.98}}, "fault", ("friction", "gain"),
        f"Two faults: {SAID['friction']} and {BESIDE['gain']}.",
    ),
    "one of two": (
        {"probable": {"friction": 0.6, "short_a": 0.4}, "faulty": 0.99}, "changed", (),
        f"Changed: {SAID['friction']}, 60 % probable or short_a, so much, 40 % probable; the rec",
    ),
    "another is probable": (
        {"probable": {"friction": 0.99, "short_a": 0.7}}, "fault", ("friction",),
        f"Fault: {SAID['friction']}. Perhaps also {SAID['short_a']}, 70 % probable. {WARM}",
    ),
    "as likely as not": (
        {"probable": {"friction": 0.6}}, "none", (),
        f"No verdict: {FRICTION} Use a command that moves the actuator more",
    ),
    "as likely as not, by a data sheet": (
        {"probable": {"friction": 0.6}, "calibrated": False}, "none", (),
        f"No verdict: {FRICTION} Calibrate with healthy",
    ),
    "some are improbable one by one": (
        {"probable": {"friction": 0.3, "gain": 0.3}, "faulty": 0.51}, "none", (), "No verdict: ",
    ),
    "a large one would not show": (
        {"probable": {"friction": 0.2}, "large": {"friction": 0.06, "gain": 0.04}}, "none", (),
        "A fault of friction would hardly show in this recording.",
    ),
    "a small one is not excluded": (
        {"probable": {"friction": 0.3}, "large": {"friction": 0.04}}, "healthy", (),
        "A fault is 30 % probable: friction, so much, 30 % probable.",
    ),
    "an obstacle": ({"obstacles": OBSTACLES}, "none", (), f"No verdict: {' '.join(OBSTACLES)}"),
    "an obstacle to a fault": (
        {"probable": {"friction": 0.99}, "obstacles": OBSTACLES}, "none", (),
        f"No verdict: {' '.join(OBSTACLES)}",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("given", "grade", "faults", "said"), GIVEN.values(), ids=GIVEN)
def test_a_verdict_follows_from_probabilities_and_what_forbids_one(given, grade, faults, said):
    found = verdict(**given)
    assert (found.grade, found.faults) == (grade, faults)
    assert said in found.sentence
    assert found.reason in found.sentence


@pytest.mark.parametrize(("probable", "none"), [({}, "no fault"), ({"gain": 1}, "No other fault")])
def test_no_bound_is_stated_that_an_interval_exceeds(probable, none) -> None:
    found = verdict(probable, reach={"short_a": 0.06, "friction": 0.04})
    assert f"{none} found; the least certain is short_a, so much" in found.sentence
    assert "2 %" not in found.sentence


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
