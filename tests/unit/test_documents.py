"""README, docs and examples: examples run, what is linked is there. tests/docs runs blocks."""

import re
import tomllib
from importlib.metadata import metadata
from pathlib import Path

import pytest

from commands import script
from ematwin import plots

PROJECT = Path(__file__).parents[2]
PAGES = [PROJECT / "README.md", *sorted((PROJECT / "docs").rglob("*.md"))]


def blocks(path: Path, language: str) -> list[str]:
    text = path.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("path", sorted((PROJECT / "examples").glob("*.py")), ids=lambda p: p.name)
def test_an_example_runs_in_an_empty_folder(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = script(path)
    assert done.code == 0, done.err
    assert done.out


def test_every_link_between_pages_leads_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} -> {target}"


def test_the_page_of_a_package_index_leads_nowhere_that_is_not_there():
    told = metadata("ematwin")
    text = told["Description"]
    assert told["Description-Content-Type"] == "text/markdown"
    assert text.startswith("# ematwin")
    assert "identifiability`, `design` | which faults a test command reveals" in text
    targets = re.findall(r"\]\(([^)]*)\)", text)
    assert targets
    assert all(target.startswith("https://") for target in targets), targets


def test_every_page_is_in_the_table_of_contents():
    contents = "".join(blocks(PROJECT / "docs" / "index.md", r"\{toctree\}"))
    listed = re.findall(r"^([\w/-]+)$", contents, re.MULTILINE)
    docs = PROJECT / "docs"
    pages = {str(path.relative_to(docs).with_suffix("")) for path in docs.rglob("*.md")} - {"index"}
    assert pages == set(listed)


def test_the_gallery_shows_every_figure():
    code = "".join(blocks(PROJECT / "docs" / "gallery.md", r"\{code-cell\} ipython3"))
    missing = [name for name in plots.__all__ if f"plots.{name}(" not in code]
    assert not missing, f"docs/gallery.md does not show {', '.join(missing)}"


def test_the_readme_gives_install_and_tests_as_its_two_commands():
    install, test = blocks(PROJECT / "README.md", "sh")
    assert install.endswith("ematwin demo\n")
    assert test.endswith("pytest -n auto\n")
    extras = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    (extra,) = re.findall(r'"\.\[(\w+)\]"', test)
    assert extra in extras
