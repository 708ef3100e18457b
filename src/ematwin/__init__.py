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
    from ematwin.optimizers.minimize import minimize
    from ematwin.plant.parameters import Actuator
    from ematwin.plant.scenario import Scenario
    from ematwin.readers.records import read, write
    from ematwin.signals.noise import Noise
    from ematwin.signals.record import Record
    from ematwin.simulation import simulate

_HOMES = {
    "Actuator": "ematwin.plant.parameters",
    "EmatwinError": "ematwin.errors",
    "Faults": "ematwin.faults",
    "Identification": "ematwin.identification.identify",
    "Noise": "ematwin.signals.noise",
    "Record": "ematwin.signals.record",
    "Scenario": "ematwin.plant.scenario",
    "error_percent": "ematwin.faults",
    "error_percent_wrapped": "ematwin.faults",
    "identify": "ematwin.identification.identify",
    "minimize": "ematwin.optimizers.minimize",
    "read": "ematwin.readers.records",
    "simulate": "ematwin.simulation",
    "write": "ematwin.readers.records",
}

__all__ = [
    "Actuator",
    "EmatwinError",
    "Faults",
    "Identification",
    "Noise",
    "Record",
    "Scenario",
    "error_percent",
    "error_percent_wrapped",
    "identify",
    "minimize",
    "read",
    "simulate",
    "write",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'ematwin' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
