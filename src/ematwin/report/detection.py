"""Page: verdicts on recordings, value by value against the healthy band."""

from collections.abc import Sequence

from ematwin.estimation.constants import CERTAIN, SMALLEST
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.detection import Detection, Diagnosis, Standing, counted, gathered_notes
from ematwin.monitoring.population import DRIFT
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.plots.detection import plot_trend
from ematwin.report.page import Row, Section, Table, listed, render


def detection_page(found: Detection) -> str:
    """HTML page: trend of the magnitudes, table of verdicts, how healthy was learnt."""
    shown, parts = found.runs[:400], found.actuators  # of the table; the figures show all
    kind = "run" if found.by_run else "recording"
    told = f"A point for each {kind}, with its interval. In the band lie 95 % of healthy ones."
    trends = [
        Section(name or "Trend", text=f"{one.sentence} {told}" if name else told,
                figure=plot_trend(one))
        for name, one in parts.items()
    ]  # fmt: skip
    reasons = {one.title: one.verdict.sentence for one in shown if one.grade != "healthy"}
    sections = [
        Section(f"{kind.capitalize()}s", table=verdict_table(shown, kind)),
        Section("Why", facts=reasons),
    ]
    sections = [*sections, *trends] if found.is_named else [*trends, *sections]
    for name, one in parts.items():
        if one.by_run:
            text = f"Judged alone, {counted(one.motions, 'motions')}."
            title = f"{name} Each motion alone".strip()
            sections.append(Section(title, text=text, figure=plot_trend(one, "motion")))
    facts = {name: _facts(known) for name, known in found.calibrations.items()}
    title = "Condition of actuators"
    learnt = {name: listed(one) for name, one in facts.items()}
    if not found.is_named:
        title, learnt = f"{found.calibrations[''].actuator.name}: condition", facts[""]
    sections.append(Section("How healthy was learnt", facts=learnt))
    return render(title, found.sentence, sections, gathered_notes(found.runs), grade=found.grade)


def verdict_table(
    verdicts: Sequence[Diagnosis], what: str, magnitudes: Sequence[str] | None = None
) -> Table:
    """A row for each verdict on a recording, run or motion; None shows all magnitudes."""
    if magnitudes is None:
        magnitudes = list(dict.fromkeys(m.name for one in verdicts for m in one.magnitudes))
    at = [one.standing for one in verdicts if one.standing is not None]
    covariates = list(dict.fromkeys(s.covariate.name for s in at if s.covariate is not None))
    left = ["actuator"] if any(one.actuator for one in verdicts) else []
    left += [what, "verdict", *(["distance"] if at else [])]
    shown = [
        Row([*([one.actuator] if left[0] == "actuator" else []),
             *_cells(one, at, magnitudes, covariates)], marked=one.alarm)
        for one in verdicts
    ]  # fmt: skip
    texts = tuple(range(1, left.index("verdict") + 1))
    return Table([*left, *magnitudes, *covariates], shown, texts=texts, pairs=True)


def _cells(
    one: Diagnosis, at: Sequence[Standing], magnitudes: Sequence[str], covariates: Sequence[str]
) -> list[str]:
    own = one.standing
    cells = [one.name, one.said]
    if at:
        cells.append("" if own is None else f"{own.distance:.2g}")
    values = {m.name: str(m) for m in one.magnitudes}
    known = None if own is None else own.covariate
    beside = {} if known is None else {known.name: str(known)}
    return cells + [(values | beside).get(name, "") for name in (*magnitudes, *covariates)]


def _facts(calibration: Calibration) -> dict[str, str]:
    actuator = {"actuator": f"{calibration.actuator.name}: {calibration.actuator.description}"}
    if not isinstance(calibration, PopulationCalibration):
        return actuator | {
            "learnt from": f"{calibration.baseline.recordings} healthy recordings",
            "a fault": f"at least {100 * SMALLEST:g} % of its range from healthy, with a "
            f"probability of {100 * CERTAIN:g} %",
            "intervals": "95 %, over noise, the twin's own error, and parameters, load and sensors",
        }
    facts = calibration.facts
    return actuator | {
        "learnt from": f"runs {', '.join(calibration.healthy.names)} of "
        f"{', '.join(facts.get('sources', []))}",
        "an alarm": f"a change with a probability of {100 * CERTAIN:g} %",
        "distance": "from the healthy mean; healthy runs have about 1",
        "drift between occasions": "assumed: each fault and the level of each channel move by "
        f"{DRIFT:g} healthy deviation",
        "not determined": ", ".join(facts.get("undetermined", [])) or "nothing",
        "names": "; ".join(f"{s.fault} from {s.source}" for s in calibration.signatures)
        or "from physics alone: the quantity that a fault raises",
        "intervals": "95 %, from the scatter of healthy motions within and between runs",
    }
