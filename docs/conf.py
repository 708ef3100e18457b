"""Sphinx: MyST pages, pydata theme; built with -W."""

import os
import sys
from importlib import resources
from pathlib import Path

from ematwin import __version__

_HERE = Path(__file__).parent
_PLOTLY = next(resources.files("ematwin.report").joinpath("assets").glob("plotly-*.js"))
sys.path.insert(0, str(_HERE))  # mathml.py
# Notebooks, as `ematwin` does: matrices are small, and threads wait for one another over them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# figures.py, for notebooks, which run in folders of their own
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(_HERE / "notebooks"), *filter(None, [os.environ.get("PYTHONPATH")])]
)

project = "ematwin"
language = "en"
author = "The ematwin founders"
copyright = author  # the name is Sphinx's
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
]
myst_enable_extensions = ["dollarmath", "amsmath"]
html_math_renderer = "mathml"
myst_heading_anchors = 3
nb_execution_mode = "cache"  # once for each change of a notebook; anew in a fresh clone
nb_execution_raise_on_error = True
nb_execution_timeout = 900  # a machine may be busy with tests
nb_execution_in_temp = True
nb_merge_streams = True
exclude_patterns = ["_build"]

default_role = "py:obj"
autodoc_typehints = "none"  # the docstrings give types, shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

html_static_path = [
    "_static",
    str(resources.files("ziamath") / "fonts" / "STIXTwoMath-Regular.ttf"),
    str(_PLOTLY),
]
html_css_files = ["style.css"]
html_theme = "furo"
html_title = f"ematwin {release}"
html_show_sourcelink = False
if repository := os.environ.get("DOCS_REPOSITORY"):  # where the pages may be edited, if anywhere
    html_theme_options = {
        "source_repository": repository,
        "source_branch": "main",
        "source_directory": "docs/",
    }


def one_line_fields(app, what, name, obj, options, lines):  # type: ignore[no-untyped-def]
    """Give napoleon a name and its whole meaning: it would cut it at the end of the line."""
    section, found = "", []
    for n, line in enumerate(lines):
        if n + 1 < len(lines) and lines[n + 1] and not lines[n + 1].strip("-"):
            section = line
        if section in ("Parameters", "Attributes") and line[:1].strip() and " : " in line:
            names, meaning = line.split(" : ", 1)
            found += [names, f"    {meaning}"]
        else:
            found.append(line)
    lines[:] = found


def with_plotly(app, pagename, templatename, context, doctree):  # type: ignore[no-untyped-def]
    """Load the script of figures where there are some."""
    if pagename == "gallery":
        app.add_js_file("gallery.js")
    if pagename in ("gallery", "your-own-model") or pagename.startswith("notebooks/"):
        app.add_js_file(_PLOTLY.name)


def setup(app):  # type: ignore[no-untyped-def]
    """Before napoleon, whose priority is 500."""
    app.connect("autodoc-process-docstring", one_line_fields, priority=400)
    app.connect("html-page-context", with_plotly)
