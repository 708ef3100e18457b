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
    from ematwin.benchmarking.analysis import StudyAnalysis
    from ematwin.benchmarking.compare import compare
    from ematwin.errors import EmatwinError
    from ematwin.estimation.estimate import Estimate
    from ematwin.estimation.identify import Identification
    from ematwin.estimation.problem import Problem
    from ematwin.experiments.design import Design, design
    from ematwin.experiments.discriminate import Discrimination, discriminate
    from ematwin.experiments.identifiability import Identifiability, identifiability
    from ematwin.experiments.sensitivity import Sensitivity, sensitivity
    from ematwin.exploring.explore import explore
    from ematwin.models.ball_screw.parameters import BallScrew
    from ematwin.models.base import Model
    from ematwin.models.bldc.faults import Faults, error_percent, error_percent_wrapped
    from ematwin.models.bldc.parameters import BldcActuator
    from ematwin.models.pmsm.parameters import PmsmActuator
    from ematwin.models.proposing import propose_map
    from ematwin.models.reading import read, read_motions, write
    from ematwin.models.registry import load_actuator, register_model
    from ematwin.models.scenario import Scenario
    from ematwin.models.simulating import simulate
    from ematwin.models.unknown import Unknown
    from ematwin.monitoring.calibrate import calibrate
    from ematwin.monitoring.calibration import Calibration
    from ematwin.monitoring.identify import detect, identify
    from ematwin.optimizers.loop import minimize
    from ematwin.optimizers.registry import register
    from ematwin.recordings.channel import Channel
    from ematwin.recordings.noise import Noise
    from ematwin.recordings.recording import Recording

_HOMES = {
    "BallScrew": "ematwin.models.ball_screw.parameters",
    "BldcActuator": "ematwin.models.bldc.parameters",
    "Calibration": "ematwin.monitoring.calibration",
    "Channel": "ematwin.recordings.channel",
    "Design": "ematwin.experiments.design",
    "Discrimination": "ematwin.experiments.discriminate",
    "EmatwinError": "ematwin.errors",
    "Estimate": "ematwin.estimation.estimate",
    "Faults": "ematwin.models.bldc.faults",
    "Identifiability": "ematwin.experiments.identifiability",
    "Identification": "ematwin.estimation.identify",
    "Model": "ematwin.models.base",
    "Noise": "ematwin.recordings.noise",
    "PmsmActuator": "ematwin.models.pmsm.parameters",
    "Problem": "ematwin.estimation.problem",
    "Recording": "ematwin.recordings.recording",
    "Scenario": "ematwin.models.scenario",
    "Sensitivity": "ematwin.experiments.sensitivity",
    "StudyAnalysis": "ematwin.benchmarking.analysis",
    "Unknown": "ematwin.models.unknown",
    "calibrate": "ematwin.monitoring.calibrate",
    "compare": "ematwin.benchmarking.compare",
    "design": "ematwin.experiments.design",
    "detect": "ematwin.monitoring.identify",
    "discriminate": "ematwin.experiments.discriminate",
    "error_percent": "ematwin.models.bldc.faults",
    "error_percent_wrapped": "ematwin.models.bldc.faults",
    "explore": "ematwin.exploring.explore",
    "export_fmu": "ematwin.fmu.export",
    "identifiability": "ematwin.experiments.identifiability",
    "identify": "ematwin.monitoring.identify",
    "load_actuator": "ematwin.models.registry",
    "minimize": "ematwin.optimizers.loop",
    "propose_map": "ematwin.models.proposing",
    "read": "ematwin.models.reading",
    "read_motions": "ematwin.models.reading",
    "register": "ematwin.optimizers.registry",
    "register_model": "ematwin.models.registry",
    "sensitivity": "ematwin.experiments.sensitivity",
    "simulate": "ematwin.models.simulating",
    "write": "ematwin.models.reading",
}
# Names of version 0.1 and what they are called now.
_FORMER = {"Actuator": "BldcActuator", "Motion": "Recording", "Record": "Recording"}

__all__ = [
    "BallScrew",
    "BldcActuator",
    "Calibration",
    "Channel",
    "Design",
    "Discrimination",
    "EmatwinError",
    "Estimate",
    "Faults",
    "Identifiability",
    "Identification",
    "Model",
    "Noise",
    "PmsmActuator",
    "Problem",
    "Recording",
    "Scenario",
    "Sensitivity",
    "StudyAnalysis",
    "Unknown",
    "calibrate",
    "compare",
    "design",
    "detect",
    "discriminate",
    "error_percent",
    "error_percent_wrapped",
    "explore",
    "export_fmu",
    "identifiability",
    "identify",
    "load_actuator",
    "minimize",
    "propose_map",
    "read",
    "read_motions",
    "register",
    "register_model",
    "sensitivity",
    "simulate",
    "write",
]


def __getattr__(name: str) -> Any:
    name = _FORMER.get(name, name)
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'ematwin' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
