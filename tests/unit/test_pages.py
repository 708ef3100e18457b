"""Pages in a real browser at three widths: nothing cut, no error, the verdict first, small."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import plotly.graph_objects as go
import pytest
from synthetic import study

import ematwin
from devtools import WIDTHS, browser, seen_at
from ematwin.benchmarking.analysis import analyse
from ematwin.benchmarking.page import study_page
from ematwin.report.calibration import calibration_page, open_sentences
from ematwin.report.detection import detection_page
from ematwin.report.experiments import (
    design_page,
    discrimination_page,
    healthy_tests_page,
    identifiability_page,
)
from ematwin.report.identification import identification_page
from ematwin.report.page import Row, Section, Table, render
from ematwin.report.recordings import comparison_page
from synthetic_detection import detection


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    faulty = ematwin.simulate(actuator="rm1605", faults={"friction": 2.0})
    healthy = ematwin.simulate(actuator="rm1605")
    axis = ematwin.calibrate(ematwin.simulate(actuator="emps", noise=0.01), "emps")
    sure = {
        way: ematwin.identify(faulty, "rm1605", exact=True, uncertainty=way)
        for way in ("profile", "posterior")
    }
    return {
        "identify, profile": identification_page(sure["profile"]),
        "identify, posterior": identification_page(sure["posterior"]),
        "identifiability": identifiability_page([ematwin.identifiability(actuator="rm1605")]),
        "design": design_page(ematwin.design("rm1605", budget=2).check(1)),
        "discriminate": discrimination_page(
            ematwin.discriminate({"friction": 1.5}, {"gain": 0.8}, "rm1605", budget=2)
        ),
        "simulate": comparison_page(faulty, healthy, {"friction": 2.0}, sure["profile"].actuator),
        "detect": detection_page(detection(30)),
        "calibrate": calibration_page(axis),
        "learn": healthy_tests_page(ematwin.healthy_tests(axis)),
        "compare": study_page(analyse(study(2, cases=("Low F", "High Z")))),
    }


@pytest.fixture(scope="module")
def seen(pages, tmp_path_factory):
    """What each page looks like at each width."""
    folder = tmp_path_factory.mktemp("seen")
    paths = [folder / f"{name}.html" for name in pages]
    for path, text in zip(paths, pages.values(), strict=True):
        path.write_text(text, encoding="utf-8")
    return dict(zip(pages, seen_at(paths, folder), strict=True))


@pytest.mark.parametrize(
    "name",
    ["identify, profile", "identify, posterior", "simulate", "detect", "compare", "calibrate",
     "learn", "identifiability", "design", "discriminate"],
)  # fmt: skip
def test_nothing_is_cut_or_wrong_at_any_width(pages, seen, name):
    assert seen[name].keys() == set(WIDTHS)
    for width, told in seen[name].items():
        assert told["figures"] >= 1, width
        assert (told["wider"], told["cut"], told["out"]) == (0, 0, []), width
    assert len(pages[name]) < 1.5e6
    body = re.sub(r"<script.*?</script>", "", pages[name], flags=re.DOTALL)
    assert not re.search(r"\{(&#39;|'|&#34;)\w", body)  # no dictionary as Python prints it
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)\s*=\s*[\"']?http", pages[name])


def test_the_verdict_stands_first_in_the_colour_of_its_grade(pages: dict[str, str]) -> None:
    body = pages["identify, profile"].split("<body>")[1]
    assert re.match(r'\s*<header class="verdict fault">\s*<h1>.*?</h1>\s*<p class="lead">Fault: fr',
                    body)  # fmt: skip
    assert '<header class="verdict fault">' in pages["detect"]
    assert re.search(r'<p class="lead">[^<]* has the lowest mean Err%', pages["compare"])


def test_tables_sort_and_filter(tmp_path: Path) -> None:
    rows = [Row([f"row {n}", f"{value} N m"]) for n, value in enumerate([3, 20, 100, *range(12)])]
    page = tmp_path / "table.html"
    text = render("t", "l", [Section(table=Table(["name", "value"], rows))])
    page.write_text(text, encoding="utf-8")
    click = """(() => {
    document.querySelectorAll("th")[1].click(); document.querySelectorAll("th")[1].click();
    const field = document.querySelector(".filter"); field.value = "100 row";
    field.dispatchEvent(new Event("input"));
    return {
      first: document.querySelector("tbody tr td").textContent,
      shown: [...document.querySelectorAll("tbody tr")].filter((row) => !row.hidden).length,
    };})()"""
    with browser(tmp_path) as tab:
        tab.show(page)
        assert tab.value(click) == {"first": "row 2", "shown": 1}  # 100 N m is the most
        assert tab.said == []


def test_what_a_figure_says_cannot_end_its_script() -> None:
    figure = go.Figure(go.Scatter(x=[1], y=[1], name="</script><b>"))
    assert "</script><b>" not in render("t", "l", [Section(figure=figure)])


def test_a_calibration_that_fitted_everything_leaves_nothing_open() -> None:
    mass = SimpleNamespace(place="axis.mass", determined=True)
    everything = SimpleNamespace(parameters=lambda: [("axis.mass", 1.0)])
    report: Any = SimpleNamespace(parameters=[mass], tied=[], actuator=everything)
    assert open_sentences(report) == []


def test_results_write_their_own_page(tmp_path: Path) -> None:
    healthy = ematwin.simulate(actuator="rm1605")
    twin = ematwin.calibrate(healthy, "rm1605")
    found = ematwin.identify(healthy, twin)
    for result in (twin, found, ematwin.identify([healthy, healthy], twin)):
        result.report(tmp_path / "page.html")
        assert "</html>" in (tmp_path / "page.html").read_text(encoding="utf-8")
        with pytest.raises(ematwin.EmatwinError, match=r"end its name in \.html"):
            result.report(tmp_path / "page.pdf")


def test_a_table_stays_a_table_where_a_screen_is_wide(tmp_path: Path) -> None:
    """Seven faults with their intervals fit 1,400 px; a phone shows cards."""
    names = [f"short_{letter}" for letter in "abcdefg"]
    cells = ["0.0452 N m (0.0444 to 0.0463)", "0.1 turns (0 to 2.2)"]
    row = Row(["today.parquet", "friction", *cells * 3, "0.0003 (0 to 0.0016)"])
    table = Table(["recording", "verdict", *names], [row] * 3, texts=(1,), pairs=True)
    page = tmp_path / "table.html"
    page.write_text(render("t", "l", [Section(table=table)]), encoding="utf-8")
    with browser(tmp_path) as tab:
        for width, cards in ((1400, 0), (500, 1)):
            tab.show(page, width)
            assert tab.value("document.querySelectorAll('table.cards').length") == cards


def test_figures_fit_a_sheet_of_paper(pages: dict[str, str], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(pages["detect"], encoding="utf-8")
    widths = """[...document.querySelectorAll(".plot")].map(
      (one) => +one.querySelector(".main-svg").getAttribute("width"))"""
    with browser(tmp_path) as tab:
        tab.show(page)
        assert max(tab.value(widths)) > 700
        tab.value("dispatchEvent(new Event('beforeprint'))")
        tab.wait(f"Math.max(...{widths}) <= 700")
        assert min(tab.value(widths)) > 0
