"""Figures of results: plotly, one look for all.

    from ematwin.plots import plot_faults, plot_fit

    plot_faults(found).show()

Each function takes a result and returns a figure of plotly. Names are loaded when first used.
"""

from importlib import import_module
from typing import Any

_FILES = {
    "calibration": ("plot_before_and_after", "plot_learnt", "plot_residuals"),
    "experiments": (
        "plot_command", "plot_correlation", "plot_errors", "plot_healthy_tests",
        "plot_learnt_errors", "plot_smallest",
    ),
    "detection": ("plot_trend",),
    "identification": (
        "plot_convergence", "plot_faults", "plot_fit", "plot_posterior", "plot_profile",
    ),
    "recordings": ("plot_channels", "plot_recording", "plot_response"),
    "study": ("plot_study",),
}  # fmt: skip
_HOMES = {name: file for file, names in _FILES.items() for name in names}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"ematwin.report.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'ematwin.plots' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
