"""Each grade of a verdict, and the reason for it."""

import json
import math

import numpy as np
import pytest

from ematwin.estimation.constants import EXPLAINED, SMALLEST, TELLING
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.verdict import Verdict, judged, most_misfit

NAMES = ("friction", "short_a", "eccentricity", "eccentricity_phase", "gain")
HEALTHY = {"friction": 0.0, "short_a": 0.0, "eccentricity": 0.0, "eccentricity_phase": 0.5,
           "gain": 0.5}  # fmt: skip
SAID = {
    "friction": "friction +50 % (0.045 N m, 95 % interval 0.043 to 0.047)",
    "short_a": "3.2 shorted turns in phase a (95 % interval 2.9 to 3.5)",
    "eccentricity": "eccentricity 0.20 (95 % interval 0.18 to 0.22)",
    "gain": "gain -20 % (120 1/s, 95 % interval 118 to 122)",
}
BESIDE = {name: text.replace("95 % interval ", "") for name, text in SAID.items()}
WARM = "Turns missing from all phases alike cannot be told from warm magnets."


def verdict(
    values=None, errors=None, sharp=None, *, calibrated=True, intervals=None, obstacles=()
) -> Verdict:
    """Of an actuator that is healthy but for ``values``, with errors of 0.5 % of the range."""
    errors = dict.fromkeys(NAMES, 0.005) | (errors or {})
    estimate = Estimate(
        names=NAMES,
        values=np.array([(HEALTHY | (values or {}))[name] for name in NAMES]),
        covariance=np.diag([errors[name] ** 2 for name in NAMES]),
        units=dict.fromkeys(NAMES, ""),
        healthy=HEALTHY,
        ranges=dict.fromkeys(NAMES, 1.0),
        directions={"eccentricity_phase": "eccentricity"},
        misfit=0.004,
        actuator="made up",
        kind="made-up",
        fingerprint="0",
    )
    return judged(
        estimate,
        calibrated=calibrated,
        sharp_errors=errors | (sharp or {}),
        intervals={name: (HEALTHY[name] - 0.01, HEALTHY[name] + 0.01) for name in NAMES}
        | (intervals or {}),
        obstacles=obstacles,
        ambiguities={"short_a": WARM},
        found=SAID,
        ranges={name: f"{name}, so much" for name in SAID},
    )


def test_an_actuator_without_a_change_is_healthy() -> None:
    found = verdict()
    assert (found.grade, found.faults, found.reason) == ("healthy", (), "")
    assert found.sentence == "Healthy: no fault larger than 2 % of its range."
    assert str(found) == found.sentence


def test_a_fault_beyond_all_doubt_is_named() -> None:
    found = verdict({"friction": 0.25})
    assert (found.grade, found.faults, found.reason) == ("fault", ("friction",), "")
    assert found.sentence == (
        f"Fault: {SAID['friction']}. No other fault larger than 2 % of its range."
    )


@pytest.mark.parametrize(("values", "none"), [({}, "no fault"), ({"gain": 0.3}, "No other fault")])
def test_no_bound_is_stated_that_an_interval_exceeds(values, none) -> None:
    found = verdict(values, intervals={"short_a": (0.0, 0.06), "friction": (0.0, 0.04)})
    assert f"{none} found; the least certain is short_a, so much" in found.sentence
    assert "2 %" not in found.sentence


def test_several_faults_are_named_in_one_sentence() -> None:
    found = verdict({"friction": 0.25, "gain": 0.3})
    assert found.faults == ("friction", "gain")
    assert found.sentence.startswith(f"Two faults: {SAID['friction']} and {BESIDE['gain']}.")


def test_too_small_or_too_uncertain_is_no_fault() -> None:
    small = 0.9 * SMALLEST
    assert verdict({"friction": small}, {"friction": small / 10.0}).grade == "healthy"
    assert verdict({"friction": 0.04}, {"friction": 0.012}).grade == "healthy"
    assert verdict({"friction": 0.04}, {"friction": 0.005}).grade == "fault"


def test_a_direction_is_no_fault() -> None:
    assert verdict({"eccentricity_phase": 0.9}).grade == "healthy"
    unknown = {"eccentricity_phase": (0.0, 1.0)}
    assert verdict(intervals=unknown).grade == "healthy"


def test_what_drift_may_cause_is_a_change_without_a_name() -> None:
    found = verdict({"friction": 0.05, "short_a": 0.05}, {"friction": 0.03, "short_a": 0.03},
                    {"friction": 0.001, "short_a": 0.001})  # fmt: skip
    assert (found.grade, found.faults) == ("changed", ())
    assert found.sentence == f"Changed: {found.reason}"
    assert found.reason.startswith(f"{SAID['friction']} and {BESIDE['short_a']}, no more")
    assert found.reason.endswith(WARM)  # what else may be the cause, where there is something


def test_a_change_beside_a_fault_is_told_and_not_named() -> None:
    found = verdict({"friction": 0.25, "short_a": 0.05}, {"short_a": 0.03}, {"short_a": 0.001})
    assert (found.grade, found.faults) == ("fault", ("friction",))
    assert SAID["short_a"] in found.reason
    assert WARM in found.reason
    assert found.sentence == f"Fault: {SAID['friction']}. {found.reason}"


def test_an_obstacle_forbids_a_verdict_on_whatever_is_found() -> None:
    obstacles = ["The motor hardly turns. Move it.", "current_a is saturated."]
    for values in ({}, {"friction": 0.25}):
        found = verdict(values, obstacles=obstacles)
        assert (found.grade, found.faults) == ("none", ())
        assert found.reason == " ".join(obstacles)
        assert found.sentence == f"No verdict: {found.reason}"


def test_what_the_tolerances_of_a_data_sheet_explain_gives_no_verdict() -> None:
    arguments = ({"short_a": 0.05}, {"short_a": 0.03}, {"short_a": 0.001})
    found = verdict(*arguments, calibrated=False)
    assert (found.grade, found.faults) == ("none", ())
    assert found.sentence.startswith(f"No verdict: {SAID['short_a']} would explain the recording")
    assert "tolerances of the data sheet" in found.reason
    assert found.reason.endswith("Calibrate with healthy recordings of this actuator.")
    assert verdict(*arguments).grade == "changed"  # the same, calibrated


def test_a_fault_beyond_the_tolerances_is_named_without_a_calibration() -> None:
    assert verdict({"friction": 0.25}, calibrated=False).faults == ("friction",)


@pytest.mark.parametrize(
    ("calibrated", "advice"),
    [(True, "Use a command that moves the actuator more."), (False, "Calibrate with healthy")],
)
def test_nobody_is_healthy_who_may_have_an_unseen_fault(calibrated: bool, advice: str) -> None:
    wide = {"friction": (0.0, 1.1 * TELLING), "gain": (0.45, 0.5 + 1.2 * TELLING)}
    found = verdict(intervals=wide, calibrated=calibrated)
    assert (found.grade, found.faults) == ("none", ())
    assert found.sentence.startswith("No verdict: Nothing has changed beyond doubt, but friction")
    assert "friction and gain could be present unseen" in found.reason
    assert advice in found.reason
    narrow = {"friction": (0.0, 0.9 * TELLING), "gain": (0.5 - 0.9 * TELLING, 0.5)}
    assert verdict(intervals=narrow, calibrated=calibrated).grade == "healthy"


def test_a_verdict_travels_as_json() -> None:
    found = verdict({"friction": 0.25})
    assert json.loads(json.dumps(found.as_dict())) == {
        "grade": "fault", "faults": ["friction"], "reason": "", "sentence": found.sentence,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("healthy", "limit"),
    [
        (math.nan, 0.03),  # nobody knows what is usual
        (0.0, EXPLAINED),
        (0.004, EXPLAINED),  # a good fit, whatever healthy recordings left
        (0.02, 0.04),  # twice as much as they did
        (0.07, 0.1),  # no twin that misses a tenth is a ground for a verdict,
        (0.2, 0.24),  # unless it always misses more
    ],
)
def test_a_misfit_is_allowed_that_healthy_recordings_make_likely(healthy, limit) -> None:
    assert most_misfit(healthy) == pytest.approx(limit)


def test_the_allowed_misfit_never_falls_as_healthy_recordings_leave_more() -> None:
    limits = [most_misfit(x) for x in np.linspace(0.0, 0.5, 200)]
    assert (np.diff(limits) >= 0.0).all()
