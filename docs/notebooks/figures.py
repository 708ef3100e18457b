"""Figures of notebooks as these pages show them: the script that draws them comes with the site."""

import re
from typing import Any

from plotly.io import renderers, to_html
from plotly.io.base_renderers import MimetypeRenderer

_CONFIG = {"displayModeBar": False, "responsive": True}  # buttons would cover a phone's figures


class Page(MimetypeRenderer):
    """HTML of a figure that is drawn when the page and its scripts are there."""

    def to_mimebundle(self, fig_dict: dict[str, Any]) -> dict[str, str]:
        """The figure as HTML without plotly's script."""
        html = to_html(fig_dict, _CONFIG, include_plotlyjs=False, full_html=False)
        return {"text/html": re.sub("<script[^>]*>", '<script type="module">', html)}


renderers["page"] = Page()
renderers.default = "page"
