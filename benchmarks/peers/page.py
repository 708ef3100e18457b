"""The comparison as Markdown, and as one self-contained page with plots on logarithmic axes."""

import math
from typing import Any

from benchmarks.peers.measure import Part, machine

from ematwin import __version__
from ematwin.report.page import Row, Section, Table, render
from ematwin.report.style import BLUE, ORANGE, styled

TITLE = "ematwin beside its peers"


def versions(parts: list[Part]) -> dict[str, str]:
    """Of all that was compared."""
    found = {"ematwin": __version__}
    for part in parts:
        found.update(part.versions)
    return found


def markdown(part: Part) -> str:
    """Heading, what is measured, the table, and remarks."""
    rows = [
        part.header,
        ["---", *["--:"] * (len(part.header) - 1)],
        *(x.cells() for x in part.lines),
    ]
    table = "\n".join("| " + " | ".join(row) + " |" for row in rows)
    remarks = "".join(f"\n- {sentence}" for sentence in part.remarks)
    return f"## {part.heading}\n\n{part.question}\n\n{table}\n{remarks}"


def footer(parts: list[Part]) -> str:
    """What it ran on, and versions."""
    listed = ", ".join(f"{name} {found}" for name, found in versions(parts).items())
    return f"{machine()}\n\nVersions: {listed}."


def bars(part: Part) -> Any:
    """Medians as bars on a logarithmic axis, with the spread of the repeats."""
    import plotly.graph_objects as go

    lines = [line for line in part.lines if line.values and math.isfinite(line.middle)][::-1]
    values = [line.middle for line in lines]
    finite = [[v for v in line.values if math.isfinite(v)] for line in lines]
    figure = go.Figure(
        go.Bar(
            x=values, y=[line.name for line in lines], orientation="h", showlegend=False,
            marker_color=[BLUE if line.own else ORANGE for line in lines],
            error_x={
                "type": "data", "symmetric": False, "color": "#57606a", "thickness": 1.2,
                "array": [max(ends) - v for ends, v in zip(finite, values, strict=True)],
                "arrayminus": [v - min(ends) for ends, v in zip(finite, values, strict=True)],
            },
            hovertemplate="%{y}: %{x:.3g} " + part.unit + "<extra></extra>",
        )
    )  # fmt: skip
    styled(figure, 110 + 30 * len(lines))
    if values:
        decades = [math.log10(min(values)) - 0.15, math.log10(max(map(max, finite))) + 0.05]
        figure.update_xaxes(range=decades, dtick=1 if decades[1] - decades[0] > 1.7 else "D2")
    figure.update_xaxes(type="log", title_text=part.unit, exponentformat="none")
    figure.update_yaxes(automargin=True)
    figure.update_layout(hovermode="closest")
    return figure


def page(parts: list[Part]) -> str:
    """HTML; bars of ematwin are blue, those of others orange."""
    sections = [
        Section(
            part.heading,
            part.question,
            list(part.remarks),
            Table(part.header, [Row(line.cells(), line.own) for line in part.lines]),
            figure=bars(part),
        )
        for part in parts
    ]
    sections.append(Section("Versions", facts=versions(parts)))
    lead = (
        f"Blue is ematwin, orange are others; bars are medians, whiskers the spread. {machine()}."
    )
    return render(TITLE, lead, sections)
