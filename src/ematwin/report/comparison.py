"""Page: a faulty actuator beside the healthy one."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.models.registry import model_of
from ematwin.plots.style import BLUE, GREY, ORANGE, line, stacked
from ematwin.recordings.recording import Recording
from ematwin.report.page import Row, Section, Table, render


def fault_table(values: Mapping[str, float], actuator: Any) -> Table:
    """Each value, as it is searched and as it is measured; what differs from healthy is marked."""
    rows = [
        Row(
            [
                row.name,
                f"{row.normalised:.3g}",
                f"{row.value:.4g} {row.unit}",
                f"{row.healthy:.4g} {row.unit}",
                row.meaning,
            ],
            marked=row.value != row.healthy,
        )
        for row in model_of(actuator).describe(actuator, values)
    ]
    return Table(["fault", "k", "value", "healthy", "meaning"], rows, last_is_text=True)


def comparison_page(
    record: Recording, healthy: Recording, values: Mapping[str, float], actuator: Any
) -> str:
    """HTML page of a recording and the healthy one under the same command."""
    model = model_of(actuator)
    faulty_signals = model.signals(record, actuator)
    healthy_signals = model.signals(healthy, actuator)
    first, base = faulty_signals[0], healthy_signals[0]
    difference = first.values - base.values
    titles = [first.title, f"Difference of the {first.title[0].lower()}{first.title[1:]}"]
    units = [first.unit, first.unit]
    for signal in faulty_signals[1:]:
        titles.append(signal.title)
        units.append(signal.unit)
    figure = stacked(titles, units, "time, s", height=225 * len(titles))
    t = record.time
    line(figure, 1, t, base.values, "healthy", BLUE)
    line(figure, 1, t, first.values, "faulty", ORANGE)
    line(figure, 2, t, difference, "faulty - healthy", GREY)
    for row, (one, other) in enumerate(zip(faulty_signals, healthy_signals, strict=True), start=2):
        if row == 2:
            continue
        if one.reference is not None:
            line(figure, row, t, one.reference, "command", GREY, dash="dot")
        line(figure, row, t, other.values, "healthy", BLUE)
        line(figure, row, t, one.values, "faulty", ORANGE)
    rms = float(np.sqrt(np.mean(difference**2)))
    level = float(np.sqrt(np.mean(base.values**2)))
    source = record.provenance
    sections = [
        Section("Faults", table=fault_table(values, actuator)),
        Section("Response", figure=figure),
        Section(
            "Where this comes from",
            facts={
                "model": str(source.get("model")),
                "actuator": f"{actuator.name}: {actuator.description}",
                "scenario": str(source.get("scenario")),
                "samples": f"{len(record)} at {record.sample_rate:g} Hz",
                "noise": str(source.get("noise") or "none"),
                "seed": str(source.get("seed")),
            },
        ),
    ]
    what = first.title.partition(",")[0].lower()
    lead = (
        f"The faults change the {what} by {rms:.3g} {first.unit} RMS, "
        f"{100.0 * rms / level:.1f} % of the healthy one."
    )
    return render(f"{actuator.name}: faulty and healthy", lead, sections)
