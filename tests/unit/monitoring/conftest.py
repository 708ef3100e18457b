"""One calibration of the made-up rig, which several tests judge with."""

import pytest

from ematwin.monitoring.calibrate import calibrate
from ematwin.monitoring.calibration import CalibrationReport
from ematwin.monitoring.population_calibration import PopulationCalibration
from made_up_rig import healthy_runs
from shared import computed_once


@pytest.fixture(scope="session")
def report(tmp_path_factory: pytest.TempPathFactory) -> CalibrationReport:
    return computed_once(tmp_path_factory, "rig", lambda: calibrate(healthy_runs(9), name="rig"))


@pytest.fixture(scope="session")
def calibration(report: CalibrationReport) -> PopulationCalibration:
    assert isinstance(report.calibration, PopulationCalibration)
    return report.calibration
