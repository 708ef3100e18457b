"""The small size of benchmarks/unknown_actuator.py: right, or no verdict (docs/trust.md)."""

import sys
from pathlib import Path

import pytest

from ematwin.errors import RecordError
from shared import computed_once

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import unknown_actuator as bench
from counted import MAGNITUDES, holds, outside_by


def recorded(*given):
    """A recording of the benchmark, as far as it tells of each fault."""
    return bench.recorded(*given).between(0.0, 0.3)


@pytest.fixture(scope="module")
def known(tmp_path_factory) -> object:
    """What two healthy recordings say of an actuator that is off its data sheet."""
    true = bench.actuator_off(7)
    healthy = [recorded(true, {}, 10 + n, {}) for n in range(2)]
    return computed_once(tmp_path_factory, "off", lambda: bench.learnt(healthy, bench.SHEET))


@pytest.fixture(scope="module")
def known_by_voltages(tmp_path_factory) -> object:
    """What a healthy recording with phase voltages says of another such actuator."""
    healthy = recorded(bench.actuator_off(4), {}, 10, {}, bench.VOLTAGES)
    return computed_once(
        tmp_path_factory, "off-with-voltages", lambda: bench.learnt([healthy], bench.SHEET)
    )


@pytest.mark.parametrize("case", range(len(bench.CASES)))
def test_on_a_calibrated_actuator_faults_are_named_and_intervals_hold(known, case: int) -> None:
    true, faults = bench.actuator_off(7), bench.CASES[case]
    one = bench.judged("", recorded(true, faults, 100 + case, {}), known, true, faults)
    assert one.grade == ("fault" if faults else "healthy")
    assert set(one.faults) == bench.injected_names(one)
    assert one.error < 1.5
    assert not bench.is_silently_wrong(one)


def test_drift_of_all_kinds_at_once_makes_no_fault(known) -> None:
    true = bench.actuator_off(7)
    one = bench.judged("", recorded(true, {}, 100, bench.ALL_DRIFTS), known, true, {})
    assert one.grade in ("healthy", "changed")
    assert not bench.is_silently_wrong(one)


def test_magnets_stronger_than_they_were_are_not_taken_for_less_friction(known) -> None:
    """Turns are never added, so that no fault looks like a larger torque constant."""
    true, faults = bench.actuator_off(7), {"friction": 0.35, "gain": 0.7}
    stronger = true.changed({"motor.emf_constant": 1.05 * true.motor.emf_constant})
    one = bench.judged("", recorded(stronger, faults, 100, {}), known, stronger, faults)
    assert one.grade == "fault"
    assert set(one.faults) == set(faults)
    # two minima, equally deep: the interval of either leaves the other out
    assert outside_by(one.intervals["friction"], faults["friction"]) < 1.0


def test_without_calibration_a_healthy_actuator_is_not_called_faulty() -> None:
    true = bench.actuator_off(7)
    one = bench.judged("", recorded(true, {}, 100, {}), bench.SHEET, true, {})
    assert one.grade != "fault"
    assert all(holds(one.intervals[name], one.injected[name]) for name in MAGNITUDES)


def test_on_another_structure_it_is_right_or_gives_no_verdict(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # calibrating takes minutes: .ci/run does that for a drive with loops, by the demo
    monkeypatch.setattr(bench, "learnt", lambda recordings, sheet: sheet)
    for one in bench.of_structure(2, 1):
        assert not bench.is_silently_wrong(one)
        assert set(one.faults) <= bench.injected_names(one)


def test_what_cannot_be_told_from_gets_no_verdict(known) -> None:
    """A motion of 20 urad is that of 200 for all that is searched."""
    true = bench.actuator_off(7)
    recordings = bench.special_recordings(true)
    with pytest.raises(RecordError, match="command looks like degrees"):
        bench.judged("", recordings.pop("degrees for radians"), known, true, bench.SPECIAL)
    del recordings["motion of 20 urad"]
    for name, record in recordings.items():
        one = bench.judged(name, record.between(0.0, 0.3), known, true, bench.SPECIAL)
        if name == "ten bits":
            assert one.grade == "fault"
            assert set(one.faults) == {"friction", "short_b"}
        else:
            assert one.grade == "none", name
            assert one.reason


def test_phase_voltages_tell_the_scale_of_torques_and_the_gain_of_a_current_sensor(
    known_by_voltages,
):
    """What currents alone leave open: the scale that all torques share, and 2 % of a sensor."""
    true, known = bench.actuator_off(4), known_by_voltages
    inertia = known.actuator.value("motor.inertia") / true.value("motor.inertia")
    assert abs(inertia - 1.0) < 0.015  # 2 % off without voltages
    faults, drift = bench.CASES[1], {"amperes": 1.02}
    record = recorded(true, faults, 100, drift, bench.VOLTAGES)
    one = bench.judged("", record, known, true, faults)
    assert set(one.faults) == {"friction", "short_b"}
    assert not bench.is_silently_wrong(one)


def test_what_looks_like_added_turns_makes_no_short_an_eccentricity(known_by_voltages) -> None:
    """Turns are never added: stronger magnets have to say so."""
    true, faults, drift = bench.actuator_off(4), bench.CASES[1], {"motor.emf_constant": 1.03}
    record = recorded(true, faults, 101, drift, bench.VOLTAGES)
    one = bench.judged("", record, known_by_voltages, true, faults)
    assert set(one.faults) == {"friction", "short_b"}
    assert not bench.is_silently_wrong(one)
