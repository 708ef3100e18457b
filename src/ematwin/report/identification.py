"""Page: what a recording says about its actuator."""

from collections.abc import Sequence

import numpy as np

from ematwin.estimation.identify import Identification
from ematwin.monitoring.detect import Detection
from ematwin.plots.style import BLUE, GREY, ORANGE, line, stacked, styled
from ematwin.recordings.recording import Recording
from ematwin.report.detection import verdict_table
from ematwin.report.page import Row, Section, Table, render
from ematwin.report.uncertainty import uncertainty_sections

_SHOWN_POINTS = 20_000  # of a curve; more make the page slow and show nothing more


def identification_page(
    found: Identification, record: Recording, judged: Detection | None = None
) -> str:
    """HTML page: faults, measured and fitted channels, residuals, convergence, provenance.

    ``judged`` is the verdict against the actuator's healthy population, where there is one.
    """
    sections = [
        Section("Faults", table=fault_table(found)),
        Section(figure=fault_bars(found)),
        *([Section("Parts", table=parts_table(found))] if found.contrasts else []),
        *uncertainty_sections(found, record),
        Section(
            "Measured and fitted",
            text="Both went through the same filter. A pattern in the residual is something that "
            "the twin does not model.",
            figure=fit_figure(found, record),
        ),
        Section("Convergence", figure=convergence_figure(found)),
        Section("How it was found", facts=_facts(found, record)),
    ]
    if judged is not None:
        table = verdict_table(judged.motions)
        sections.insert(0, Section("Against the healthy population", table=table))
    notes = [*(f"Assumed: {sentence}" for sentence in found.assumed), *found.warnings]
    return render(
        f"{found.actuator.name}: identified faults", found.verdict.sentence, sections, notes
    )


def fault_table(found: Identification) -> Table:
    """Each value with its interval, physical value and healthy value."""
    rows = []
    for row in found.physical:
        cells = [
            row.name,
            f"{row.normalised:.4g}",
            _range(found.intervals.get(row.name)),
            f"{row.value:.4g} {row.unit}",
            _range(found.physical_values.get(row.name, ())[1:]),
            f"{row.healthy:.4g}",
            row.meaning,
        ]
        rows.append(Row(cells, marked=row.name in found.present))
    header = ["fault", "k", "95 % of k", "value", "95 % of value", "healthy", "meaning"]
    return Table(header, rows, last_is_text=True)


def _range(ends: Sequence[float] | None) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g}" if ends else "held"


def parts_table(found: Identification) -> Table:
    """Combinations of faults, and what of load and sensors is not as recorded."""
    rows = [
        Row([one.meaning, f"{value:.3g}", f"{low:.3g} to {high:.3g}", one.ambiguity])
        for one in found.model.contrasts(found.actuator)
        if one.name in found.contrasts
        for value, (low, high) in [found.contrasts[one.name]]
    ]
    for name, (value, (low, high)) in found.nuisances.items():
        one = found.model.unknown(found.actuator, name)
        size = f"{value:.3g} {one.unit}".rstrip()
        cells = [one.meaning, size, f"{low:.3g} to {high:.3g}", "not as recorded"]
        rows.append(Row(cells, marked=True))
    return Table(["part", "value", "95 %", ""], rows, last_is_text=True)


def fault_bars(found: Identification):  # type: ignore[no-untyped-def]
    """Bars of the values against the healthy ones, each as a share of its range."""
    from plotly.graph_objects import Figure

    unknowns = {one.name: one for one in found.model.unknowns(found.actuator)}
    names = [name for name in found.values if name in unknowns]

    def share(name: str, value: float) -> float:
        return (value - unknowns[name].lower) / unknowns[name].width

    def reach(name: str, end: int) -> float:
        if name not in found.intervals:
            return 0.0
        gap = abs(found.intervals[name][end] - found.values[name]) / unknowns[name].width
        return min(gap, 1.0)

    figure = Figure()
    figure.add_bar(
        x=names,
        y=[share(name, found.values[name]) for name in names],
        name="identified",
        marker_color=ORANGE,
        error_y={
            "type": "data",
            "symmetric": False,
            "array": [reach(name, 1) for name in names],
            "arrayminus": [reach(name, 0) for name in names],
            "color": GREY,
        },
    )
    figure.add_scatter(
        x=names,
        y=[share(name, unknowns[name].healthy) for name in names],
        name="healthy",
        mode="markers",
        marker={"symbol": "line-ew", "size": 46, "line": {"width": 3, "color": BLUE}},
    )
    normalised = all(unknowns[n].lower == 0.0 and unknowns[n].upper == 1.0 for n in names)
    figure.update_yaxes(range=[-0.02, 1.02], title_text="k" if normalised else "share of range")
    return styled(figure, 340)


def fit_figure(found: Identification, record: Recording):  # type: ignore[no-untyped-def]
    """Measured and fitted channels, and their differences."""
    model = found.model
    comparison = model.compare(record, found.actuator)
    values = {**found.fitted, **found.values}
    healthy_values = {**values, **_healthy_faults(found)}
    both = {name: np.array([value, healthy_values[name]]) for name, value in values.items()}
    answers = comparison.responses(both, 2)
    measured = comparison.measured()
    captions = comparison.captions()
    thin = slice(None, None, max(1, len(record) // _SHOWN_POINTS))
    t = record.time[thin]
    titles = [text for name in measured for text in (captions[name][0], "Residual")]
    units = [captions[name][1] for name in measured for _ in range(2)]
    figure = stacked(titles, units, "time, s", height=280 * len(titles))
    for n, (name, target) in enumerate(measured.items()):
        fitted, healthy = answers[name]
        line(figure, 2 * n + 1, t, healthy[thin], "healthy twin", BLUE, dash="dot")
        line(figure, 2 * n + 1, t, target[thin], "measured", GREY)
        line(figure, 2 * n + 1, t, fitted[thin], "fitted", ORANGE)
        line(figure, 2 * n + 2, t, (target - fitted)[thin], "measured - fitted", GREY)
    return figure


def _healthy_faults(found: Identification) -> dict[str, float]:
    """Healthy values of the faults; nuisances stay as they were found."""
    return {one.name: one.healthy for one in found.model.faults(found.actuator)}


def convergence_figure(found: Identification):  # type: ignore[no-untyped-def]
    """Best cost over evaluations."""
    figure = stacked(["Best misfit so far"], ["misfit"], "simulations", height=340)
    evaluations, cost = found.history.T
    finite = np.isfinite(cost)
    line(figure, 1, evaluations[finite], cost[finite], found.algorithm, BLUE, shape="hv")
    figure.update_yaxes(type="log")
    return figure


def _facts(found: Identification, record: Recording) -> dict[str, str]:
    source = found.provenance
    facts = {
        "record": str(source.get("file") or f"{source.get('source')} {source.get('model', '')}"),
        "samples": f"{len(record)} at {record.sample_rate:g} Hz",
        "actuator": f"{found.actuator.name}: {found.actuator.description}",
        "algorithm": f"{found.algorithm}, seed {found.seed}",
        "simulations": f"{found.evaluations} in {found.seconds:.2f} s",
        "stopped": found.stopped,
        "misfit": f"{found.cost:.4g}; {100.0 * found.relative_misfit:.2f} %",
        "intervals": "95 %, over noise, the twin's own error, and parameters, load and sensors as "
        + (
            "far as healthy recordings and their drift leave them open"
            if found.calibrated
            else "far as the tolerances of the data sheet leave them open"
        ),
    }
    for name in ("columns", "changed"):
        if source.get(name):
            facts[name] = str(source[name])
    return facts
