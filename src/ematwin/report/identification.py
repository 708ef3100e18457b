"""Page: what a recording says about its actuator."""

import math

import numpy as np

from ematwin.faults import FAULTS, HEALTHY
from ematwin.identification.identify import Identification
from ematwin.identification.objective import Objective
from ematwin.report.figures import BLUE, GREY, ORANGE, line, stacked, styled
from ematwin.report.page import Row, Section, Table, render
from ematwin.signals.record import Record

_SHOWN_POINTS = 20_000  # of a curve; more make the page slow and show nothing more


def identification_page(found: Identification, record: Record) -> str:
    """HTML page: faults, measured and fitted current, residual, convergence, provenance."""
    sections = [
        Section("Faults", table=fault_table(found)),
        Section(figure=fault_bars(found)),
        Section(
            "Measured and fitted current",
            text="Both are low-passed alike. A residual with a pattern in it is something that the "
            "twin does not know.",
            figure=fit_figure(found, record),
        ),
        Section("Convergence", figure=convergence_figure(found)),
        Section("How it was found", facts=_facts(found, record)),
    ]
    return render(
        f"{found.actuator.name}: identified faults", lead_sentence(found), sections, found.warnings
    )


def lead_sentence(found: Identification) -> str:
    """The finding in one sentence."""
    named = []
    for row in found.faults.physical(found.actuator):
        index = FAULTS.index(row.name)
        size = abs(row.normalised - HEALTHY[index])
        error = found.standard_error.get(row.name, 0.0)
        direction = row.name == "eccentricity_phase"
        if size >= 0.02 and not direction and size > 3.0 * error and row.name in found.searched:
            value = f"{row.value:.3g} {row.unit}".rstrip()
            healthy = f"{row.healthy:.3g} {row.unit}".rstrip()
            named.append(f"{row.name} {value} (healthy {healthy})")
    what = "; ".join(named) if named else "no fault larger than 0.02 of its range"
    return f"Found: {what}. The twin explains the current to {100.0 * found.relative_misfit:.2f} %."


def fault_table(found: Identification) -> Table:
    """Each component with its standard error, physical value and healthy value."""
    rows = []
    for row in found.faults.physical(found.actuator):
        searched = row.name in found.searched
        error = found.standard_error.get(row.name, math.inf)
        size = abs(row.normalised - HEALTHY[FAULTS.index(row.name)])
        spread = f"± {error:.4f}" if math.isfinite(error) else "not determined"
        cells = [
            row.name,
            f"{row.normalised:.4f}",
            spread if searched else "held",
            f"{row.value:.4g} {row.unit}",
            f"{row.healthy:.4g} {row.unit}",
            row.meaning,
        ]
        rows.append(Row(cells, marked=searched and size >= 0.02 and size > 3.0 * error))
    header = ["fault", "k", "standard error", "value", "healthy", "meaning"]
    return Table(header, rows, last_is_text=True)


def fault_bars(found: Identification):  # type: ignore[no-untyped-def]
    """Bars of the normalised faults against the healthy values."""
    from plotly.graph_objects import Figure

    values = found.faults.vector
    errors = [min(found.standard_error.get(name, 0.0), 1.0) for name in FAULTS]
    figure = Figure()
    figure.add_bar(
        x=list(FAULTS),
        y=values,
        name="identified",
        marker_color=ORANGE,
        error_y={"type": "data", "array": errors, "color": GREY},
    )
    figure.add_scatter(
        x=list(FAULTS),
        y=HEALTHY,
        name="healthy",
        mode="markers",
        marker={"symbol": "line-ew", "size": 46, "line": {"width": 3, "color": BLUE}},
    )
    figure.update_yaxes(range=[-0.02, 1.02], title_text="k")
    return styled(figure, 340)


def fit_figure(found: Identification, record: Record):  # type: ignore[no-untyped-def]
    """Measured and fitted equivalent current, and their difference."""
    objective = Objective(record, found.actuator)
    fitted = objective.responses(found.faults.vector[None])[0]
    healthy = objective.responses(HEALTHY[None])[0]
    thin = slice(None, None, max(1, len(record) // _SHOWN_POINTS))
    t = record.time[thin]
    kind = "magnitude" if objective.rectify else "signed"
    figure = stacked(
        [f"Equivalent current ({kind}, {objective.low_pass.cutoff:g} Hz low-pass)", "Residual"],
        ["A", "A"],
        "time, s",
        height=560,
    )
    line(figure, 1, t, healthy[thin], "healthy twin", BLUE, dash="dot")
    line(figure, 1, t, objective.target[thin], "measured", GREY)
    line(figure, 1, t, fitted[thin], "fitted", ORANGE)
    line(figure, 2, t, (objective.target - fitted)[thin], "measured - fitted", GREY)
    return figure


def convergence_figure(found: Identification):  # type: ignore[no-untyped-def]
    """Best cost over evaluations."""
    figure = stacked(["Best misfit so far"], ["A s"], "simulations", height=340)
    evaluations, cost = found.history.T
    finite = np.isfinite(cost)
    line(figure, 1, evaluations[finite], cost[finite], found.algorithm, BLUE, shape="hv")
    figure.update_yaxes(type="log")
    return figure


def _facts(found: Identification, record: Record) -> dict[str, str]:
    source = found.provenance
    facts = {
        "record": str(source.get("file") or f"{source.get('source')} {source.get('model', '')}"),
        "samples": f"{len(record)} at {record.sample_rate:g} Hz",
        "actuator": f"{found.actuator.name}: {found.actuator.description}",
        "algorithm": f"{found.algorithm}, seed {found.seed}",
        "simulations": f"{found.evaluations} in {found.seconds:.2f} s",
        "stopped": found.stopped,
        "misfit": f"{found.cost:.4g} A s; {100.0 * found.relative_misfit:.2f} % of the current",
        "standard errors": "widened to cover the twin's own error as it was measured on simulated "
        "records; a lower bound where the real actuator differs more",
    }
    for name in ("columns", "assumed", "changed"):
        if source.get(name):
            facts[name] = str(source[name])
    return facts
