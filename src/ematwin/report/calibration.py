"""A calibration: page, table and sentences, which the shell shows as well, and figures."""

import math
import shlex
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import COVERAGE
from ematwin.estimation.healthy_fit import same_command
from ematwin.models.base import Model
from ematwin.models.comparison import one_candidate
from ematwin.models.registry import model_of
from ematwin.monitoring.calibration import CalibrationReport
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording
from ematwin.report.page import Row, Section, Table, render
from ematwin.report.style import BLUE, GREY, ORANGE, PALE, Panel, empty, panels_drawn, styled
from ematwin.showing.text import capital, in_unit, number_of, plain, said_between


def calibration_page(report: CalibrationReport) -> str:
    """HTML page: parameters beside their template, undetermined ones, spread of healthy runs."""
    actuator = report.actuator
    told = [p for p in report.parameters if p.determined]
    learnt = f"{len(told)} parameters from {report.baseline.recordings} healthy recordings"
    lead = f"{actuator.name}: {learnt}. {misfit_sentence(report)}"
    sections = [
        Section("How it is built", points=forms_sentences(report), table=_forms_table(report)),
        Section("Parameters", table=parameter_table(report)),
        Section("What they leave open", points=open_sentences(report)),
        *_fit_sections(report),
        Section("How healthy runs differ", points=spread_sentences(report)),
        Section("Learnt from", facts={"runs": ", ".join(report.learnt), "kind": actuator.kind}),
    ]
    if told:
        text = "Lines are 95 % intervals. Pale: not determined by these recordings."
        sections.insert(0, Section("Change from the template", text, figure=plot_learnt(report)))
    return render(f"{actuator.name}: calibration", lead.rstrip(), sections, list(report.notes))


def _forms_table(report: CalibrationReport) -> Table | None:
    """Each form, or forms found together, and its share of the residual of its equation."""
    forms = None if report.basis is None else report.basis.forms
    if forms is None or not forms.found:
        return None
    names, rows = iter(forms.found), []
    for equation, count, share in forms.explained:
        rows.append(Row(["; ".join(islice(names, count)), equation, f"{100.0 * share:.3g}"]))
    return Table(["form", "equation", "explains of its residual, %"], rows)


def _fit_sections(report: CalibrationReport) -> list[Section]:
    """Recordings beside the twin before and after, and residuals; none where that is not known."""
    if report.basis is None or not report.basis.nuisances:
        return []
    beside = "A healthy recording of each command beside the template and the calibrated twin."
    by_parts = (
        "Root mean square of the difference in each of 48 parts. What depends on the angle is "
        "cogging or the winding, on the speed friction or back-EMF, on the time warming or a load."
    )
    fit = Section("Before and after", beside, figure=plot_before_and_after(report))
    title = "Residuals by angle, speed and time"
    return [fit, Section(title, by_parts, figure=plot_residuals(report))]


def parameter_table(report: CalibrationReport) -> Table:
    """Each parameter with its 95 % interval and the template's value."""
    units = {place: unit for place, _, unit, _, _ in report.actuator.parameters()}
    rows = []
    for p in report.parameters:
        reach = COVERAGE * p.standard_error
        unit = units[p.place]
        number, between = said_between(p.value, p.value - reach, p.value + reach, unit)
        cells = [p.place, number, between, number_of(p.template, unit)]
        rows.append(Row([*cells, "" if p.determined else "not determined"]))
    return Table(["parameter", "value", "95 % interval", "template", ""], rows, texts=(-1,))


def misfit_sentence(report: CalibrationReport) -> str:
    """How much of the healthy recordings the twin leaves; "" where it is not known."""
    known = report.baseline
    if not math.isfinite(known.misfit):
        return ""
    floor = ""
    if math.isfinite(known.expected_misfit):
        floor = f" (noise and known errors of the twin: {100.0 * known.expected_misfit:.2f} %)"
    return f"The twin leaves {100.0 * known.misfit:.2f} % of healthy recordings unexplained{floor}."


def forms_sentences(report: CalibrationReport) -> list[str]:
    """Which forms healthy recordings show that the template had left out, and which they do not."""
    known = report.baseline
    absent = f"Looked for and not found: {', '.join(known.absent_forms)}."
    return [*([known.forms] if known.forms else []), *([absent] if known.absent_forms else [])]


def open_sentences(report: CalibrationReport, file: str = "CALIBRATED.toml") -> list[str]:
    """Parameters not determined, or known together only; ``file`` holds the calibration."""
    if not report.parameters:
        return []
    fitted = {p.place for p in report.parameters}
    missing = [p.place for p in report.parameters if not p.determined]
    fixed = [one[0] for one in report.actuator.parameters() if one[0] not in fitted]
    known = "are known; a common factor stays uncertain."
    said = [f"Only ratios or products of {', '.join(group)} {known}" for group in report.tied]
    if missing:
        learn = f"ematwin design --learn --actuator {shlex.quote(file)} --out test.toml"
        tests = "" if model_of(report.actuator).recordings_differ else f" Tests that would: {learn}"
        within = "they stay within the tolerances of the template."
        said.insert(0, f"These recordings do not determine {', '.join(missing)}: {within}{tests}")
    return [*said, *([f"Not fitted: {', '.join(fixed)}."] if fixed else [])]


def spread_sentences(report: CalibrationReport) -> list[str]:
    """How far healthy recordings are from one another."""
    calibration = report.calibration
    if not isinstance(calibration, PopulationCalibration):
        scatter = report.baseline.scatter
        if not scatter:
            return []
        # recordings without noise differ by rounding, as shares of a range
        off = [f"{name} {plain(value, 2)}" for name, value in scatter.items() if value > 1e-9]
        if not off:
            return ["Estimates on healthy recordings are healthy within their standard errors."]
        said = "Healthy recordings are found off healthy by more than their standard errors explain"
        return [f"{said}: {', '.join(off)} (one standard deviation)."]
    told = []
    for one in calibration.quantities:
        unit, scale = ("%", 100.0) if one.logarithmic else (one.unit, one.scale)
        within, between = (in_unit(plain(x * scale), unit) for x in report.run_spread[one.name])
        told.append(f"{one.name} scatters by {within} within a run and {between} between runs")
    facts = calibration.facts
    labels = "" if facts["labels"] == "none" else f" with {facts['labels']}"
    return [
        *told,
        f"healthy reference: {len(calibration.healthy.runs)} recordings{labels}",
        f"learnt from runs {', '.join(report.learnt)}",
        *(f"known fault: {one.fault}, from {one.source}" for one in calibration.signatures),
    ]


_PARTS = 48  # of a turn, of the speeds and of the time


def plot_learnt(report: CalibrationReport) -> Any:
    """Change of each parameter from the template, with its 95 % interval."""
    shown = [p for p in report.parameters if p.template][::-1]  # plotly draws from below
    height = 110 + 26 * len(shown)  # px of a parameter
    figure = empty(height, hovermode="closest", margin_l=20, margin_t=20, showlegend=False)
    figure.add_scatter(
        y=[p.place for p in shown],
        x=[100.0 * (p.value / p.template - 1.0) for p in shown],
        mode="markers",
        marker={"size": 9, "color": [BLUE if p.determined else PALE for p in shown]},
        error_x={
            "type": "data", "thickness": 1.6, "width": 4, "color": GREY,
            "array": [abs(100.0 * COVERAGE * p.standard_error / p.template) for p in shown],
        },
        hovertemplate="%{y}: %{x:.2f} %<extra></extra>",
    )  # fmt: skip
    return figure.update_xaxes(title_text="change, %", zeroline=True, zerolinewidth=2)


def plot_before_and_after(report: CalibrationReport) -> Any:
    """Healthy recordings of different commands beside the template and the calibrated twin."""
    panels = []
    for recording, captions, answers in _beside(report):
        time = recording.time
        for name, (target, before, after) in answers.items():
            title, unit = captions[name]
            beside = Panel(f"{capital(title)}, {recording.name}", unit)
            beside.line(time, target, "measured", PALE, width=5)
            beside.line(time, before, "template", BLUE, dash="dot")
            left = Panel("Residual", unit)
            left.line(time, target - before, "measured - template", BLUE, dash="dot")
            left.line(time, target - after, "measured - calibrated", GREY)
            panels += [beside.line(time, after, "calibrated", ORANGE), left]
    return panels_drawn(panels, 200)


def plot_residuals(report: CalibrationReport) -> Any:
    """Residual before and after by angle (or position), speed and time, of the first channel."""
    from plotly.subplots import make_subplots

    rows, model = [], model_of(report.actuator)
    for recording, captions, answers in _beside(report):
        name, (target, *twins) = next(iter(answers.items()))
        title, unit = captions[name]
        where, what, speed, speed_unit = _motion(model, recording)
        share = (recording.time - recording.time[0]) / recording.duration
        rows.append((where, speed, share, *(target - twin for twin in twins)))
    columns = [np.concatenate(x) for x in zip(*rows, strict=True)]
    unit, factor = preferred(unit)
    figure = make_subplots(
        rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.03, subplot_titles=[capital(title)]
    )
    axes = (what, f"speed, {speed_unit}", "share of the recording")
    gaps = ("measured - template", BLUE, columns[3]), ("measured - calibrated", ORANGE, columns[4])
    for n, (axis, values) in enumerate(zip(axes, columns[:3], strict=True), start=1):
        for label, color, gap in gaps:
            middle, size = _by_parts(values, factor * gap)
            figure.add_scatter(
                x=middle, y=size, name=label, legendgroup=label, showlegend=n == 1,
                mode="lines+markers", marker={"size": 4}, line={"color": color, "width": 1.6},
                row=1, col=n,
            )  # fmt: skip
        figure.update_xaxes(title_text=axis, row=1, col=n)
    figure.update_yaxes(title_text=f"RMS, {unit}", rangemode="tozero", row=1, col=1)
    return styled(figure, 360)


def _beside(
    report: CalibrationReport,
) -> Iterator[tuple[Recording, dict[str, tuple[str, str]], dict[str, tuple[np.ndarray, ...]]]]:
    """Yield a recording of each command with captions and, by channel, (S,) arrays in SI.

    The arrays are measured, and answers of the reference, or only model, before and after.
    """
    basis = report.basis
    if basis is None or not basis.nuisances:
        raise InputError("This calibration keeps no recordings that a twin was fitted to.")
    model = model_of(report.actuator)
    known: list[Recording] = []
    for recording, nuisances in zip(basis.recordings, basis.nuisances, strict=True):
        if any(same_command(recording, other, model.command) for other in known):
            continue
        if len(known) == 3:
            return  # more make the page no clearer
        known.append(recording)
        answers = []
        for actuator, values in ((basis.template, {}), (report.actuator, dict(nuisances))):
            comparison = model.compare(recording, actuator)
            answer = comparison.exact(values)
            if answer is None:
                found = comparison.responses(one_candidate(values), 1)
                answer = {name: trace[0] for name, trace in found.items()}
            answers.append(answer)
        measured = comparison.measured().items()
        shown = {name: (x, *(one[name] for one in answers)) for name, x in measured}
        yield recording, comparison.captions(), shown


def _motion(model: Model, recording: Recording) -> tuple[np.ndarray, str, np.ndarray, str]:
    """The recorded position nearest to the motor, else the command; its name; speed, its unit."""
    there = (one for one in model.channels if one.name in recording.channels)
    places = [x.name for x in there if x.unit in ("rad", "m") and x.name != model.command]
    name = next((name for name in places if "motor" in name), next(iter(places), model.command))
    unit, factor = preferred(model.channel(name).unit)
    place = recording.channels[name]
    speed = factor * np.gradient(place, recording.time)
    if "motor" in name and model.channel(name).unit == "rad":
        return place / (2.0 * np.pi) % 1.0, "motor angle, turns", speed, f"{unit}/s"
    return factor * place, f"{name.replace('_', ' ')}, {unit}", speed, f"{unit}/s"


def _by_parts(values: np.ndarray, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of equal parts of the range of values (N,), and RMS of a gap (N,); NaN of a few."""
    counts, edges = np.histogram(values, _PARTS)
    squares, _ = np.histogram(values, edges, weights=gap**2)
    kept = counts > max(3, 0.1 * values.size / _PARTS)
    sizes = np.sqrt(squares / np.maximum(counts, 1))
    return 0.5 * (edges[1:] + edges[:-1]), np.where(kept, sizes, np.nan)
