"""Condition monitoring: calibrate a twin on healthy recordings, then judge others against them.

`ematwin.calibrate`, `ematwin.identify` and `ematwin.detect` are the entry points; this package has
the types of their results, and the index and its threshold for further analyses.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ematwin.monitoring.calibration import Calibration
    from ematwin.monitoring.calibration_report import CalibrationReport
    from ematwin.monitoring.classification import Signature
    from ematwin.monitoring.diagnosis import Detection, Diagnosis, Magnitude
    from ematwin.monitoring.index import Scores, health_index, prediction_bound
    from ematwin.monitoring.population_calibration import PopulationCalibration, Thresholds

_HOMES = {
    "Calibration": "calibration",
    "CalibrationReport": "calibration_report",
    "Detection": "diagnosis",
    "Diagnosis": "diagnosis",
    "Magnitude": "diagnosis",
    "PopulationCalibration": "population_calibration",
    "Scores": "index",
    "Signature": "classification",
    "Thresholds": "population_calibration",
    "health_index": "index",
    "prediction_bound": "index",
}

__all__ = [
    "Calibration",
    "CalibrationReport",
    "Detection",
    "Diagnosis",
    "Magnitude",
    "PopulationCalibration",
    "Scores",
    "Signature",
    "Thresholds",
    "health_index",
    "prediction_bound",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"ematwin.monitoring.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'ematwin.monitoring' has no attribute {name!r}")
