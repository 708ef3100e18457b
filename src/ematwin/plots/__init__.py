"""Figures of results: plotly, one look for all.

    from ematwin.plots import plot_faults, plot_fit

    plot_faults(found).show()

Each function takes a result and returns a figure of plotly. Names are loaded when first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ematwin.plots.calibration import plot_before_and_after, plot_learnt, plot_residuals
    from ematwin.plots.channels import plot_channels, plot_recording
    from ematwin.plots.design import (
        plot_command,
        plot_errors,
        plot_healthy_tests,
        plot_learnt_errors,
    )
    from ematwin.plots.detection import plot_trend
    from ematwin.plots.identifiability import plot_correlation, plot_smallest
    from ematwin.plots.identification import plot_convergence, plot_faults, plot_fit
    from ematwin.plots.simulation import plot_response
    from ematwin.plots.study import plot_study
    from ematwin.plots.uncertainty import plot_posterior, plot_profile

_HOMES = {
    "plot_before_and_after": "calibration",
    "plot_channels": "channels",
    "plot_command": "design",
    "plot_convergence": "identification",
    "plot_correlation": "identifiability",
    "plot_errors": "design",
    "plot_faults": "identification",
    "plot_fit": "identification",
    "plot_healthy_tests": "design",
    "plot_learnt": "calibration",
    "plot_learnt_errors": "design",
    "plot_posterior": "uncertainty",
    "plot_profile": "uncertainty",
    "plot_recording": "channels",
    "plot_residuals": "calibration",
    "plot_response": "simulation",
    "plot_smallest": "identifiability",
    "plot_study": "study",
    "plot_trend": "detection",
}

__all__ = [
    "plot_before_and_after",
    "plot_channels",
    "plot_command",
    "plot_convergence",
    "plot_correlation",
    "plot_errors",
    "plot_faults",
    "plot_fit",
    "plot_healthy_tests",
    "plot_learnt",
    "plot_learnt_errors",
    "plot_posterior",
    "plot_profile",
    "plot_recording",
    "plot_residuals",
    "plot_response",
    "plot_smallest",
    "plot_study",
    "plot_trend",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"ematwin.plots.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'ematwin.plots' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
