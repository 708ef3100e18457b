"""What a user of Python gives by mistake gets one sentence; what is meant is taken."""

from pathlib import Path

import numpy as np
import pytest

import ematwin
from ematwin.errors import EmatwinError, InputError


@pytest.fixture(scope="module")
def record() -> ematwin.Recording:
    return ematwin.simulate("monitor", faults={"friction": 0.25}, noise=0.02)


WRONG = {
    "noise": (lambda r: ematwin.simulate(noise=[1]), "noise must be a Noise"),
    "per cent": (lambda r: ematwin.simulate(noise=2), "write 0.02"),
    "fault": (lambda r: ematwin.simulate(faults="friction"), "Faults are values by name"),
    "faults": (lambda r: ematwin.simulate(faults=["friction"]), "Faults are values by name"),
    "actuator": (lambda r: ematwin.simulate(actuator=3), "An actuator is"),
    "scenario": (lambda r: ematwin.simulate(scenario=3), "A scenario is"),
    "no calibration": (lambda r: ematwin.detect(r, None), "detect needs a calibration"),
    "nothing": (lambda r: ematwin.identify(None), "received None"),
    "a number": (lambda r: ematwin.identify(3), "received 3"),
    "columns": (lambda r: ematwin.identify(dict(r.columns())), "received dict"),
    "numbers": (lambda r: ematwin.identify([1]), "received int"),
    "no recordings": (lambda r: ematwin.identify([]), "at least one"),
    "no healthy ones": (lambda r: ematwin.calibrate(None), "received None"),
    "no path": (lambda r: ematwin.read(None), "received None"),
    "load": (lambda r: ematwin.identify(r.changed(load=None), load="x"), "load must be a number"),
    "budget": (lambda r: ematwin.identify(r, budget="many"), "budget must be a whole number"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_argument_gets_one_sentence(record: ematwin.Recording, name: str) -> None:
    call, said = WRONG[name]
    with pytest.raises(EmatwinError, match=said) as refused:
        call(record)
    assert "\n" not in str(refused.value)


def test_noise_may_be_a_share_or_a_text(record: ematwin.Recording) -> None:
    for noise in (ematwin.Noise(white=0.02), "white=0.02"):
        same = ematwin.simulate("monitor", faults={"friction": 0.25}, noise=noise)
        np.testing.assert_array_equal(same.current, record.current)


def test_a_recording_tells_its_duration_and_saves_itself(record, tmp_path: Path) -> None:
    assert record.duration == pytest.approx(0.5)
    record.save(tmp_path / "day1.parquet")
    np.testing.assert_array_equal(ematwin.read(tmp_path / "day1.parquet").current, record.current)


def test_the_recording_decides_which_actuator_is_meant(tmp_path: Path) -> None:
    quick = {"servo48": "monitor", "servo400": "monitor", "rm1605": None, "emps": None}
    for name, model in quick.items():
        record = ematwin.simulate(model, actuator=name)
        record.save(tmp_path / f"{name}.csv")
        for given in (record, tmp_path / f"{name}.csv"):
            assert ematwin.models.reading.actuator_for(given).name == name
    screw = ematwin.read(tmp_path / "rm1605.csv")
    assert ematwin.calibrate([screw]).actuator.kind == "ball-screw"


def test_recordings_of_an_iterator_are_all_judged(record: ematwin.Recording) -> None:
    found = ematwin.identify((one for one in (record, record)), only="friction", exact=True)
    assert len(found.motions) == 2


def test_a_recording_that_two_kinds_may_have_made_is_asked_about() -> None:
    record = ematwin.simulate("monitor", actuator="servo400")
    measured = record.changed(provenance={}, source="bench.csv")
    with pytest.raises(
        InputError, match=r"bench\.csv has channels of the kinds bldc and pmsm\. Name"
    ):
        ematwin.identify(measured)


def test_each_recording_in_memory_is_a_run_of_its_own() -> None:
    records = [ematwin.simulate(actuator="rm1605", noise=0.02, seed=day) for day in range(3)]
    for healthy in (records, [record.to_frame() for record in records]):
        assert ematwin.calibrate(healthy).learnt == ["1", "2", "3"]
