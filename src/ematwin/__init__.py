"""Find the faults of an electromechanical actuator from a recording of how it moved.

    import ematwin

    record = ematwin.simulate("reference", faults={"friction": 0.25}, seed=1)
    ematwin.write(record, "rec.parquet")

Names are loaded when they are first used: importing the package opens no file and compiles
nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

if TYPE_CHECKING:
    from ematwin.benchmarking.compare import compare as compare
    from ematwin.errors import EmatwinError as EmatwinError
    from ematwin.experiments.design import design as design
    from ematwin.experiments.identifiability import identifiability as identifiability
    from ematwin.exploring.server import explore as explore
    from ematwin.fleet.fleet import Fleet as Fleet
    from ematwin.fmu.export import export_fmu as export_fmu
    from ematwin.models.base import Model as Model
    from ematwin.models.proposing import propose_map as propose_map
    from ematwin.models.reading import read as read
    from ematwin.models.reading import write as write
    from ematwin.models.registry import load_actuator as load_actuator
    from ematwin.models.scenario import Scenario as Scenario
    from ematwin.models.simulating import simulate as simulate
    from ematwin.monitoring.calibrate import calibrate as calibrate
    from ematwin.monitoring.identify import detect as detect
    from ematwin.monitoring.identify import identify as identify
    from ematwin.quantities import use_units as use_units
    from ematwin.recordings.noise import Noise as Noise
    from ematwin.recordings.recording import Recording as Recording

_HOMES = {
    "EmatwinError": "ematwin.errors",
    "Fleet": "ematwin.fleet.fleet",
    "Model": "ematwin.models.base",
    "Noise": "ematwin.recordings.noise",
    "Recording": "ematwin.recordings.recording",
    "Scenario": "ematwin.models.scenario",
    "calibrate": "ematwin.monitoring.calibrate",
    "compare": "ematwin.benchmarking.compare",
    "design": "ematwin.experiments.design",
    "detect": "ematwin.monitoring.identify",
    "explore": "ematwin.exploring.server",
    "export_fmu": "ematwin.fmu.export",
    "identifiability": "ematwin.experiments.identifiability",
    "identify": "ematwin.monitoring.identify",
    "load_actuator": "ematwin.models.registry",
    "propose_map": "ematwin.models.proposing",
    "read": "ematwin.models.reading",
    "simulate": "ematwin.models.simulating",
    "use_units": "ematwin.quantities",
    "write": "ematwin.models.reading",
}
__all__ = list(_HOMES)
# Names that fewer users need: of extensions, results and particular kinds.
_FURTHER = {
    "BallScrew": "ematwin.models.ball_screw.parameters",
    "BldcActuator": "ematwin.models.bldc.parameters",
    "Calibration": "ematwin.monitoring.calibration",
    "Channel": "ematwin.recordings.channel",
    "Design": "ematwin.experiments.design",
    "Discrimination": "ematwin.experiments.discriminate",
    "Estimate": "ematwin.estimation.estimate",
    "Faults": "ematwin.models.bldc.faults",
    "Identifiability": "ematwin.experiments.identifiability",
    "Identification": "ematwin.estimation.identification",
    "PmsmActuator": "ematwin.models.pmsm.parameters",
    "Problem": "ematwin.estimation.problem",
    "Sensitivity": "ematwin.experiments.sensitivity",
    "StudyAnalysis": "ematwin.benchmarking.analysis",
    "Unknown": "ematwin.models.unknown",
    "discriminate": "ematwin.experiments.discriminate",
    "error_percent": "ematwin.models.bldc.faults",
    "error_percent_wrapped": "ematwin.models.bldc.faults",
    "healthy_tests": "ematwin.experiments.healthy_tests",
    "minimize": "ematwin.optimizers.loop",
    "register": "ematwin.optimizers.registry",
    "register_model": "ematwin.models.registry",
    "sensitivity": "ematwin.experiments.sensitivity",
}


def __getattr__(name: str) -> Any:
    if home := _HOMES.get(name) or _FURTHER.get(name):
        return getattr(import_module(home), name)
    raise AttributeError(f"module 'ematwin' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
