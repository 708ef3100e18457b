"""The check of the built pages finds what it looks for (docs/check_site.py)."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
from check_site import WIDTHS, check

PAGE = "<!doctype html><title>page</title><meta name=viewport content='width=device-width'>"


def test_a_wide_page_an_error_and_a_foreign_file_are_found(tmp_path: Path) -> None:
    site, pictures = tmp_path / "site", tmp_path / "pictures"
    site.mkdir()
    pictures.mkdir()
    for name, body in {
        "good": "<p>All is well.",
        "wide": "<div style='width: 800px'>wide",
        "wrong": "<script>nothing.here()</script>",
        "foreign": "<img src='http://127.0.0.1:9/x.png'>",
    }.items():
        (site / f"{name}.html").write_text(PAGE + body, encoding="utf-8")
    found = check(site, pictures)
    assert not [one for one in found if one.startswith("good")]
    assert len([one for one in found if one.startswith("wide")]) == 2  # not on a desk
    assert len([one for one in found if "nothing is not defined" in one]) == 1
    assert [one for one in found if one.startswith("foreign") and "127.0.0.1:9" in one]
    assert len(list(pictures.iterdir())) == 4 * len(WIDTHS)
