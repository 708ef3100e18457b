"""A population of healthy linear axes, and worn ones that stand out from it."""

import re

import numpy as np

import ematwin
from ematwin.models.linear_axis.parameters import LinearAxis

AXIS = LinearAxis.load("emps-symmetric")


def run(number: int, **fault: float) -> ematwin.Recording:
    """A run on a day of its own, with friction and noise of that day."""
    random = np.random.default_rng(number)
    day = {name: float(np.exp(random.normal(0.0, 0.01))) for name in ("friction", "viscous")}
    found = ematwin.simulate(actuator=AXIS, faults={**day, **fault})
    noisy = found.voltage + random.normal(0.0, 0.01, len(found))
    return found.changed(voltage=noisy, labels={"run": str(number)})


def test_worn_axes_are_named_and_a_sound_one_is_healthy():
    calibration = ematwin.calibrate([run(n) for n in range(4)], AXIS).calibration
    judged = [run(10), run(11, viscous_asymmetry=1.3), run(12, friction=1.3)]
    found = ematwin.detect(judged, calibration).runs
    assert [one.grade for one in found] == ["healthy", "fault", "fault"]
    assert [one.fault for one in found[1:]] == ["viscous_asymmetry", "friction"]


def test_asymmetry_of_all_friction_is_known_better_than_that_of_its_parts():
    found = ematwin.identify(run(20, viscous_asymmetry=1.4), AXIS)
    value, (low, high) = found.contrasts["asymmetry"]
    assert value == np.mean([found.values[f"{name}_asymmetry"] for name in ("dry", "viscous")])
    assert low < 1.2 < high
    for name in ("dry_asymmetry", "viscous_asymmetry"):
        ends = found.intervals[name]
        assert high - low < 0.9 * (ends[1] - ends[0])


def test_calibrating_on_a_worn_axis_says_what_to_do_instead():
    worn = [run(n, dry_asymmetry=1.3, viscous_asymmetry=1.3) for n in range(3)]
    said = " ".join(ematwin.calibrate(worn, AXIS).notes)
    assert re.search(r"put friction\.\w+_ratio at 1\.\d+, 1\.\d+ times the 1 of the template", said)
    assert "may be worn, do not learn from it: identify" in said


def test_a_mass_three_times_the_sheets_is_found_and_said_and_little_is_left():
    sheet = AXIS.changed({"carriage.mass": 3.0 * AXIS.carriage.mass})
    found = ematwin.calibrate([run(n) for n in range(2)], sheet)
    assert abs(found.actuator.carriage.mass / AXIS.carriage.mass - 1.0) < 0.02
    assert any("carriage.mass at" in note and "0.33 times" in note for note in found.notes)
    left = {trace.name: trace.y for trace in found.plot("residuals").data}  # over the time
    before, after = (left[f"measured - {twin}"] for twin in ("template", "calibrated"))
    assert np.nanmean(after) < 0.05 * np.nanmean(before)
    assert {"template", "calibrated"} <= {trace.name for trace in found.plot("fit").data}
