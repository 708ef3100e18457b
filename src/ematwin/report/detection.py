"""Page: verdicts on recordings, value by value against the healthy band."""

from ematwin.monitoring.detect import Detection, Verdict, counted, gathered_notes
from ematwin.monitoring.index import DRIFT
from ematwin.plots.detection import plot_index, plot_trend
from ematwin.report.page import Row, Section, Table, render

_MOST_ROWS = 400  # of the table; the figures show all


def detection_page(found: Detection) -> str:
    """HTML page: trend of index and magnitudes, table of runs, how healthy was learnt."""
    reasons = {
        v.name: f"{v.said}. {v.reason}" for v in found.runs[:_MOST_ROWS] if v.grade != "healthy"
    }
    sections = [
        Section(
            "Trend",
            text="A point for each run, its motions together. The band is where 95 % of healthy "
            "runs lie; bars are the same spread around the value. Above the dashed line a run has "
            "changed; an alarm is a fault that can be named, or an index above the dotted line, "
            "which no drift between occasions explains.",
            figure=plot_trend(found),
        ),
        Section("Runs", table=verdict_table(found.runs[:_MOST_ROWS])),
        *([Section("Why", facts=reasons)] if reasons else []),
        Section(
            "Each motion alone",
            text=f"Judged alone, {counted(found.motions, 'motions')}.",
            figure=plot_index(found),
        ),
        Section("How healthy was learnt", facts=_facts(found)),
    ]
    notes = gathered_notes(found.runs)
    title = f"{found.calibration.actuator.name}: condition"
    return render(title, found.sentence, sections, notes, grade=found.grade)


def verdict_table(verdicts: tuple[Verdict, ...]) -> Table:
    """A row for each verdict."""
    first = verdicts[0]
    header = ["run", "verdict", "index / limit"]
    header += [f"{m.name}, {m.unit}" if m.unit not in ("", "x") else m.name
               for m in first.magnitudes]  # fmt: skip
    header += [] if first.covariate is None else [first.covariate.name]
    rows = []
    for verdict in verdicts:
        by = f" (by {verdict.named_by})" if verdict.named_by else ""
        cells = [
            verdict.name,
            f"{verdict.said}{by}",
            f"{verdict.index:.2f} / {verdict.threshold:.2f}",
        ]
        for m in verdict.magnitudes:
            cells.append(f"{m.value:.2f} ({m.low:.2f}–{m.high:.2f})")
        if verdict.covariate is not None:
            cells.append(str(verdict.covariate))
        rows.append(Row(cells, marked=verdict.alarm))
    return Table(header, rows, texts=(1,))


def _facts(found: Detection) -> dict[str, str]:
    calibration = found.calibration
    facts = calibration.facts
    limits = calibration.thresholds
    held_back = facts.get("held_back", [])
    back = f"runs {', '.join(held_back)}" if held_back else "each run, judged by the others"
    return {
        "actuator": f"{calibration.actuator.name}: {calibration.actuator.description}",
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
