"""Page: verdicts on recordings, value by value against the healthy band."""

from typing import Any

from ematwin.models.base import Reported
from ematwin.monitoring.detect import Detection, Verdict, counted, gathered_notes
from ematwin.monitoring.index import DRIFT
from ematwin.plots.style import BLUE, GREEN, GREY, ORANGE, stacked
from ematwin.report.page import Row, Section, Table, render

_NAMED_RUNS = 40  # of the trend; more names would overlap
_MOST_ROWS = 400  # of the table; the figures show all


def detection_page(found: Detection) -> str:
    """HTML page: trend of index and magnitudes, table of runs, how healthy was learnt."""
    calibration = found.calibration
    reported = calibration.model.reported(calibration.actuator)
    alarms = [verdict for verdict in found.runs if verdict.alarm]
    names: dict[str, int] = {}
    for verdict in alarms:
        names[verdict.fault] = names.get(verdict.fault, 0) + 1
    said = "; ".join(f"{fault} in {count}" for fault, count in names.items())
    lead = (
        f"{counted(found.runs, 'runs')}{': ' + said if said else ''}. Judged alone, "
        f"{counted(found.motions, 'motions')}."
    )
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
            figure=trend_figure(found.runs, reported),
        ),
        Section("Runs", table=verdict_table(found.runs[:_MOST_ROWS])),
        *([Section("Why", facts=reasons)] if reasons else []),
        Section("Each motion alone", figure=index_figure(found.motions)),
        Section("How healthy was learnt", facts=_facts(found)),
    ]
    notes = gathered_notes(found.runs)
    return render(f"{found.calibration.actuator.name}: condition", lead, sections, notes)


def trend_figure(verdicts: tuple[Verdict, ...], reported: tuple[Reported, ...]) -> Any:
    """Index and reported quantities over the runs."""
    titles = ["Health index", *(one.name.replace("_", " ").capitalize() for one in reported)]
    units = ["", *("times healthy" if one.logarithmic else one.unit for one in reported)]
    figure = stacked(titles, units, "run", 170 + 190 * len(titles))
    x = list(range(1, len(verdicts) + 1))
    texts = [_hover(verdict) for verdict in verdicts]
    _marks(figure, 1, x, [v.index for v in verdicts], verdicts, texts)
    _limits(figure, x, verdicts)
    for row, one in enumerate(reported, start=2):
        values = [next(m for m in v.magnitudes if m.name == one.name) for v in verdicts]
        _band(figure, row, x, [m.healthy[0] for m in values], [m.healthy[1] for m in values])
        bars = {
            "type": "data", "symmetric": False, "color": GREY, "thickness": 1,
            "array": [m.high - m.value for m in values],
            "arrayminus": [m.value - m.low for m in values],
        }  # fmt: skip
        _marks(figure, row, x, [m.value for m in values], verdicts, texts, bars)
    figure.update_layout(hovermode="closest")
    figure.update_yaxes(rangemode="tozero", row=1, col=1)
    if len(verdicts) <= _NAMED_RUNS:
        names = [verdict.name.removeprefix("run ") for verdict in verdicts]
        figure.update_xaxes(tickvals=x, ticktext=names, row=len(titles), col=1)
    return figure


def index_figure(verdicts: tuple[Verdict, ...]) -> Any:
    """Index of each motion."""
    figure = stacked(["Health index of each motion"], [""], "motion", 340)
    x = list(range(1, len(verdicts) + 1))
    _marks(figure, 1, x, [v.index for v in verdicts], verdicts, [_hover(v) for v in verdicts])
    _limits(figure, x, verdicts)
    figure.update_layout(hovermode="closest")
    return figure


def _limits(figure: Any, x: list[int], verdicts: tuple[Verdict, ...]) -> None:
    for name, dash, values in (
        ("healthy up to here", "dash", [v.threshold for v in verdicts]),
        ("may drift up to here", "dot", [v.clear for v in verdicts]),
    ):
        figure.add_scatter(
            x=x, y=values, mode="lines", name=name, hoverinfo="skip", row=1, col=1,
            line={"color": GREY, "dash": dash, "width": 1.2},
        )  # fmt: skip


def _marks(
    figure: Any,
    row: int,
    x: list[int],
    y: list[float],
    verdicts: tuple[Verdict, ...],
    texts: list[str],
    bars: dict[str, Any] | None = None,
) -> None:
    of = ["alarm" if v.alarm else v.said for v in verdicts]
    for name, color in (
        ("healthy", BLUE), ("changed", GREEN), ("no verdict", GREY), ("alarm", ORANGE),
    ):  # fmt: skip
        members = [n for n, said in enumerate(of) if said == name]
        if not members:
            continue
        own = bars and {
            key: [value[n] for n in members] if isinstance(value, list) else value
            for key, value in bars.items()
        }
        figure.add_scatter(
            x=[x[n] for n in members], y=[y[n] for n in members], mode="markers", name=name,
            legendgroup=name, showlegend=row == 1, text=[texts[n] for n in members],
            hoverinfo="text+y", marker={"color": color, "size": 6}, error_y=own, row=row, col=1,
        )  # fmt: skip


def _band(figure: Any, row: int, x: list[int], low: list[float], high: list[float]) -> None:
    figure.add_scatter(
        x=[*x, *reversed(x)], y=[*high, *reversed(low)], fill="toself", mode="lines",
        line={"width": 0}, fillcolor="rgba(0,114,178,0.15)", name="healthy band",
        legendgroup="band", showlegend=row == 2, hoverinfo="skip", row=row, col=1,
    )  # fmt: skip


def _hover(verdict: Verdict) -> str:
    one = verdict.covariate
    return f"{verdict.name}<br>{verdict.said}" + ("" if one is None else f", {one.name} {one}")


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
    return Table(header, rows)


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
