"""Self-contained HTML pages: verdict, tables, facts and interactive figures in one file."""

from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Any

from ematwin import __version__


@dataclass(frozen=True)
class Row:
    """A row of a table; ``marked`` rows stand out."""

    cells: list[str]
    marked: bool = False

    @property
    def wrapped(self) -> list[str]:
        """Cells in which a value and its interval, "0.1 A (0 to 0.2)", may stand on two lines."""
        hard = "\N{NO-BREAK SPACE}"
        joined = (cell.replace(" ", hard).replace(f"{hard}(", " (") for cell in self.cells)
        return [new if " to " in old else old for old, new in zip(self.cells, joined, strict=True)]


@dataclass(frozen=True)
class Table:
    """A table; columns of text (``texts``, -1 the last) stand left and may be wrapped.

    ``pairs``: cells hold a value with its interval.
    """

    header: list[str]
    rows: list[Row]
    texts: tuple[int, ...] = ()
    pairs: bool = False

    def first(self, columns: int) -> "Table":
        """The table with so many of its columns, fewer than all, from the left."""
        rows = [Row(row.cells[:columns], row.marked) for row in self.rows]
        texts = tuple(n for n in self.texts if n >= 0)
        return replace(self, header=self.header[:columns], rows=rows, texts=texts)

    def is_text(self, column: int) -> bool:
        """Whether a column, counted from 0, holds text."""
        return column in self.texts or column - len(self.header) in self.texts


@dataclass(frozen=True)
class Section:
    """A part of a page; whatever is given is shown, in this order; one without content is not."""

    heading: str = ""
    text: str = ""
    points: list[str] = field(default_factory=list)
    table: Table | None = None
    facts: dict[str, str] = field(default_factory=dict)
    figure: Any = None  # plotly figure
    svg: str = ""  # a drawing, trusted: it goes into the page as it is

    @property
    def has_content(self) -> bool:
        """Whether there is anything to show: a text counts where it has no table."""
        rows = self.text if self.table is None else self.table.rows
        return bool(rows or self.points or self.facts or self.svg) or self.figure is not None


def render(
    title: str, lead: str, sections: list[Section], warnings: list[str] | None = None, *,
    grade: str = "",
) -> str:  # fmt: skip
    """The page as one HTML text.

    The ``lead`` is the answer in words, its first sentence large; ``warnings`` stand below it. A
    ``grade`` "healthy", "changed", "fault" or "none" gives it its colour.
    """
    import jinja2

    sections = [section for section in sections if section.has_content]
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    first, stop, rest = lead.partition(". ")
    has_figures = any(section.figure is not None for section in sections)
    return environment.from_string(_text("templates/page.html.j2")).render(
        title=title,
        lead=first + stop.rstrip(),
        rest=rest,
        grade=grade,
        sections=[
            # "<" is written otherwise: no tag of HTML ends the script that holds a figure
            vars(one) | {"figure": one.figure and one.figure.to_json().replace("<", "\\u003c")}
            for one in sections
        ],
        warnings=warnings or [],
        style=_text("templates/page.css"),
        script=_text("templates/page.js"),
        # draws points, lines and bars, which is all that our figures hold: a quarter of the whole
        plotly_js=_text("assets/plotly-basic-4.1.1.min.js") if has_figures else "",
        version=__version__,
    )


def _text(name: str) -> str:
    return resources.files("ematwin.report").joinpath(name).read_text("utf-8")


def listed(values: Any) -> str:
    """A mapping, a list or a plain value in words: ``command: Setpoint [deg]; load: Torque``."""
    if isinstance(values, dict):
        return "; ".join(f"{key}: {listed(value)}" for key, value in values.items())
    if isinstance(values, list | tuple):
        return "; ".join(listed(value) for value in values)
    if isinstance(values, float):
        return f"{values:.6g}"
    return "none" if values is None else str(values)


def columns_in_words(columns: dict[str, Any]) -> str:
    """Which channel of a file became which, from the provenance of a recording."""
    told = []
    for name, account in columns.items():
        rest = {k: v for k, v in account.items() if k not in ("channel", "unit", "unit_from")}
        more = "".join(f", {key} {value}" for key, value in rest.items())
        how = account.get("derived") or f"“{account['channel']}” in {account['unit']}{more}"
        told.append(f"{name}: {how}")
    return "; ".join(told)
