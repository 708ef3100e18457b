"""Page: a faulty actuator beside the healthy one."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.models.registry import model_of
from ematwin.plots.recordings import plot_response
from ematwin.recordings.recording import Recording
from ematwin.report.page import Row, Section, Table, listed, render
from ematwin.showing.text import said


def fault_table(values: Mapping[str, float], actuator: Any) -> Table:
    """Each value, as it is searched and as it is measured; what differs from healthy is marked."""
    rows = [
        Row(
            [row.name, f"{row.normalised:.3g}", *row.said, row.meaning],
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
    first, base = model.signals(record, actuator)[0], model.signals(healthy, actuator)[0]
    difference = first.values - base.values
    rms = float(np.sqrt(np.mean(difference**2)))
    level = float(np.sqrt(np.mean(base.values**2)))
    source = record.provenance
    sections = [
        Section("Faults", table=fault_table(values, actuator)),
        Section("Response", figure=plot_response(record, healthy, actuator)),
        Section(
            "Where this comes from",
            facts={
                "model": str(source.get("model")),
                "actuator": f"{actuator.name}: {actuator.description}",
                "scenario": str(source.get("scenario")),
                "samples": f"{len(record)} at {record.sample_rate:g} Hz",
                "noise": listed(source.get("noise")),
                "seed": str(source.get("seed")),
            },
        ),
    ]
    what = first.title.partition(",")[0].lower()
    lead = (
        f"The faults change the {what} by {said(rms, first.unit, 3)} RMS, "
        f"{100.0 * rms / level:.1f} % of the healthy one."
    )
    return render(f"{actuator.name}: faulty and healthy", lead, sections)
