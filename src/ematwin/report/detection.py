"""Verdicts on recordings: page, table, and the trend over runs with a colour for each fault."""

from collections.abc import Sequence
from itertools import cycle
from typing import Any

from ematwin.estimation.constants import CERTAIN, SMALLEST
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.detection import Detection, Diagnosis, counted, gathered_notes
from ematwin.monitoring.population_calibration import DRIFT, PopulationCalibration
from ematwin.quantities import preferred
from ematwin.report.page import Row, Section, Table, listed, render
from ematwin.report.style import AMBER, GREEN, GREY, SERIES, error_bars, stacked


def detection_page(found: Detection) -> str:
    """HTML page: trend of the magnitudes, table of verdicts, how healthy was learnt."""
    shown, parts = found.runs[:400], found.actuators  # of the table; the figures show all
    kind = "run" if found.by_run else "recording"
    told = f"A point for each {kind}, with its interval. In the band lie 95 % of healthy ones."
    trends = []
    for name, one in parts.items():
        text = f"{one.sentence} {told}" if name else told
        trends.append(Section(name or "Trend", text, figure=plot_trend(one)))
    reasons = {one.title: one.verdict.sentence for one in shown if one.grade != "healthy"}
    verdicts = Section(f"{kind.capitalize()}s", table=verdict_table(shown, kind))
    sections = [verdicts, Section("Why", facts=reasons)]
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
    rows, covariates = [], {}
    for one in verdicts:
        cells = {"actuator": one.actuator, what: one.name, "verdict": one.said}
        cells |= {m.name: str(m) for m in one.magnitudes}
        if one.standing is not None:
            cells["distance"] = f"{one.standing.distance:.2g}"
            if (known := one.standing.covariate) is not None:
                covariates[known.name] = cells[known.name] = str(known)
        rows.append(cells)
    left = ["actuator", what, "verdict"][0 if any(one.actuator for one in verdicts) else 1 :]
    far = ["distance"] if any("distance" in cells for cells in rows) else []
    header = [*left, *far, *magnitudes, *covariates]
    filled = [[cells.get(name, "") for name in header] for cells in rows]
    shown = [Row(cells, one.alarm) for cells, one in zip(filled, verdicts, strict=True)]
    return Table(header, shown, texts=tuple(range(1, len(left))), pairs=True)


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


_SYMBOLS = ("diamond", "square", "triangle-up", "cross", "x", "star", "pentagon", "hourglass")
_PLAIN = {
    "healthy": (GREEN, "circle"), "changed": (AMBER, "circle"),
    "no verdict": (GREY, "circle-open"),
}  # fmt: skip


def plot_trend(found: Detection, each: str = "run") -> Any:
    """Faults, or what else is reported, over runs, with healthy bands and intervals.

    Runs stand at the time of their recordings where all have one, else by their names in the
    order in which they were given. Faults are told apart by colour and symbol. The distance
    from healthy runs comes first where a healthy population judges. ``each`` is "run" (its
    recordings together) or "motion" (each recording).
    """
    rows = found.each(each)
    x, axis = _places(rows, each)
    looks, texts = _looks(found), [_hover(one) for one in rows]
    at = [one.standing for one in rows if one.standing is not None]
    shown = rows[0].magnitudes
    titles = ["Distance from healthy runs"] * bool(at)
    titles += [m.name.replace("_", " ").capitalize() for m in shown]
    units = [""] * bool(at)
    units += ["times healthy" if m.unit == "x" else preferred(m.unit)[0] for m in shown]
    figure = stacked(titles, units, "", 150 + 180 * len(titles))

    def marks(row: int, y: list[float], above: Sequence[float] = (), below: Any = ()) -> None:
        for name, (color, symbol) in looks.items():
            own = [n for n, verdict in enumerate(rows) if verdict.said == name]
            reach = ([side[n] for n in own] for side in (above, below))
            bars = error_bars(*reach, color=GREY, thickness=1) if above else None
            if own:
                figure.add_scatter(
                    x=[x[n] for n in own], y=[y[n] for n in own], mode="markers", name=name,
                    legendgroup=name, showlegend=row == 1, text=[texts[n] for n in own],
                    hoverinfo="text+y", marker={"color": color, "size": 8, "symbol": symbol},
                    error_y=bars, row=row, col=1,
                )  # fmt: skip

    if at:
        marks(1, [one.distance for one in at])
        figure.update_yaxes(rangemode="tozero", row=1, col=1)
    for row, one in enumerate(shown, start=1 + bool(at)):
        values = [next(m for m in v.magnitudes if m.name == one.name) for v in rows]
        factor = preferred(one.unit)[1]
        low, high = ([factor * m.healthy[end] for m in values] for end in (0, 1))
        figure.add_scatter(
            x=[*x, *reversed(x)], y=[*high, *reversed(low)], fill="toself", mode="lines",
            line={"width": 0}, fillcolor="rgba(0,158,115,0.15)", name="healthy band",
            legendgroup="band", showlegend=row == 1 + bool(at), hoverinfo="skip", row=row, col=1,
        )  # fmt: skip
        above = [factor * (m.high - m.value) for m in values]
        below = [factor * (m.value - m.low) for m in values]
        marks(row, [factor * m.value for m in values], above, below)
    figure.update_layout(hovermode="closest")
    figure.update_xaxes(row=len(titles), col=1, **axis)
    return figure


def _places(verdicts: Sequence[Diagnosis], each: str) -> tuple[list[Any], dict[str, Any]]:
    """Places of verdicts on the axis, and the layout of the axis: no more ticks than fit."""
    times = [verdict.when for verdict in verdicts]
    if all(times) and len(set(times)) == len(times):
        return [str(time) for time in times], {"type": "date"}
    names = [verdict.name.removeprefix(f"{each} ") for verdict in verdicts]
    places = list(range(1, len(names) + 1))
    ticks = places[:: -(-len(names) // 40)]
    shown = [names[n - 1] for n in ticks]
    texts = [name if len(name) <= 24 else f"{name[:11]}…{name[-11:]}" for name in shown]
    return places, {"tickvals": ticks, "ticktext": texts, "title_text": each}


def _looks(found: Detection) -> dict[str, tuple[str, str]]:
    """Colour and symbol of each verdict, different for each fault."""
    said = dict.fromkeys(verdict.said for verdict in (*found.runs, *found.motions))
    faults = [name for name in said if name not in _PLAIN]
    looks = zip(cycle(SERIES), cycle(_SYMBOLS), strict=False)
    return _PLAIN | dict(zip(faults, looks, strict=False))


def _hover(one: Diagnosis) -> str:
    covariate = None if one.standing is None else one.standing.covariate
    said = "" if covariate is None else f", {covariate.name} {covariate}"
    return f"{one.name}<br>{one.said}{said}"
