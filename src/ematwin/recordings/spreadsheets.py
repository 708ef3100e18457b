"""Texts in tables that a spreadsheet may open: none of them starts a formula.

A cell that begins with = + - @, a tab or a line break is computed by spreadsheets, whoever wrote it
(OWASP, "CSV injection"). An apostrophe before it makes it a text. Numbers stay numbers.
"""

import re

_FORMULA = re.compile(r"'*[=+\-@\t\r\n]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|-?(inf|nan)|-{1,3}")


def no_formula(text: str) -> str:
    """A text for a cell, with an apostrophe before it if a spreadsheet would compute it.

    Plain numbers such as ``-1.5`` are left as they are, and so are dashes alone, which stand for
    what is missing.
    """
    if _FORMULA.match(text) and not _NUMBER.fullmatch(text):
        return f"'{text}"
    return text


def without_apostrophe(text: str) -> str:
    """The text of which `no_formula` made a cell."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text
