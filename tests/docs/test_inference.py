"""The page on inference has the numbers of the code."""

import re
from pathlib import Path

from ematwin.estimation import constants

PAGE = Path(__file__).parents[2] / "docs" / "inference.md"


def test_its_table_is_that_of_the_code() -> None:
    rows = re.findall(r"^\| ([A-Z_]+) \| ([\d.]+) \|", PAGE.read_text("utf-8"), re.MULTILINE)
    shown = {name: float(value) for name, value in rows}
    assert shown == {name: x for name, x in vars(constants).items() if name.isupper()}
