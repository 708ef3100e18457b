"""Page: a calibration. The shell shows its table and sentences."""

import math
import shlex
from itertools import islice

from ematwin.estimation.constants import COVERAGE
from ematwin.models.registry import model_of
from ematwin.monitoring.calibration import CalibrationReport
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.plots.calibration import plot_before_and_after, plot_learnt, plot_residuals
from ematwin.report.page import Row, Section, Table, render
from ematwin.showing.text import in_unit, number_of, plain, said_between


def calibration_page(report: CalibrationReport) -> str:
    """HTML page: parameters beside their template, undetermined ones, spread of healthy runs."""
    actuator = report.actuator
    told = [p for p in report.parameters if p.determined]
    lead = (
        f"{actuator.name}: {len(told)} parameters from {report.baseline.recordings} healthy "
        f"recordings. {misfit_sentence(report)}"
    )
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
    return [
        Section("Before and after", beside, figure=plot_before_and_after(report)),
        Section("Residuals by angle, speed and time", by_parts, figure=plot_residuals(report)),
    ]


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
    said = [
        f"Only ratios or products of {', '.join(group)} are known; a common factor stays uncertain."
        for group in report.tied
    ]
    if missing:
        learn = f"ematwin design --learn --actuator {shlex.quote(file)} --out test.toml"
        tests = "" if model_of(report.actuator).recordings_differ else f" Tests that would: {learn}"
        within = "they stay within the tolerances of the template."
        said.insert(0, f"These recordings do not determine {', '.join(missing)}: {within}{tests}")
    return [*said, f"Not fitted: {', '.join(fixed)}."]


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
        return [
            "Healthy recordings are found off healthy by more than their standard errors explain: "
            f"{', '.join(off)} (one standard deviation)."
        ]
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
