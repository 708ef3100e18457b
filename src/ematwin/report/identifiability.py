"""Page: identifiability of an actuator's faults under commands."""

from collections.abc import Mapping, Sequence

from ematwin.experiments.identifiability import HEADINGS, Identifiability
from ematwin.experiments.sensitivity import Sensitivity
from ematwin.plots.identifiability import plot_correlation, plot_smallest
from ematwin.report.page import Row, Section, Table, render


def identifiability_page(
    found: Sequence[Identifiability], parts: Mapping[str, Sensitivity] | None = None
) -> str:
    """HTML page of one or several commands, the most telling first.

    ``parts`` are Sobol indices by the name of the command, where they were asked for.
    """
    best = found[0]
    sections = [Section("Smallest fault that is found", figure=plot_smallest(found))]
    for one in found:
        text = (
            f"{one.scenario.duration:g} s. Noise and the twin's own error are "
            f"{100.0 * one.noise:.2f} % of the answer. Of the smallest faults all but "
            f"{100.0 * one.miss:.3g} % are found, with false alarms at "
            f"{100.0 * one.false_alarm:.2g} %."
        )
        obstacles = [f"No verdict: {sentence}" for sentence in one.obstacles]
        sections += [
            Section(one.scenario.name, text=text, points=obstacles, table=told_table(one)),
            Section(figure=plot_correlation(one)),
        ]
        if parts:
            sections += sobol_sections(parts[one.scenario.name])
    return render(f"{best.actuator.name}: identifiability of faults", best.lead, sections)


def sobol_sections(parts: Sensitivity) -> list[Section]:
    """Sobol indices of each channel."""
    text = (
        f"How much of the variance of the answer goes back to each unknown, from {parts.answers} "
        "answers: by itself, and with all in which it takes part; standard errors."
    )
    return [
        Section(f"{parts.scenario.name}: {caption}", text=text, table=sobol_table(parts, channel))
        for channel, caption in parts.captions.items()
    ]


def sobol_table(parts: Sensitivity, channel: str) -> Table:
    """Indices of a channel."""
    return Table(["unknown", "by itself", "in all"], [Row(row) for row in parts.rows(channel)])


def told_table(found: Identifiability) -> Table:
    """Each fault with its expected errors."""
    rows = [Row(one.cells, marked=one.how in ("open", "dead")) for one in found.told]
    return Table(list(HEADINGS), rows, last_is_text=True)
