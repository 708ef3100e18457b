"""Figures of identifiability: smallest detectable faults, and correlations."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ematwin.experiments.identifiability import Identifiability
from ematwin.plots.style import BLUE, GREEN, GREY, ORANGE, styled


def plot_smallest(found: Sequence[Identifiability] | Identifiability) -> Any:
    """The smallest detectable fault as a share of its range, by command; none where no bar is."""
    from plotly.graph_objects import Figure

    several = [found] if isinstance(found, Identifiability) else list(found)
    figure = Figure()
    for n, one in enumerate(several):
        told = one.told[::-1]  # plotly draws from below
        shares = [100.0 * t.smallest / t.range if math.isfinite(t.smallest) else None
                  for t in told]  # fmt: skip
        figure.add_bar(
            y=[t.name for t in told], x=shares, name=one.scenario.name, orientation="h",
            marker_color=(BLUE, ORANGE, GREEN, GREY)[n % 4],
            text=["" if share is not None else "none" for share in shares],
        )  # fmt: skip
    figure.update_xaxes(
        title_text="smallest fault found, % of its range", rangemode="tozero", ticksuffix=" %"
    )
    faults = max(len(one.told) for one in several)
    height = 140 + faults * (16 + 14 * len(several))
    return styled(figure, height, hovermode="closest", barmode="group", margin_l=20)


def plot_correlation(found: Identifiability) -> Any:
    """The correlation of all that is unknown, as squares."""
    from plotly.graph_objects import Figure

    names = list(found.names)
    values = np.asarray(found.correlation).round(3)
    rows, columns = np.indices(values.shape)
    figure = Figure()
    figure.add_scatter(
        x=[names[n] for n in columns.ravel()], y=[names[n] for n in rows.ravel()],
        mode="markers", text=values.ravel(),
        marker={
            "symbol": "square", "size": max(5, min(16, 420 // len(names))),
            "color": values.ravel(), "cmin": -1.0, "cmax": 1.0, "colorscale": "RdBu",
            "reversescale": True, "colorbar": {"title": {"text": "correlation"}, "thickness": 12},
        },
        hovertemplate="%{y} and %{x}: %{text:.2f}<extra></extra>",
    )  # fmt: skip
    figure.update_yaxes(autorange="reversed", categoryorder="array", categoryarray=names)
    figure.update_xaxes(categoryorder="array", categoryarray=names, tickangle=-60)
    height = 200 + 18 * len(names)
    return styled(figure, height, margin_l=20, hovermode="closest", showlegend=False)
