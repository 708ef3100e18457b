"""Pages of a fleet: all actuators by urgency, and the history of one. Each is one file."""

from collections import Counter
from dataclasses import replace
from functools import cache
from html import escape
from importlib import resources
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from ematwin.fleet.actuator import ENTRIES, FleetActuator
from ematwin.fleet.alarms import Alarm, by_urgency
from ematwin.fleet.fleet import Fleet
from ematwin.fleet.life import LEVEL, paths, spoken
from ematwin.fleet.store import moment_at, years
from ematwin.quantities import preferred
from ematwin.report.page import Row, Section, Table, render
from ematwin.report.style import AMBER, BLUE, GREEN, GREY, ORANGE
from ematwin.showing.text import capital

_COLORS = {"act": ORANGE, "plan": AMBER, "watch": BLUE, "none": GREEN}
_ADVICE = {
    "act": "act now", "plan": "plan maintenance", "watch": "watch", "none": "nothing to do",
}  # fmt: skip
_AHEAD = 1.0  # years of forecast that are drawn
_RECORDINGS = 200  # in the table of an actuator; the export has all


def fleet_page(fleet: Fleet, link: str = "#{serial}") -> str:
    """HTML page: a row for each actuator, the most urgent first, and its history below.

    ``link`` is the address of an actuator's page; by default its place on this one.
    """
    table = fleet.table()
    count = Counter(row["advisory"] for row in table)
    asks = [f"{_ADVICE[step]}: {count[step]}" for step in ("act", "plan", "watch") if count[step]]
    lead = (
        f"{len(table)} actuators; {', '.join(asks) or 'nothing to do'}. As of "
        f"{fleet.now:%Y-%m-%d}; life left is counted from then."
    )
    header = ["actuator", "what to do", "life left", "trend", "why", "last recording"]
    rows = [_row(fleet[row["serial_number"]], row, link) for row in table]
    sections = [Section("Actuators", table=Table(header, rows, texts=(1, 2, 4, 5)))]
    if link.startswith("#"):
        sections += [_history(fleet[row["serial_number"]], row["advisory"]) for row in table]
    aside = [Row([str(r["source"]), str(r["reason"])]) for r in fleet.set_aside[-_RECORDINGS:]]
    sections += [
        Section("Set aside", table=Table(["recording", "why"], aside, texts=(0, 1))),
        Section("How it is judged", facts=_rules(fleet)),
    ]
    grade = "fault" if count["act"] else "changed" if count["plan"] else "healthy"
    return render("Fleet", lead, sections, grade=grade)


def actuator_page(unit: FleetActuator) -> str:
    """HTML page: every magnitude over time, what happened, and the recordings."""
    row, alarms, life = unit.row(), by_urgency(unit.alarms()), unit.life_left()
    why = row["advisory_reason"] or "No magnitude is larger than matters."
    left = "no limit is stated" if life is None else str(life)
    lead = f"{unit.serial_number}: {_ADVICE[row['advisory']]}. {capital(why)} Life left: {left}."
    events = history(unit)
    known = [
        Row([f"{one['time']:%Y-%m-%d %H:%M}", one["grade"], one["sentence"] or one["reason"],
             one["source"]], marked=one["grade"] == "fault")
        for one in reversed(unit.rows[-_RECORDINGS:])
    ]  # fmt: skip
    drawn = [panel(unit, one, wide=True) for one in alarms]
    required = {}
    if requirement := unit.fleet.requirement:
        required = {requirement.measure: str(unit.life_left(requirement=requirement))}
    rows = [Row([_whole(day), *rest]) for day, *rest in (one.cells for one in events.rows)]
    header = ["recorded", "verdict", "because", "file"]
    sections = [
        Section("History", text=_LEGEND, svg="".join(drawn)),
        Section("Until it no longer does its job", facts=required),
        Section("Events", table=replace(events, rows=rows)),
        Section("Recordings", table=Table(header, known, texts=(1, 2, 3))),
    ]
    grade = {"act": "fault", "none": "healthy"}.get(row["advisory"], "changed")
    return render(unit.serial_number, lead, sections, grade=grade)


_LEGEND = (
    "Points: estimates; crosses: outliers. Line and band: level with 95 % interval; after the day "
    "of this page the forecast with its 80 % interval. Dashed: limit. Vertical: overhaul (solid), "
    "jump (dotted)."
)


def _row(unit: FleetActuator, row: dict[str, Any], link: str) -> Row:
    name = escape(unit.serial_number)
    address = escape(link.format(serial=quote(unit.serial_number, safe="")))
    advised = _ADVICE[row["advisory"]] + (" (acknowledged)" if row["acknowledged"] else "")
    color = _COLORS[row["advisory"]]
    advice = f'<span><span style="color:{color}">●</span> {advised}</span>'
    spark = _spark(unit, row["health_magnitude"], color)
    return Row(
        [Markup(f'<a href="{address}">{name}</a>'), Markup(advice),
         _shares(str(unit.life_left() or "")), Markup(spark),
         _shares(capital(row["advisory_reason"])), _whole(row["last_recording"][:10])],
        marked=row["advisory"] == "act",
    )  # fmt: skip


def _whole(day: str) -> Markup:
    """A day that stays on one line."""
    return Markup('<span style="white-space:nowrap">{}</span>').format(day)


def _shares(text: str) -> str:
    """A text whose numbers keep their % on one line."""
    return text.replace(" %", "\N{NO-BREAK SPACE}%")


def _spark(unit: FleetActuator, name: str, color: str) -> str:
    """The smoothed level of the magnitude that matters most, as wide as a word or two."""
    if not name:
        return ""
    one, limit = unit.trend(name), unit.limit(name)
    x, y = _thinned(one.series.time, one.level, 40)
    healthy = unit.unknown(name).healthy
    ends = [healthy, *y, *([] if limit is None else [limit])]
    low, high = min(ends), max(ends)
    points = " ".join(
        f"{100 * (a - x[0]) / max(x[-1] - x[0], 1e-9):.0f},"
        f"{22 - 20 * (b - low) / max(high - low, 1e-12):.1f}"
        for a, b in zip(x, y, strict=True)
    )
    top = 22 - 20 * ((limit if limit is not None else high) - low) / max(high - low, 1e-12)
    return (
        f'<svg width="100" height="24" role="img" aria-label="{escape(name)} over time">'
        f'<path d="M0,{top:.1f}h100" stroke="{GREY}" stroke-dasharray="2 3"/>'
        f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.6"/></svg>'
    )


def _history(unit: FleetActuator, advice: str) -> Section:
    """The magnitudes of an actuator that are alarmed, or the one furthest from healthy."""
    alarms = by_urgency(unit.alarms())
    shown = [one for one in alarms if one.step != "none"][:3] or alarms[:1]
    panels = "".join(panel(unit, one) for one in shown)
    mark = f'<a id="{escape(unit.serial_number)}" style="scroll-margin-top:5rem"></a>'
    return Section(f"{unit.serial_number}: {_ADVICE[advice]}", svg=f"{mark}{panels}")


def panel(unit: FleetActuator, alarm: Alarm, wide: bool = False) -> str:
    """A magnitude over time with its forecast, as an SVG of physical values."""
    name, now = alarm.magnitude, years(unit.fleet.now)
    one, limit, unknown = unit.trend(name), unit.limit(name), unit.unknown(name)
    limits = [] if limit is None else [limit]
    width, height = (460, 200) if wide else (340, 170)
    left, right, top, bottom = 8, width - 8, 26, height - 20
    actuator, series = unit.twin.actuator, one.series
    unit_said, factor = preferred(unknown.physical_value(actuator, unknown.healthy).unit)
    begin, end = float(series.time[0]), now + _AHEAD
    known = np.setdiff1d(np.arange(series.time.size), one.outliers)
    ahead, level, _ = paths(
        one, now, unit.fleet.process(unit.kind, name), horizon=_AHEAD, draws=200
    )  # fmt: skip
    every = slice(None, None, 6)  # of 60, to the last
    share = 0.5 - LEVEL / 2.0
    forecast = np.quantile(level[:, every], [share, 0.5, 1.0 - share], axis=0)
    values = [unknown.healthy, *series.value[known], *forecast.ravel(), *limits]
    least, most = min(values), max(values)

    def physical(value: float) -> float:
        clipped = float(np.clip(value, unknown.lower, unknown.upper))
        return factor * unknown.physical_value(actuator, clipped).value

    low, high = sorted((physical(least), physical(most)))

    def x(time: float) -> str:
        return f"{left + (right - left) * (time - begin) / max(end - begin, 1e-9):.0f}"

    def y(value: float) -> str:
        return f"{bottom - (bottom - top) * (physical(value) - low) / max(high - low, 1e-12):.0f}"

    def points(times: Any, levels: Any) -> list[tuple[str, str]]:
        return [(x(t), y(v)) for t, v in zip(times, levels, strict=True)]

    def curve(times: Any, lower: Any, middle: Any, upper: Any) -> Any:
        """The outline of a band, and the line in it."""
        return points([*times, *times[::-1]], [*upper, *lower[::-1]]), points(times, middle)

    times, past = _thinned(series.time, one.level, 60)
    _, unsure = _thinned(series.time, np.hypot(one.level_error, one.constant_variance**0.5), 60)
    odd = list(one.outliers[-_RECORDINGS:])
    return _drawing().render(
        width=width, height=height, left=left, right=right, top=top, bottom=bottom,
        why=alarm.why, color=_COLORS[alarm.step],
        said=f"{name.replace('_', ' ')}, {low:.3g} to {high:.3g} {unit_said}".rstrip(),
        begin=f"{moment_at(begin):%Y-%m}", end=f"{moment_at(end):%Y-%m}",
        estimates=points(*_thinned(series.time[known], series.value[known], 150)),
        outliers=points(series.time[odd], np.clip(series.value[odd], least, most)),
        curves=[
            curve(times, past - 1.96 * unsure, past, past + 1.96 * unsure),
            curve(now + ahead[every], *forecast),
        ],
        limits=map(y, limits), jumps=map(x, series.time[list(one.jumps)]),
        overhauls=[x(t) for t in series.overhauls if t >= begin],
        colors={"grey": GREY, "orange": ORANGE, "green": GREEN, "blue": BLUE},
    )  # fmt: skip


@cache
def _drawing() -> Any:
    """The template of a panel."""
    from jinja2 import Template

    text = resources.files("ematwin.fleet").joinpath("panel.svg.j2").read_text("utf-8")
    return Template(text, autoescape=True, trim_blocks=True, lstrip_blocks=True)


def _thinned(time: np.ndarray, value: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    kept = np.unique(np.linspace(0, time.size - 1, min(most, time.size)).astype(int))
    return time[kept], value[kept]


def history(unit: FleetActuator) -> Table:
    """What happened to an actuator, the latest first, with the entries that can be withdrawn."""
    by = {one["id"]: one for one in unit.history}
    held = {one["id"] for one in unit.events}
    rows = []
    for one in reversed(unit.history):
        entry = one["id"][:8] if one["what"] in ENTRIES else ""
        said = _told(one, by) + ("" if one["id"] in held else " \N{EM DASH} withdrawn")
        rows.append(Row([f"{one['time']:%Y-%m-%d}", said, entry]))
    return Table(["day", "what", "entry"], rows, texts=(1, 2))


def _told(event: dict[str, Any], by: dict[str, dict[str, Any]]) -> str:
    """An event in words; ``by`` has the others by their id."""
    if event["what"] == "alarm":
        return f"{_ADVICE[event['step']]}: {event.get('why', '')}"
    said, other = _brief(event), by.get(event.get("entry", ""))
    if other is not None:
        said += f" {_brief(other)} of {other['time']:%Y-%m-%d}"
    if event["known"].date() != event["time"].date():
        said += f", entered on {event['known']:%Y-%m-%d}"
    return said + (f" ({event['note']})" if event.get("note") else "")


def _brief(event: dict[str, Any]) -> str:
    until = f"until {event['until'][:10]}" if event["what"] == "silenced" else ""
    magnitude = event.get("magnitude", "").replace("_", " ")
    return " ".join(filter(None, (event["what"], magnitude, until)))


def _rules(fleet: Fleet) -> dict[str, str]:
    policy = fleet.policy
    late = f" after the next look, in {spoken(policy.look)}" if policy.look else ""
    limits = ", ".join(f"{name} {value}" for name, value in fleet.limits_given.items())
    return {
        "watch": "a magnitude is larger than matters; at most "
        f"{policy.false_alarms:g} false alarms per actuator and year",
        "plan": f"its limit may be passed within {spoken(policy.plan)}{late} (10 %)",
        "act": f"its limit may be passed within {spoken(policy.act)}{late} (10 %)",
        "limits": limits or "none stated: there is no life left (fleet.toml)",
        "since": min((f"{one.rows[0]['time']:%Y-%m-%d}" for one in fleet), default=""),
    }
