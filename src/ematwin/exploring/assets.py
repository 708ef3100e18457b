"""The files that a page is made of; a notebook's widget takes the same script and style.

uPlot (github.com/leeoniya/uPlot, MIT, see uPlot.LICENSE) draws the traces. It is part of the
script, so that neither the page nor the widget loads anything from elsewhere.
"""

from importlib import resources


def script() -> str:
    """The module that draws the explorer: ``export default { render }``, as anywidget has it."""
    return f"{_text('uPlot.js')}\n{_text('explore.js')}"


def style() -> str:
    """Its style sheet."""
    return f"{_text('uPlot.css')}\n{_text('explore.css')}"


def page() -> str:
    """The document of the local page."""
    return _text("page.html")


def start() -> str:
    """The module of the local page that joins the explorer to its server."""
    return _text("page.js")


def _text(name: str) -> str:
    return resources.files("ematwin.exploring").joinpath("page", name).read_text("utf-8")
