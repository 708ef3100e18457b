"""The report as a folder, as a page in a browser, and as a command."""

import csv
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from synthetic import done, failed, spec, study, vector

from ematwin.comparison.analysis.study import analyse
from ematwin.comparison.report import study_folder
from ematwin.comparison.report.latex import escape, latex_table
from ematwin.comparison.report.study_figures import StudyFigures
from ematwin.comparison.report.study_folder import write_report
from ematwin.comparison.report.study_svg import still
from ematwin.comparison.report.study_tables import number
from ematwin.comparison.study.rows import settings_of
from ematwin.comparison.study.store import Store
from ematwin.errors import FileError, MissingExtraError
from ematwin.plots.study import interactive
from ematwin.report.page import Row, Table


@pytest.fixture(scope="module")
def analysis():
    runs = list(study(5))
    runs[7] = failed(runs[7].spec, "timeout", "no end after 60 s <b>")
    return analyse(runs)


@pytest.fixture(scope="module")
def small():
    return analyse(study(3, cases=("Low F", "High Z")))


@pytest.fixture(scope="module")
def report(analysis, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "report"
    write_report(analysis, folder)
    return folder


def browse(page: Path, profile: Path) -> tuple[str, str]:
    """The page after its scripts ran, and what the browser said meanwhile."""
    done = subprocess.run(
        [
            "chromium", "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr",
            "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={profile}",
            "--virtual-time-budget=8000", "--dump-dom", page.as_uri(),
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    return done.stdout, done.stderr


def test_page_draws_every_figure_in_a_browser_without_errors_or_network(report, tmp_path):
    dom, said = browse(report / "index.html", tmp_path)
    errors = [line for line in said.splitlines() if "CONSOLE" in line and "rror" in line]
    assert errors == []
    assert dom.count('class="main-svg"') >= 7  # four bar charts, boxes, bands, targets
    body = re.sub(r"<script.*?</script>", "", (report / "index.html").read_text(), flags=re.S)
    assert re.findall(r'(?:src|href)="(?!#)[^"]*"', body) == []
    assert "&lt;b&gt;" in body


def test_report_holds_page_tables_and_drawings(report):
    names = {path.name for path in report.iterdir()}
    for place, kind in ((4, "errors_low"), (5, "errors_high"), (6, "seconds_low"),
                        (7, "seconds_high")):  # fmt: skip
        assert f"figure{place}_{kind}.svg" in names
    assert {"index.html", "results.csv", "cells.csv", "claims.md", "critical_difference.svg",
            "convergence.svg", "distributions.svg", "evaluations_to_target.svg",
            "table_beside_paper.tex"} <= names  # fmt: skip
    for path in report.glob("*.svg"):
        assert ET.parse(path).getroot().tag.endswith("svg")
    assert (report / "index.html").stat().st_size < 6e6


def test_both_ways_of_drawing_show_the_words_and_names_of_one_description(small):
    figures = StudyFigures(small)
    for figure in figures.all:
        svg, page = still(figure), interactive(figure).to_json()
        for panel in figure.panels:
            words = {figure.y_title, figure.x_title, *panel.categories}
            words |= {panel.title} if figure.grid else set()
            words |= {series.name for series in panel.series}
            words |= {series.color for series in panel.series}
            assert [word for word in words if word not in svg] == [], figure.file
            assert [word for word in words if word not in page] == [], figure.file
    assert len({figure.file for figure in figures.all}) == len(figures.all)
    assert len({figure.heading for figure in figures.all}) == len(figures.all)


def test_figures_hold_the_numbers_of_the_analysis(small):
    bars, *_ = StudyFigures(small).bars
    assert bars.heading == "Mean Err%, low faults (the paper's figure 4)"
    (panel,) = bars.panels
    spreads = [small.cells[0][a].metrics["err"] for a in range(len(panel.series))]
    assert [series.height[0] for series in panel.series] == [spread.mean for spread in spreads]
    drawn = interactive(bars).data
    assert [trace.y[0] for trace in drawn] == pytest.approx(
        [spread.mean for spread in spreads], rel=1e-3
    )
    whiskers = [(trace.y[0] - trace.error_y.arrayminus[0]) for trace in drawn]
    assert whiskers == pytest.approx([spread.mean_interval[0] for spread in spreads], rel=1e-2)


def test_bars_say_how_many_of_many_cases_they_show():
    names = tuple(f"Case {n:02d}" for n in range(30))
    bars, *_ = StudyFigures(analyse(study(2, cases=names))).bars
    assert bars.heading == "Mean Err%, first 24 of 30 cases"
    assert bars.panels[0].categories == names[:24]


def test_numbers_keep_their_digits():
    assert [number(value) for value in (4.0, 0.6, 100.0, 1234.5, 0.0, 99.95)] == [
        "4.00", "0.600", "100", "1234", "0", "100",
    ]  # fmt: skip
    assert number(float("nan")) == "–"


def test_results_hold_every_run_failed_ones_included(report, analysis):
    with (report / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(analysis.table) == 300
    (bad,) = [row for row in rows if row["status"] != "done"]
    assert (bad["status"], bad["err"]) == ("timeout", "")


def test_report_is_the_same_when_built_again(small, tmp_path):
    one, again = tmp_path / "one", tmp_path / "again"
    write_report(small, one, slim=True)
    write_report(analyse(reversed(list(study(3, cases=("Low F", "High Z"))))), again, slim=True)
    assert {path.name for path in one.iterdir()} == {path.name for path in again.iterdir()}
    for path in one.iterdir():
        assert path.read_bytes() == (again / path.name).read_bytes(), path.name


def test_slim_page_has_still_figures_and_no_plotly(small, tmp_path):
    write_report(small, tmp_path / "slim", slim=True)
    page = (tmp_path / "slim" / "index.html").read_text()
    assert "Plotly, Inc" not in page
    assert "application/json" not in page
    assert page.count("<svg") >= 8
    assert len(page) < 2e6


def test_report_replaces_its_own_files_and_keeps_others(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "figure4_errors_low.svg").write_text("of an older report")
    write_report(analyse([done(spec("x", run=0), vector())]), tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert not (tmp_path / "figure4_errors_low.svg").exists()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_report_that_fails_leaves_nothing(small, tmp_path, monkeypatch):
    def full_disk(*_: object, **__: object) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(study_folder, "study_page", full_disk)
    with pytest.raises(FileError, match="No space left"):
        write_report(small, tmp_path / "report")
    assert list(tmp_path.iterdir()) == []


def test_missing_extra_names_the_install_command(small, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "scikit_posthocs", None)
    with pytest.raises(MissingExtraError, match=r"ematwin\[study\]"):
        write_report(small, tmp_path / "report")


@pytest.mark.parametrize(
    "runs",
    [
        [done(spec(), vector(friction=0.3))],
        [failed(spec(run=0)), failed(spec(run=1))],
        list(study(2, algorithms=("de",))),
        list(study(1, cases=tuple(f"Multi {n}" for n in range(14)), algorithms=("de", "mine"))),
    ],
    ids=["one run", "all failed", "one algorithm", "other cases"],
)
def test_report_says_what_it_could_not_compute(runs, tmp_path):
    write_report(analyse(runs), tmp_path / "report")
    assert "What can and cannot be concluded" in (tmp_path / "report/index.html").read_text()


def test_latex_is_escaped_and_marked():
    text = latex_table(
        Table(["a_b", "50 %"], [Row(["x & y", "{1}"], marked=True)]), "All of it: 100 %", "tab:x"
    )
    assert r"a\_b & 50 \% \\" in text
    assert r"\textbf{x \& y} & \textbf{\{1\}} \\" in text
    assert text.count("{") == text.count("}")
    assert escape("\\^~") == r"\textbackslash{}\textasciicircum{}\textasciitilde{}"


def command(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ematwin", "report", *arguments], env={**os.environ, **environment},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    path = tmp_path_factory.mktemp("store") / "study.db"
    runs = list(study(2, cases=("Low F", "High Z"), history_points=20))
    with Store(path) as opened:
        opened.begin(settings_of(runs[0].spec))
        opened.save(runs)
    return path


def test_command_writes_report_and_export_and_answers_as_json(store, tmp_path):
    out, ioh = tmp_path / "report", tmp_path / "ioh"
    answer = command(str(store), "--out", str(out), "--ioh", str(ioh), "--json")
    assert answer.returncode == 0, answer.stderr
    told = json.loads(answer.stdout)
    assert told["runs"] == 24
    assert "index.html" in told["report"]["files"]
    assert told["ioh"]["written"] == 24
    assert (out / "index.html").exists()


def test_report_does_not_hang_on_the_hashes_of_a_process(store, tmp_path):
    pages = []
    for seed in ("1", "2"):
        command(str(store), "--out", str(tmp_path / seed), "--slim", PYTHONHASHSEED=seed)
        pages.append((tmp_path / seed / "index.html").read_bytes())
    assert pages[0] == pages[1]


def test_command_without_folder_prints_for_people(store):
    answer = command(str(store))
    assert answer.returncode == 0, answer.stderr
    assert "Average rank" in answer.stdout


def test_command_refuses_in_one_sentence(store, tmp_path):
    empty = tmp_path / "empty.db"
    with Store(empty) as opened:
        opened.begin(settings_of(spec()))
    file = tmp_path / "file"
    file.write_text("")
    for arguments in (
        (str(tmp_path / "none.db"),),
        (str(empty),),
        (str(store), "--out", str(file)),
        (str(store), "--out", "/proc/nowhere/report"),
        (str(store), "--threshold", "2"),
        (str(store), "--seed", "-1"),
    ):
        answer = command(*arguments)
        assert answer.returncode == 2, arguments
        assert answer.stderr.startswith("Error: ")
        assert answer.stderr.count("\n") == 1
        assert answer.stdout == ""
    assert not (tmp_path / "none.db").exists()


def test_the_example_report_is_small_and_says_how_it_was_made():
    folder = Path(__file__).parents[2] / "examples" / "paper-study"
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert len(page) < 1.1e6
    assert "Plotly, Inc" not in page
    assert "application/json" not in page
    assert "600 runs: 6 algorithms on 10 cases" in page
    commands = (folder / "README.md").read_text(encoding="utf-8")
    assert "ematwin compare --cases paper --algorithms ga,pso,de,gwo,da,woa --runs 10" in commands
    assert "ematwin report paper.db --out report --slim" in commands


def test_the_example_with_published_forms_is_small_and_names_them():
    folder = Path(__file__).parents[2] / "examples" / "paper-study-published"
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert len(page) < 1.1e6
    assert "600 runs: 6 algorithms on 10 cases" in page
    assert "Here GA is ga-holland, PSO is pso-inertia, DE is de-rand" in page
    commands = (folder / "README.md").read_text(encoding="utf-8")
    assert "ematwin compare --cases paper --algorithms paper --runs 10" in commands
