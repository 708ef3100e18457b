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
    from ematwin.benchmarking.compare import compare
    from ematwin.errors import EmatwinError
    from ematwin.experiments.design import design
    from ematwin.experiments.discriminate import discriminate
    from ematwin.experiments.healthy_tests import healthy_tests
    from ematwin.experiments.identifiability import identifiability
    from ematwin.exploring.explore import explore
    from ematwin.fleet.fleet import Fleet
    from ematwin.fmu.export import export_fmu
    from ematwin.models.base import Model
    from ematwin.models.proposing import propose_map
    from ematwin.models.reading import read, write
    from ematwin.models.registry import load_actuator, register_model
    from ematwin.models.scenario import Scenario
    from ematwin.models.simulating import simulate
    from ematwin.monitoring.calibrate import calibrate
    from ematwin.monitoring.calibration import Calibration
    from ematwin.monitoring.identify import detect, identify
    from ematwin.optimizers.loop import minimize
    from ematwin.optimizers.registry import register
    from ematwin.quantities import use_units
    from ematwin.recordings.noise import Noise
    from ematwin.recordings.recording import Recording

_HOMES = {
    "Calibration": "ematwin.monitoring.calibration",
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
    "discriminate": "ematwin.experiments.discriminate",
    "explore": "ematwin.exploring.explore",
    "export_fmu": "ematwin.fmu.export",
    "healthy_tests": "ematwin.experiments.healthy_tests",
    "identifiability": "ematwin.experiments.identifiability",
    "identify": "ematwin.monitoring.identify",
    "load_actuator": "ematwin.models.registry",
    "minimize": "ematwin.optimizers.loop",
    "propose_map": "ematwin.models.proposing",
    "read": "ematwin.models.reading",
    "register": "ematwin.optimizers.registry",
    "register_model": "ematwin.models.registry",
    "simulate": "ematwin.models.simulating",
    "use_units": "ematwin.quantities",
    "write": "ematwin.models.reading",
}
# Names that a user seldom needs; their modules are their place, and these go on working.
_FORMER = {
    "BallScrew": "ematwin.models.ball_screw.parameters",
    "BldcActuator": "ematwin.models.bldc.parameters",
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
    "error_percent": "ematwin.models.bldc.faults",
    "error_percent_wrapped": "ematwin.models.bldc.faults",
    "read_motions": "ematwin.models.reading",
    "sensitivity": "ematwin.experiments.sensitivity",
}
# Names of version 0.1 and what they are called now.
_RENAMED = {"Actuator": "BldcActuator", "Motion": "Recording", "Record": "Recording"}

__all__ = [
    "Calibration",
    "EmatwinError",
    "Fleet",
    "Model",
    "Noise",
    "Recording",
    "Scenario",
    "calibrate",
    "compare",
    "design",
    "detect",
    "discriminate",
    "explore",
    "export_fmu",
    "healthy_tests",
    "identifiability",
    "identify",
    "load_actuator",
    "minimize",
    "propose_map",
    "read",
    "register",
    "register_model",
    "simulate",
    "use_units",
    "write",
]


def __getattr__(name: str) -> Any:
    name = _RENAMED.get(name, name)
    if home := _HOMES.get(name) or _FORMER.get(name):
        return getattr(import_module(home), name)
    raise AttributeError(f"module 'ematwin' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
