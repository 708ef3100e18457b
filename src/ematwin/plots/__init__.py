"""Figures of results: plotly, one look for all.

    from ematwin.plots import plot_faults, plot_fit

    plot_faults(found).show()

Each function takes a result and returns a figure of plotly. Names are loaded when first used.
"""

from importlib import import_module
from typing import Any

_HOMES = {
    "plot_before_and_after": "calibration",
    "plot_channels": "recordings",
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
    "plot_recording": "recordings",
    "plot_residuals": "calibration",
    "plot_response": "recordings",
    "plot_smallest": "identifiability",
    "plot_study": "study",
    "plot_trend": "detection",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"ematwin.plots.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'ematwin.plots' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
