"""Find the faults of an electromechanical actuator from a recording of how it moved.

    import ematwin

    record = ematwin.simulate("reference", faults={"friction": 0.25}, seed=1)
    ematwin.write(record, "rec.parquet")

Names are loaded when they are first used: importing the package opens no file and compiles
nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from ematwin.errors import EmatwinError
    from ematwin.faults import Faults, error_percent, error_percent_wrapped
    from ematwin.identification.identify import Identification, identify
    from ematwin.monitoring.calibrate import calibrate
    from ematwin.monitoring.calibration import Calibration
    from ematwin.monitoring.detect import detect
    from ematwin.optimizers.minimize import minimize
    from ematwin.plant.ball_screw import BallScrew
    from ematwin.plant.parameters import Actuator
    from ematwin.plant.scenario import Scenario
    from ematwin.readers.motions import read_motions
    from ematwin.readers.records import read, write
    from ematwin.signals.motion import Motion
    from ematwin.signals.noise import Noise
    from ematwin.signals.record import Record
    from ematwin.simulation import simulate

_HOMES = {
    "Actuator": "ematwin.plant.parameters",
    "BallScrew": "ematwin.plant.ball_screw",
    "Calibration": "ematwin.monitoring.calibration",
    "EmatwinError": "ematwin.errors",
    "Faults": "ematwin.faults",
    "Identification": "ematwin.identification.identify",
    "Motion": "ematwin.signals.motion",
    "Noise": "ematwin.signals.noise",
    "Record": "ematwin.signals.record",
    "Scenario": "ematwin.plant.scenario",
    "calibrate": "ematwin.monitoring.calibrate",
    "detect": "ematwin.monitoring.detect",
    "error_percent": "ematwin.faults",
    "error_percent_wrapped": "ematwin.faults",
    "identify": "ematwin.identification.identify",
    "minimize": "ematwin.optimizers.minimize",
    "read": "ematwin.readers.records",
    "read_motions": "ematwin.readers.motions",
    "simulate": "ematwin.simulation",
    "write": "ematwin.readers.records",
}

__all__ = [
    "Actuator",
    "BallScrew",
    "Calibration",
    "EmatwinError",
    "Faults",
    "Identification",
    "Motion",
    "Noise",
    "Record",
    "Scenario",
    "calibrate",
    "detect",
    "error_percent",
    "error_percent_wrapped",
    "identify",
    "minimize",
    "read",
    "read_motions",
    "simulate",
    "write",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'ematwin' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
