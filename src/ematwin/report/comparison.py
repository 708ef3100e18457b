"""Page: a faulty actuator beside the healthy one."""

import numpy as np

from ematwin.faults import FAULTS, HEALTHY, Faults
from ematwin.plant.parameters import Actuator
from ematwin.report.figures import BLUE, GREY, ORANGE, line, stacked
from ematwin.report.page import Row, Section, Table, render
from ematwin.signals.envelope import current_envelope, signed_current
from ematwin.signals.filters import LowPass
from ematwin.signals.record import Record


def fault_table(faults: Faults, actuator: Actuator) -> Table:
    """The eight components, normalised and physical; what differs from healthy is marked."""
    rows = []
    for row in faults.physical(actuator):
        changed = row.normalised != HEALTHY[FAULTS.index(row.name)]
        cells = [
            row.name,
            f"{row.normalised:.3g}",
            f"{row.value:.4g} {row.unit}",
            f"{row.healthy:.4g} {row.unit}",
            row.meaning,
        ]
        rows.append(Row(cells, marked=changed))
    return Table(["fault", "k", "value", "healthy", "meaning"], rows, last_is_text=True)


def shown_current(record: Record, actuator: Actuator) -> np.ndarray:
    """Equivalent current, A, signed where that can be told, low-passed where the rate allows."""
    signed = signed_current(record, actuator.motor.pole_pairs)
    current = current_envelope(record) if signed is None else signed
    filter_ = LowPass()
    fast_enough = record.sample_rate >= 4.0 * filter_.cutoff
    return filter_.apply(current, record.sample_rate) if fast_enough else current


def comparison_page(record: Record, healthy: Record, faults: Faults, actuator: Actuator) -> str:
    """HTML page of a record and the healthy one under the same command."""
    faulty_current = shown_current(record, actuator)
    healthy_current = shown_current(healthy, actuator)
    figure = stacked(
        ["Equivalent current, 500 Hz low-pass", "Difference of the currents", "Output position",
         "Following error"],
        ["A", "A", "mrad", "mrad"],
        "time, s",
        height=900,
    )  # fmt: skip
    t = record.time
    line(figure, 1, t, healthy_current, "healthy", BLUE)
    line(figure, 1, t, faulty_current, "faulty", ORANGE)
    line(figure, 2, t, faulty_current - healthy_current, "faulty - healthy", GREY)
    line(figure, 3, t, 1e3 * record.command, "command", GREY, dash="dot")
    for one, name, color in ((healthy, "healthy", BLUE), (record, "faulty", ORANGE)):
        if one.output_position is not None:
            line(figure, 3, t, 1e3 * one.output_position, name, color)
            line(figure, 4, t, 1e3 * (one.command - one.output_position), name, color)
    rms = float(np.sqrt(np.mean((faulty_current - healthy_current) ** 2)))
    base = float(np.sqrt(np.mean(healthy_current**2)))
    source = record.provenance
    sections = [
        Section("Faults", table=fault_table(faults, actuator)),
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
    lead = (
        f"The faults change the equivalent current by {rms:.3g} A RMS, "
        f"{100.0 * rms / base:.1f} % of the healthy current."
    )
    return render(f"{actuator.name}: faulty and healthy", lead, sections)
