"""Tables as LaTeX (booktabs)."""

from ematwin.report.page import Table

_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "≤": r"$\leq$", "–": "--", "→": r"$\to$", "\n": " ",
}  # fmt: skip


def escape(text: str) -> str:
    """Text with LaTeX's special characters made harmless."""
    return "".join(_SPECIAL.get(character, character) for character in text)


def latex_table(table: Table, caption: str, label: str) -> str:
    """A floating table; marked rows are bold. Needs the package booktabs."""
    columns = "".join("l" if n == 0 or table.is_text(n) else "r" for n in range(len(table.header)))
    body = [_line(table.header, bold=False)]
    body.append(r"\midrule")
    body += [_line(row.cells, bold=row.marked) for row in table.rows]
    return "\n".join([
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{escape(caption)}}}",
        rf"\label{{{label}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        *body,
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
        "",
    ])  # fmt: skip


def _line(cells: list[str], *, bold: bool) -> str:
    texts = [escape(cell) for cell in cells]
    if bold:
        texts = [rf"\textbf{{{text}}}" for text in texts]
    return " & ".join(texts) + r" \\"
