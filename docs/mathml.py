"""Formulas as MathML, which browsers draw themselves: no script, nothing from elsewhere."""

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.errors import SphinxError
from sphinx.util.math import get_node_equation_number


def formula(latex: str, **options: str) -> str:
    """MathML of a formula.

    Raises
    ------
    SphinxError
        If something in it was not understood, which would stand there as it is.
    """
    found = convert(latex, **options)
    if "\\" in found:
        raise SphinxError(f"MathML has no form of all of this formula: {latex}")
    return found


def inline(translator: Any, node: nodes.math) -> None:
    """A formula within a line."""
    translator.body.append(formula(node.astext()))
    raise nodes.SkipNode


def block(translator: Any, node: nodes.math_block) -> None:
    """A formula on a line of its own, with its number if it has one."""
    number = get_node_equation_number(translator, node) if node["number"] else ""
    label = f'<span class="eqno">({number})</span>' if number else ""
    shown = formula(node.astext(), display="block")
    translator.body.append(f'<div class="math">{shown}{label}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register both as the way HTML shows formulas."""
    app.add_html_math_renderer(
        "mathml", inline_renderers=(inline, None), block_renderers=(block, None)
    )
    return {"parallel_read_safe": True}
