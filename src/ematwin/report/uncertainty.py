"""How sure an identification is: sections of its page, corner plot, profiles, band of answers."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.identification import Identification
from ematwin.estimation.profile import LIMIT, ProfileUncertainty
from ematwin.estimation.uncertainty import Uncertainty, predicted
from ematwin.recordings.recording import Recording
from ematwin.report.page import Row, Section, Table
from ematwin.report.style import BLUE, GREEN, GREY, ORANGE, line, stacked, styled


def uncertainty_sections(found: Identification, record: Recording) -> list[Section]:
    """Intervals and probabilities, then the figures of the method."""
    sure = found.uncertainty
    if sure is None:
        return []
    sections = [
        Section(f"How sure: {sure.method}", table=uncertainty_table(sure)),
        Section(points=[*sure.sentences, *(f"Doubt: {sentence}" for sentence in sure.doubts)]),
    ]
    if isinstance(sure, ProfileUncertainty):
        text = "The 95 % interval ends where the rise passes the dotted line, or further out by the"
        text += " error of the model."
        sections.append(Section("Profiles of the faults", text, figure=plot_profile(found)))
    pairs = "Each pair of faults by draws: a slanted cloud is two that are traded off."
    band = (
        "The recording over the answers of the twin to draws of everything that is unknown. Noise "
        "of the sensors is not in the band."
    )
    return [
        *sections,
        Section("Faults together", pairs, figure=plot_posterior(found)),
        Section("What the twin may answer", band, figure=plot_answers(found, record)),
    ]


def uncertainty_table(sure: Uncertainty) -> Table:
    """Interval and probability of each fault by the method that was asked for."""
    rows = [Row(list(row), marked=sure.present[row[0]] > 0.5) for row in sure.rows]
    return Table(list(sure.headings), rows, texts=(-1,))


def plot_posterior(found: Identification, names: Sequence[str] | None = None) -> Any:
    """Joint distribution of faults: each pair as a cloud of draws, each alone as a histogram.

    A dotted line stands at a threshold that is a number. ``names`` are the unknowns that are shown,
    all faults if not given. Raises `InputError` if ``found``, identified with an ``uncertainty``,
    has no draws, or not of an unknown that is named.
    """
    sure = found.uncertainty
    if sure is None:
        raise InputError('The identification has no draws; identify with uncertainty="posterior".')
    shown = list(sure.present if names is None else names)
    missing = [name for name in shown if name not in sure.draws.names]
    if missing:
        raise InputError(
            f"There are no draws of {missing[0]!r}; there are of {', '.join(sure.draws.names)}."
        )
    draws, limits = sure.draws, {}
    for name, text in sure.thresholds.items():
        with suppress(ValueError):  # those in a physical unit are no numbers
            limits[name] = float(text)
    from plotly.subplots import make_subplots

    size = len(shown)
    figure = make_subplots(
        rows=size, cols=size, shared_xaxes=True, horizontal_spacing=0.012, vertical_spacing=0.012
    )
    edges = {name: _edges(draws.of(name)) for name in shown}
    thin = slice(None, None, max(1, len(draws.values) // 1000))  # draws of a cloud
    points = {name: draws.of(name)[thin].astype(np.float32) for name in shown}
    for row, across in enumerate(shown):
        for column, along in enumerate(shown[: row + 1]):
            place = {"row": row + 1, "col": column + 1}
            middle = 0.5 * (edges[along][1:] + edges[along][:-1])
            if row == column:
                counts, _ = np.histogram(draws.of(along), edges[along])
                figure.add_bar(x=middle, y=counts, marker_color=BLUE, showlegend=False, **place)
                limit = limits.get(along, np.nan)
                if edges[along][0] < limit < edges[along][-1]:
                    figure.add_vline(limit, line_color=ORANGE, line_dash="dot", **place)
                figure.update_yaxes(showticklabels=False, **place)
            else:
                figure.add_scatter(
                    x=points[along], y=points[across], mode="markers", showlegend=False,
                    marker={"color": BLUE, "size": 3, "opacity": 0.25}, hoverinfo="skip", **place,
                )  # fmt: skip
                figure.update_xaxes(range=edges[along][[0, -1]], **place)
                figure.update_yaxes(range=edges[across][[0, -1]], **place)
                figure.update_yaxes(showticklabels=column == 0, **place)
            if row == size - 1:
                figure.update_xaxes(title_text=along, **place)
            if column == 0 and row:
                figure.update_yaxes(title_text=across, **place)
    return styled(figure, 160 + 110 * size, hovermode="closest", bargap=0.0)


def plot_profile(found: Identification) -> Any:
    """Rise of the deviance along each fault while everything else follows.

    Raises `InputError` unless ``found`` was identified with ``uncertainty="profile"``.
    """
    if not isinstance(found.uncertainty, ProfileUncertainty):
        raise InputError('The identification has no profiles; identify with uncertainty="profile".')
    from plotly.subplots import make_subplots

    profiles, columns = found.uncertainty.walks, 3
    rows = -(-len(profiles) // columns)
    titles = [f"{name}<br>{one.shape}" for name, one in profiles.items()]
    figure = make_subplots(rows=rows, cols=columns, subplot_titles=titles, vertical_spacing=0.12)
    for n, (name, one) in enumerate(profiles.items()):
        place = {"row": n // columns + 1, "col": n % columns + 1}
        figure.add_scatter(
            x=one.values, y=one.rise, mode="lines+markers", name=name, showlegend=False,
            line={"color": BLUE, "width": 1.4}, **place,
        )  # fmt: skip
        figure.add_hline(LIMIT, line_color=GREY, line_dash="dot", **place)
        figure.add_vrect(*one.interval, fillcolor=GREEN, opacity=0.12, line_width=0, **place)
        figure.update_yaxes(range=[-0.2, 8.0], **place)  # rise that is shown
    figure.update_yaxes(title_text="rise", col=1)
    above = [{"x": title.x, "xanchor": title.xanchor} for title in figure.layout.annotations]
    styled(figure, 110 + 250 * rows, hovermode="closest")
    return figure.update_layout(annotations=above)  # titles stay above their own panels


def _edges(x: np.ndarray) -> np.ndarray:
    # without the outermost draws
    low, high = np.quantile(x, [0.002, 0.998])
    away = 0.0 if high > low else 1e-3  # all the same
    return np.linspace(low - away, high + away, 33)


def plot_answers(found: Identification, recording: Recording) -> Any:
    """Measured channels over the band in which 95 % of the answers to all draws lie."""
    assert found.uncertainty is not None
    comparison = found.model.compare(recording, found.actuator)
    bands = predicted(found.uncertainty.draws, found.estimate.held, comparison)
    measured, captions = comparison.measured(), comparison.captions()
    # more points make the page slow and show nothing more
    thin = slice(None, None, max(1, len(recording) // 5_000))
    time = recording.time[thin]
    titles, units = ([captions[name][k] for name in bands] for k in (0, 1))
    figure = stacked(titles, units, "time, s", 330 * len(bands))
    for n, (name, band) in enumerate(bands.items()):
        low, middle, high = band[:, thin]
        line(figure, n + 1, time, measured[name][thin], "measured", GREY)
        edge = {"row": n + 1, "col": 1, "mode": "lines", "line": {"width": 0}}
        figure.add_scatter(x=time, y=high, showlegend=False, hoverinfo="skip", **edge)
        figure.add_scatter(
            x=time, y=low, fill="tonexty", fillcolor="rgba(213, 94, 0, 0.3)", showlegend=n == 0,
            name="95 % of answers", **edge,
        )  # fmt: skip
        line(figure, n + 1, time, middle, "median answer", ORANGE)
    return figure
