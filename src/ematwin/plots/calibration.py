"""Figures of a calibration: parameters, recordings before and after, and residuals."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import COVERAGE
from ematwin.estimation.healthy_fit import same_command
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.registry import model_of
from ematwin.monitoring.calibration import CalibrationReport
from ematwin.plots.style import BLUE, GREY, ORANGE, PALE, Panel, empty, panels_drawn, styled
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording
from ematwin.showing.text import capital

_PARTS = 48  # of a turn, of the speeds and of the time


def plot_learnt(report: CalibrationReport) -> Any:
    """Change of each parameter from the template, with its 95 % interval."""
    shown = [p for p in report.parameters if p.template][::-1]  # plotly draws from below
    height = 110 + 26 * len(shown)  # px of a parameter
    figure = empty(height, hovermode="closest", margin_l=20, margin_t=20, showlegend=False)
    figure.add_scatter(
        y=[p.place for p in shown],
        x=[100.0 * (p.value / p.template - 1.0) for p in shown],
        mode="markers",
        marker={"size": 9, "color": [BLUE if p.determined else PALE for p in shown]},
        error_x={
            "type": "data", "thickness": 1.6, "width": 4, "color": GREY,
            "array": [abs(100.0 * COVERAGE * p.standard_error / p.template) for p in shown],
        },
        hovertemplate="%{y}: %{x:.2f} %<extra></extra>",
    )  # fmt: skip
    return figure.update_xaxes(title_text="change, %", zeroline=True, zerolinewidth=2)


class _Beside(NamedTuple):
    """A recording beside the twin: (S,) arrays by compared channel, in SI."""

    recording: Recording
    captions: dict[str, tuple[str, str]]
    measured: dict[str, np.ndarray]
    before: dict[str, np.ndarray]
    after: dict[str, np.ndarray]


def plot_before_and_after(report: CalibrationReport) -> Any:
    """Healthy recordings of different commands beside the template and the calibrated twin."""
    panels = []
    for one in _beside(report):
        time = one.recording.time
        for name, (title, unit) in one.captions.items():
            target, before, after = (x[name] for x in (one.measured, one.before, one.after))
            beside = Panel(f"{capital(title)}, {one.recording.name}", unit)
            beside.line(time, target, "measured", PALE, width=5)
            beside.line(time, before, "template", BLUE, dash="dot")
            left = Panel("Residual", unit)
            left.line(time, target - before, "measured - template", BLUE, dash="dot")
            left.line(time, target - after, "measured - calibrated", GREY)
            panels += [beside.line(time, after, "calibrated", ORANGE), left]
    return panels_drawn(panels, "time, s", 200)


def plot_residuals(report: CalibrationReport) -> Any:
    """Residual before and after by angle (or position), speed and time, of the first channel."""
    from plotly.subplots import make_subplots

    shown, model = list(_beside(report)), model_of(report.actuator)
    name = next(iter(shown[0].measured))
    title, unit = shown[0].captions[name]
    unit, factor = preferred(unit)
    rows = []
    for one in shown:
        where, what, speed, speed_unit = _motion(model, one.recording)
        gaps = [factor * (one.measured[name] - x[name]) for x in (one.before, one.after)]
        time = one.recording.time
        rows.append((where, speed, (time - time[0]) / (time[-1] - time[0]), *gaps))
    columns = [np.concatenate(x) for x in zip(*rows, strict=True)]
    figure = make_subplots(
        rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.03, subplot_titles=[capital(title)]
    )
    axes = (what, f"speed, {speed_unit}", "share of the recording")
    for n, (axis, values) in enumerate(zip(axes, columns[:3], strict=True), start=1):
        for label, color, gap in (
            ("measured - template", BLUE, columns[3]), ("measured - calibrated", ORANGE, columns[4])
        ):  # fmt: skip
            middle, size = _by_parts(values, gap)
            figure.add_scatter(
                x=middle, y=size, name=label, legendgroup=label, showlegend=n == 1,
                mode="lines+markers", marker={"size": 4}, line={"color": color, "width": 1.6},
                row=1, col=n,
            )  # fmt: skip
        figure.update_xaxes(title_text=axis, row=1, col=n)
    figure.update_yaxes(title_text=f"RMS, {unit}", rangemode="tozero", row=1, col=1)
    return styled(figure, 360)


def _beside(report: CalibrationReport) -> Iterator[_Beside]:
    """Yield a recording of each command, beside the twin before and after."""
    basis = report.basis
    if basis is None or not basis.nuisances:
        raise InputError("This calibration keeps no recordings that a twin was fitted to.")
    model = model_of(report.actuator)
    known: list[Recording] = []
    for recording, nuisances in zip(basis.recordings, basis.nuisances, strict=True):
        if any(same_command(recording, other, model.command) for other in known):
            continue
        if len(known) == 3:
            return  # more make the page no clearer
        known.append(recording)
        before = model.compare(recording, basis.template)
        after = model.compare(recording, report.actuator)
        yield _Beside(
            recording, after.captions(), after.measured(), _answer(before, {}),
            _answer(after, dict(nuisances)),
        )  # fmt: skip


def _answer(comparison: Comparison, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Response of the reference, or of the only model, on the compared channels."""
    exact = comparison.exact(values)
    if exact is not None:
        return exact
    found = comparison.responses({name: np.array([x]) for name, x in values.items()}, 1)
    return {name: trace[0] for name, trace in found.items()}


def _motion(model: Model, recording: Recording) -> tuple[np.ndarray, str, np.ndarray, str]:
    """The recorded position nearest to the motor, else the command; its name; speed, its unit."""
    places = [
        one.name for one in model.channels
        if one.unit in ("rad", "m") and one.name in recording.channels and one.name != model.command
    ]  # fmt: skip
    name = next((name for name in places if "motor" in name), next(iter(places), model.command))
    unit, factor = preferred(model.channel(name).unit)
    place = recording.channels[name]
    speed = factor * np.gradient(place, recording.time)
    if "motor" in name and model.channel(name).unit == "rad":
        return place / (2.0 * np.pi) % 1.0, "motor angle, turns", speed, f"{unit}/s"
    return factor * place, f"{name.replace('_', ' ')}, {unit}", speed, f"{unit}/s"


def _by_parts(values: np.ndarray, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of equal parts of the range of values (N,), and RMS of a gap (N,); NaN of a few."""
    edges = np.linspace(values.min(), values.max(), _PARTS + 1)
    part = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _PARTS - 1)
    counts = np.bincount(part, minlength=_PARTS)
    squares = np.bincount(part, weights=gap**2, minlength=_PARTS)
    kept = counts > max(3, 0.1 * values.size / _PARTS)
    sizes = np.sqrt(squares / np.maximum(counts, 1))
    return 0.5 * (edges[1:] + edges[:-1]), np.where(kept, sizes, np.nan)
