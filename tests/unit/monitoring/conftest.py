"""One calibration of the made-up rig, which several tests judge with."""

import pytest

from ematwin.monitoring.calibrate import calibrate
from ematwin.monitoring.calibration_report import CalibrationReport
from made_up_rig import healthy_runs


@pytest.fixture(scope="session")
def report() -> CalibrationReport:
    return calibrate(healthy_runs(9), name="rig")
