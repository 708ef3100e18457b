"""Figures of an identification: faults, fit and convergence."""

from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.identification import Identification
from ematwin.plots import style
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording

_LOOKS = {
    "fault": style.ORANGE, "changed": style.AMBER, "agrees with healthy": style.GREEN,
    "no verdict": style.GREY, "held": style.PALE,
}  # fmt: skip


def plot_faults(found: Identification) -> Any:
    """How far each fault lies from healthy, with its interval, coloured by the verdict.

    A bar is a share of the fault's range. Green agrees with healthy, amber has changed without a
    name, orange is a fault that the verdict names; grey where there is no verdict or the value was
    held. A diamond is the true value, where the recording is a simulation.
    """
    unknowns = {
        one.name: one
        for one in found.model.faults(found.actuator)
        if one.name in found.values and one.direction_of is None
    }
    names = list(unknowns)[::-1]  # plotly draws from below
    healthy = {name: one.healthy for name, one in unknowns.items()}

    def deviation(name: str, value: float) -> float:
        return 100.0 * (value - healthy[name]) / unknowns[name].width

    at = {name: deviation(name, found.values[name]) for name in names}
    ends = {
        name: tuple(deviation(name, end) for end in found.intervals.get(name, ()))
        or (at[name],) * 2
        for name in names
    }
    height = 130 + 34 * len(names)  # px of a bar
    figure = style.empty(height, hovermode="closest", barmode="overlay", margin_l=20)
    for label, color in _LOOKS.items():
        members = [name for name in names if _state(found, name, healthy[name]) == label]
        if not members:
            continue
        figure.add_bar(
            y=members, x=[at[name] for name in members], orientation="h", name=label,
            marker_color=color, width=0.62,
            error_x={
                "type": "data", "symmetric": False, "thickness": 1.6, "width": 5,
                "color": style.GREY,
                "array": [max(ends[name][1] - at[name], 0.0) for name in members],
                "arrayminus": [max(at[name] - ends[name][0], 0.0) for name in members],
            },
            customdata=[_hover(found, name) for name in members],
            hovertemplate="%{customdata}<extra></extra>",
        )  # fmt: skip
    if truth := true_faults(found):
        members = [name for name in names if name in truth]
        figure.add_scatter(
            y=members, x=[deviation(name, truth[name]) for name in members], mode="markers",
            name="true (simulated)", hovertemplate="true: %{x:.3g} %<extra></extra>",
            marker={"symbol": "diamond-open", "size": 11, "color": style.BLUE},
            marker_line_width=2.5,
        )  # fmt: skip
    figure.update_yaxes(categoryorder="array", categoryarray=names)
    return figure.update_xaxes(
        title_text="deviation from healthy, % of its range", zeroline=True, zerolinewidth=2,
        ticksuffix=" %",
    )  # fmt: skip


def _state(found: Identification, name: str, healthy: float) -> str:
    """The group of bars that a fault belongs to."""
    if name not in found.intervals:
        return "held"
    if name in found.present:
        return "fault"
    if found.verdict.grade == "none":
        return "no verdict"
    low, high = found.intervals[name]
    off = found.verdict.grade == "changed" and not low <= healthy <= high
    return "changed" if off else "agrees with healthy"


def true_faults(found: Identification) -> dict[str, float]:
    """The faults that were simulated, by name; empty where a recording was measured."""
    if found.provenance.get("source") != "simulated":
        return {}
    told = found.provenance.get("faults") or {}
    return {name: float(value) for name, value in told.items()}


def _hover(found: Identification, name: str) -> str:
    row = next(row for row in found.physical if row.name == name)
    shown, factor = preferred(row.unit)
    unit = f" {shown}".rstrip()
    value, healthy = factor * row.value, factor * row.healthy
    ends = [factor * x for x in found.physical_values.get(name, ())]
    between = f"<br>95 %: {ends[1]:.3g} to {ends[2]:.3g}{unit}" if ends else ""
    return f"{row.meaning}<br>{value:.4g}{unit}, healthy {healthy:.4g}{unit}{between}"


def plot_fit(found: Identification, recording: Recording | None = None) -> Any:
    """Measured and fitted channels over time, and their differences.

    Parameters
    ----------
    recording : that was identified; None takes the recording in the identification

    Raises
    ------
    InputError
        If the identification keeps no recording and none is given.
    """
    recording = recording or found.recording
    if recording is None:
        raise InputError(
            "The identification keeps no recording; give it: plot_fit(found, recording)."
        )
    model = found.model
    comparison = model.compare(recording, found.actuator)
    values = {**found.fitted, **found.values}
    # nuisances stay as they were found
    healthy_values = values | {one.name: one.healthy for one in model.faults(found.actuator)}
    both = {name: np.array([value, healthy_values[name]]) for name, value in values.items()}
    answers = comparison.responses(both, 2)
    measured = comparison.measured()
    captions = comparison.captions()
    time, panels = recording.time, []
    for name, target in measured.items():
        title, unit = captions[name]
        fitted, healthy = answers[name]
        # the measured line is wide and pale, so that it shows under the fitted one
        beside = style.Panel(title, unit).line(time, target, "measured", style.PALE, width=5)
        beside.line(time, healthy, "healthy twin", style.BLUE, dash="dot")
        residual = style.Panel("Residual", unit).line(
            time, target - fitted, "measured - fitted", style.GREY
        )
        panels += [beside.line(time, fitted, "fitted", style.ORANGE), residual]
    return style.panels_drawn(panels, "time, s", 240)


def plot_convergence(found: Any) -> Any:
    """Best cost over the simulations of a search.

    Parameters
    ----------
    found : Identification, or the `MinimizeResult` of `ematwin.minimize`
    """
    if isinstance(found, Identification):
        evaluations, cost = found.history.T
        title, unit, each = "Best misfit so far", "misfit", "simulations"
    else:
        evaluations, cost = found.history.evaluations, found.history.cost
        title, unit, each = "Best cost so far", "cost", "evaluations"
    figure = style.stacked([title], [unit], each, height=340)
    finite = np.isfinite(cost)
    style.line(
        figure, 1, evaluations[finite], cost[finite], found.algorithm, style.BLUE, shape="hv"
    )
    if (cost[finite] > 0.0).all():
        figure.update_yaxes(type="log", dtick=1, exponentformat="power")
    return figure
