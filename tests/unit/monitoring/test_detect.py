"""Verdicts on motions of the made-up rig, from the recordings to the name of the fault."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import ematwin
from ematwin.errors import ParameterError, RecordError
from ematwin.estimation.verdict import UNNAMED
from ematwin.monitoring.calibrate import signatures
from ematwin.monitoring.detection import gathered_notes
from ematwin.monitoring.identify import detect
from ematwin.recordings.recording import Recording
from made_up_rig import NOISE, healthy_runs, motion, run

OLD = Path(__file__).parents[2] / "data" / "0.1"
FAULTS = {
    "lubrication": {"friction": 1.3},
    "backlash": {"backlash": 8e-4},
    "spalling": {"roughness": 0.1},
}


# Files of earlier versions


def test_a_calibration_of_0_1_is_refused_in_a_sentence():
    with pytest.raises(ParameterError, match=r"a version before 0\.2.*; calibrate anew"):
        ematwin.Calibration.load(OLD / "calibrated.toml")


def test_a_calibration_of_0_2_repeats_what_follows_from_its_runs(tmp_path, calibration):
    """Its thresholds, population and statistics stood beside the healthy runs."""
    calibration.save(tmp_path / "now.toml")
    table = tomllib.loads((tmp_path / "now.toml").read_text(encoding="utf-8"))
    del table["baseline"]["checksum"]
    learnt = table["calibration"]
    learnt |= {
        "format": 3,
        "threshold": {"false_alarm_rate": 0.1},
        "population": {"scale": learnt.pop("scale")},
    }
    (tmp_path / "before.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    before = ematwin.Calibration.load(tmp_path / "before.toml")
    np.testing.assert_allclose(
        before.population.spread, calibration.population.spread, rtol=1e-5, atol=1e-9
    )


# Health


def test_healthy_runs_of_other_days_seldom_raise_an_alarm(calibration):
    found = detect(healthy_runs(30, first=101, motions=1), calibration)
    assert len(found.runs) == len(found.motions) == 60
    assert np.mean([verdict.alarm for verdict in found.runs]) < 0.05
    assert np.mean([verdict.grade == "healthy" for verdict in found.runs]) > 0.8


def test_intervals_hold_the_healthy_value_and_bands_hold_healthy_runs(calibration):
    found = detect(healthy_runs(15, first=201), calibration)
    held, inside = [], []
    for verdict in found.runs:
        for m in verdict.magnitudes:
            assert m.low <= m.value <= m.high
            assert m.healthy[0] < m.healthy[1]
            inside.append(m.healthy[0] <= m.value <= m.healthy[1])
            if m.name in {"friction", "gain"}:
                held.append(m.low <= 1.0 <= m.high)
    assert np.mean(held) > 0.75
    assert np.mean(inside) > 0.75


def test_the_load_of_a_motion_is_estimated(calibration):
    found = detect([motion(load=load) for load in (-150.0, 0.0, 250.0)], calibration)
    loads = [verdict.standing.covariate.value for verdict in found.motions]
    assert {str(v.standing.covariate).split()[1] for v in found.motions} == {"N"}
    np.testing.assert_allclose(np.diff(loads), [150.0, 250.0], atol=50.0)


# Faults


@pytest.mark.parametrize(("name", "fault"), FAULTS.items(), ids=FAULTS)
def test_a_fault_raises_an_alarm_and_is_named_by_physics(calibration, name, fault):
    found = detect([one for n in (60, 61, 62) for one in run(n, **fault)], calibration)
    named = [verdict.fault == name for verdict in found.runs]
    # the made-up roughness also swings below the bands that name it
    assert np.mean(named) >= (0.8 if name == "spalling" else 1.0)
    assert all(verdict.alarm for verdict in found.motions)
    for verdict in found.runs:
        scores = {m.name: m.score for m in verdict.magnitudes}
        raised = {"lubrication": "friction", "spalling": "roughness"}.get(name, name)
        assert max(scores, key=lambda key: scores[key]) == raised


def test_a_change_that_wear_does_not_make_is_unnamed(calibration):
    for verdict in detect(run(60, gain=0.8), calibration).runs:
        assert verdict.alarm
        assert verdict.fault == UNNAMED
        assert "most in gain" in verdict.reason


def test_signatures_name_by_statistics(calibration):
    """A fault that physics has no name for, and one that it would name otherwise."""
    known = {
        "loose encoder: gain 0.8": [*run(70, gain=0.8), *run(71, gain=0.8)],
        "wrong grease: friction 1.3": [*run(72, friction=1.3), *run(73, friction=1.3)],
    }
    learnt = signatures(calibration, known)
    assert [s.fault for s in learnt] == ["loose encoder", "wrong grease"]
    assert learnt[0].source == "8 motions: gain 0.8, runs 70, 71"
    taught = replace(calibration, signatures=learnt)
    motions = [*run(60, gain=0.8), *run(61, friction=1.3), *run(62, backlash=8e-4)]
    assert [v.fault for v in detect(motions, taught).runs] == [
        *["loose encoder"] * 2, *["wrong grease"] * 2, *["backlash"] * 2,
    ]  # fmt: skip


# Grades


def drifting(number: int) -> list[Recording]:
    """A healthy run of another occasion: the current is 2 % higher, and 0.01 A up."""
    return [m.changed(current=1.02 * m.current + 0.01) for m in run(number)]


def test_drift_between_occasions_is_no_alarm(calibration):
    """Twelve runs of the made-up rig, on which no constant was tuned."""
    motions = [m for number in range(301, 313) for m in drifting(number)]
    plain = [m for number in range(301, 313) for m in run(number)]
    found = detect(motions, calibration).runs
    assert np.mean([v.alarm for v in found]) <= 0.1
    assert np.mean([v.alarm for v in detect(plain, calibration).runs]) <= 0.1


def test_a_name_that_the_magnitude_contradicts_says_why(calibration):
    """Roughness, taught as backlash: the name comes from likeness, not from a gap."""
    known = [*run(70, roughness=0.1), *run(71, roughness=0.1)]
    taught = replace(calibration, signatures=signatures(calibration, {"backlash": known}))
    found = detect([*run(60, roughness=0.1), *run(61, backlash=8e-4)], taught).runs
    for verdict in found[:2]:
        assert verdict.fault == "backlash"
        assert "by likeness to recordings with it" in str(verdict.verdict)
    for verdict in found[2:]:
        assert verdict.fault == "backlash"
        assert "likeness" not in str(verdict.verdict)


def test_what_lies_far_outside_of_what_was_learnt_has_no_verdict(calibration):
    inside, outside = detect([motion(load=200.0), motion(load=900.0)], calibration).motions
    assert (inside.grade, outside.grade) == ("healthy", "none")
    assert inside.notes == ()
    assert any("extrapolated" in note for note in outside.notes)
    assert not outside.alarm
    assert outside.faults == ()
    assert "load (about" in outside.reason
    assert "far outside the range" in outside.reason
    other = motion(friction=3.0, gain=0.5, backlash=4e-3, roughness=0.5, noise=(0.5, 2e-3))
    (strange,) = detect([other], calibration).motions
    assert (strange.grade, strange.faults, strange.fault) == ("none", (), UNNAMED)
    assert strange.alarm  # a wreck looks like that as well
    assert "another rig or a wrong unit" in strange.reason


# Independence


def as_dicts(verdicts) -> dict[str, object]:
    return {verdict.name: verdict.as_dict() for verdict in verdicts}


def test_verdicts_depend_neither_on_order_nor_on_the_other_motions(calibration):
    motions = [*run(60, friction=1.3), *healthy_runs(2, first=101), *run(61, backlash=8e-4)]
    whole = detect(motions, calibration)
    backwards = detect(motions[::-1], calibration)
    few = detect(motions[:4], calibration)
    for part in ("motions", "runs"):
        expected = as_dicts(getattr(whole, part))
        assert len(expected) == len(getattr(whole, part))
        for other in (as_dicts(getattr(backwards, part)), as_dicts(getattr(few, part))):
            for name, verdict in other.items():
                assert _flat(verdict) == pytest.approx(_flat(expected[name]), rel=1e-9, abs=1e-9)
                assert verdict["fault"] == expected[name]["fault"]


def _flat(table) -> list[float]:
    if isinstance(table, dict):
        return [x for entry in table.values() for x in _flat(entry)]
    if isinstance(table, list | tuple):
        return [x for entry in table for x in _flat(entry)]
    return [float(table)] if isinstance(table, int | float) else []


# Notes


def rewired(share: float, **fault: float) -> list[Recording]:
    """Motions whose current holds a share (A/m) of all the noise of the position sensor."""
    motions = []
    for seed in range(3):
        one = motion(seed, load=100.0, **fault)
        silent = motion(seed, load=100.0, noise=(NOISE[0], 0.0), **fault)
        noise = one.position_error - silent.position_error
        motions.append(one.changed(current=one.current + share * noise, source=f"{fault}"))
    return motions


def test_rewired_sensors_are_noted_and_no_verdict_rests_on_them(calibration):
    faults, coupling = [{}, *FAULTS.values()], "sensor_coupling"
    plain = detect([m for fault in faults for m in rewired(0.0, **fault)], calibration).runs
    for share in (-200.0, 200.0):
        motions = [m for fault in faults for m in rewired(share, **fault)]
        found = detect(motions, calibration).runs
        for before, after in zip(plain, found, strict=True):
            assert (after.alarm, after.fault) == (before.alarm, before.fault)
            # of slow noise a share stays: it cannot be told from what the actuator does
            assert after.standing.distance == pytest.approx(before.standing.distance, abs=0.6)
            assert (
                after.standing.statistics[coupling] - before.standing.statistics[coupling]
            ) == pytest.approx(share, rel=0.2)
            # a rough screw swings fast enough to be taken for a coupling of its own
            if after.fault != "spalling":
                assert any("share fast noise differently" in note for note in after.notes)
    assert plain[0].notes == ()


def test_alike_notes_are_said_once(calibration):
    found = detect([motion(n, load=900.0) for n in range(3)], calibration)
    (note,) = gathered_notes(found.motions)
    assert note.endswith("3 of 3 are like this.")


# Sensors


def test_a_channel_that_stands_still_is_named_in_place_of_a_fault(calibration):
    one = motion(901)
    held = one.channels["position_error"].copy()
    held[len(held) // 2 :] = held[len(held) // 2]
    (verdict,) = detect([one.changed(position_error=held)], calibration).runs
    assert verdict.grade == "none"
    assert verdict.faults == ()
    assert verdict.reason.startswith("position_error stands still at")


def test_healthy_recordings_with_a_channel_that_stands_still_are_not_learnt():
    runs = healthy_runs(3)
    held = runs[0].channels["current"].copy()
    held[len(held) // 2 :] = held[len(held) // 2]
    with pytest.raises(RecordError, match="nothing to learn from: current stands still at"):
        ematwin.calibrate([runs[0].changed(current=held), *runs[1:]])
