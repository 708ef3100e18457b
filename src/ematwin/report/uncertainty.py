"""Sections of a page: uncertainty of an identification."""

from ematwin.estimation.identification import Identification
from ematwin.estimation.profile import ProfileUncertainty
from ematwin.estimation.uncertainty import Uncertainty, predicted
from ematwin.plots.uncertainty import band_figure, corner_figure, profile_figure
from ematwin.recordings.recording import Recording
from ematwin.report.page import Row, Section, Table


def uncertainty_sections(found: Identification, record: Recording) -> list[Section]:
    """Intervals and probabilities, then the figures of the method."""
    sure = found.uncertainty
    if sure is None:
        return []
    points = [*sure.sentences, *(f"Doubt: {sentence}" for sentence in sure.doubts)]
    sections = [
        Section(f"How sure: {sure.method}", table=uncertainty_table(sure)),
        Section(points=points),
    ]
    if isinstance(sure, ProfileUncertainty):
        text = "Where the rise passes the dotted line the 95 % interval ends."
        figure = profile_figure(sure.walks)
        sections.append(Section("Profiles of the faults", text=text, figure=figure))
    limits = {
        name: one for name, text in sure.thresholds.items() if (one := _number(text)) is not None
    }
    comparison = found.model.compare(record, found.actuator)
    bands = predicted(sure.draws, found.estimate.held, comparison)
    # more points make the page slow and show nothing more
    thin = slice(None, None, max(1, len(record) // 5_000))
    return [
        *sections,
        Section(
            "Faults together",
            text="Each pair of faults by draws: a slanted cloud is two that are traded off.",
            figure=corner_figure(sure.draws, list(sure.present), limits),
        ),
        Section(
            "What the twin may answer",
            text="The recording over the answers of the twin to draws of everything that is "
            "unknown. Noise of the sensors is not in the band.",
            figure=band_figure(
                record.time[thin],
                {name: trace[thin] for name, trace in comparison.measured().items()},
                {name: band[:, thin] for name, band in bands.items()},
                comparison.captions(),
            ),
        ),
    ]


def uncertainty_table(sure: Uncertainty) -> Table:
    """Interval and probability of each fault by the method that was asked for."""
    rows = [Row(list(row), marked=sure.present[row[0]] > 0.5) for row in sure.rows]
    return Table(list(sure.headings), rows, last_is_text=True)


def _number(text: str) -> float | None:
    """A threshold in the fault's own unit; None where it has a physical one."""
    try:
        return float(text)
    except ValueError:
        return None
