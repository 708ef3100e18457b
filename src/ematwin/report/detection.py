"""Page: verdicts on recordings, value by value against the healthy band."""

from ematwin.estimation.constants import CERTAIN, SMALLEST
from ematwin.monitoring.diagnosis import Detection, Diagnosis, counted, gathered_notes
from ematwin.monitoring.index import DRIFT
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.monitoring.runs import Detections
from ematwin.plots.detection import plot_trend
from ematwin.report.page import Row, Section, Table, listed, render

_MOST_ROWS = 400  # of the table; the figures show all


def detection_page(found: Detection) -> str:
    """HTML page: trend of the magnitudes, table of verdicts, how healthy was learnt."""
    shown = found.runs[:_MOST_ROWS]
    kind = "run" if found.by_run else "recording"
    reasons = {one.name: one.verdict.sentence for one in shown if one.grade != "healthy"}
    told = f"A point for each {kind}, with its interval. In the band lie 95 % of healthy ones."
    if found.by_run:
        told += (
            " Above the dashed line a run has changed; an alarm is a fault that can be named, or "
            "an index above the dotted line, which no drift between occasions explains."
        )
    sections = [
        Section("Trend", text=told, figure=plot_trend(found)),
        Section(f"{kind.capitalize()}s", table=verdict_table(shown)),
        *([Section("Why", facts=reasons)] if reasons else []),
    ]
    if found.by_run:
        text = f"Judged alone, {counted(found.motions, 'motions')}."
        figure = plot_trend(found, "motion")
        sections.append(Section("Each motion alone", text=text, figure=figure))
    sections.append(Section("How healthy was learnt", facts=_facts(found)))
    notes = gathered_notes(found.runs)
    title = f"{found.calibration.actuator.name}: condition"
    return render(title, found.sentence, sections, notes, grade=found.grade)


def detections_page(found: Detections) -> str:
    """HTML page on several actuators: a table of all verdicts, then the trend of each."""
    every = [(name, row) for name, one in found.actuators.items() for row in one.runs]
    rows = [
        Row([name, row.name, row.said, row.verdict.sentence], marked=row.alarm)
        for name, row in every[:_MOST_ROWS]
    ]
    header = ["actuator", "recording", "verdict", "in words"]
    sections = [Section("Verdicts", table=Table(header, rows, last_is_text=True, texts=(2,)))]
    for name, one in found.actuators.items():
        text = f"{one.sentence} In the bands lie 95 % of healthy recordings."
        sections.append(Section(name, text=text, figure=plot_trend(one)))
    learnt = {name: listed(_facts(one)) for name, one in found.actuators.items()}
    sections.append(Section("How healthy was learnt", facts=learnt))
    notes = gathered_notes(found.runs)
    return render("Condition of actuators", found.sentence, sections, notes, grade=found.grade)


def verdict_table(rows: tuple[Diagnosis, ...]) -> Table:
    """A row for each verdict."""
    first = rows[0]
    header = ["recording" if first.standing is None else "run", "verdict"]
    if first.standing is not None:
        header.append("index / limit")
    header += [m.name for m in first.magnitudes]
    covariate = None if first.standing is None else first.standing.covariate
    header += [] if covariate is None else [covariate.name]
    return Table(header, [_cells(one) for one in rows], texts=(1,), pairs=True)


def _cells(one: Diagnosis) -> Row:
    at = one.standing
    by = f" (by {at.named_by})" if at is not None and at.named_by else ""
    cells = [one.name, f"{one.said}{by}"]
    if at is not None:
        cells.append(f"{at.index:.2f} / {at.threshold:.2f}")
    cells += [str(m) for m in one.magnitudes]
    if at is not None and at.covariate is not None:
        cells.append(str(at.covariate))
    return Row(cells, marked=one.alarm)


def _facts(found: Detection) -> dict[str, str]:
    calibration = found.calibration
    actuator = {"actuator": f"{calibration.actuator.name}: {calibration.actuator.description}"}
    if not isinstance(calibration, PopulationCalibration):
        return actuator | {
            "learnt from": f"{calibration.baseline.recordings} healthy recordings",
            "a fault": f"at least {100 * SMALLEST:g} % of its range from healthy, with a "
            f"probability of {100 * CERTAIN:g} %",
            "intervals": "95 %, over noise, the twin's own error, and parameters, load and sensors",
        }
    facts, limits = calibration.facts, calibration.thresholds
    held_back = facts.get("held_back", [])
    back = f"runs {', '.join(held_back)}" if held_back else "each run, judged by the others"
    return actuator | {
        "learnt from": f"runs {', '.join(facts.get('runs', []))} of "
        f"{', '.join(facts.get('sources', []))}",
        "threshold from": f"{back}: a healthy run of another "
        f"day exceeds it with a probability of {100.0 * limits.false_alarm_rate:g} %",
        "drift between occasions": "assumed: one magnitude and the level of one channel may move "
        f"together by {DRIFT:g} healthy deviations before a change without a name is an alarm",
        "not determined": ", ".join(facts.get("undetermined", [])) or "nothing",
        "names": "; ".join(f"{s.fault} from {s.source}" for s in calibration.signatures)
        or "from physics alone: the quantity furthest outside its healthy spread",
        "intervals": "95 %, from the scatter of healthy motions within and between runs",
    }
