"""Self-contained HTML pages: headings, tables, facts and interactive figures in one file."""

from dataclasses import dataclass, field
from importlib import resources
from typing import Any

from ematwin import __version__


@dataclass(frozen=True)
class Row:
    """A row of a table; ``marked`` rows stand out."""

    cells: list[str]
    marked: bool = False


@dataclass(frozen=True)
class Table:
    """A table; columns of text (``texts``, ``last_is_text``) stand left and may be wrapped."""

    header: list[str]
    rows: list[Row]
    last_is_text: bool = False
    texts: tuple[int, ...] = ()

    def is_text(self, column: int) -> bool:
        """Whether a column, counted from 0, holds text."""
        return column in self.texts or (self.last_is_text and column == len(self.header) - 1)


@dataclass(frozen=True)
class Section:
    """A part of a page; whatever is given is shown, in this order."""

    heading: str = ""
    text: str = ""
    points: list[str] = field(default_factory=list)
    table: Table | None = None
    facts: dict[str, str] = field(default_factory=dict)
    figure: Any = None  # plotly figure
    svg: str = ""  # a drawing, trusted: it goes into the page as it is


def render(
    title: str, lead: str, sections: list[Section], warnings: list[str] | None = None
) -> str:
    """The page as one HTML text."""
    import jinja2
    from plotly.io import to_html
    from plotly.offline import get_plotlyjs

    source = resources.files("ematwin.report").joinpath("templates/page.html.j2").read_text("utf-8")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    shown = [
        {
            **vars(section),
            "figure": section.figure
            and to_html(
                section.figure,
                include_plotlyjs=False,
                full_html=False,
                config={"displaylogo": False, "responsive": True},
            ),
        }
        for section in sections
    ]
    return environment.from_string(source).render(
        title=title,
        lead=lead,
        sections=shown,
        warnings=warnings or [],
        plotly_js=get_plotlyjs() if any(section.figure for section in sections) else "",
        version=__version__,
    )
