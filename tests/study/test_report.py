"""The report: a page in a browser, tables that can be read again, a command."""

import csv
import re
import sys

import pandas as pd
import pytest
from synthetic import done, failed, settings_of, spec, stored, study, vector

from ematwin.benchmarking.analysis import analyse
from ematwin.benchmarking.page import write_report
from ematwin.benchmarking.store import Store
from ematwin.report.study import MOST_CASES, plot_study
from refusals import refused

FILES = {
    "index.html", "results.csv", "results.parquet", "cells.csv", "effects.csv", "targets.csv",
}  # fmt: skip


def runs():
    """All done but one."""
    found = list(study(3, cases=("Low F", "High Z")))
    found[7] = failed(found[7].spec, "timeout", "=no end after 60 s <b>")
    return found


@pytest.fixture(scope="module")
def small():
    return analyse(runs())


@pytest.fixture(scope="module")
def report(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "report"
    assert set(write_report(small, folder)) == FILES
    return folder


def test_the_page_loads_nothing_and_what_an_algorithm_says_is_no_markup(report):
    body = re.sub(r"<script.*?</script>", "", (report / "index.html").read_text(), flags=re.S)
    assert re.findall(r'(?:src|href)="(?!#)[^"]*"', body) == []
    assert "&lt;b&gt;" in body


def test_figures_hold_the_numbers_of_the_analysis(small):
    bars = plot_study(small)["Mean Err%"].data
    cells = small.cells[small.cells["case"] == "Low F"].set_index("algorithm")
    assert [trace.name for trace in bars] == small.table.algorithms
    for trace in bars:
        cell = cells.loc[trace.name]
        assert trace.y[0] == pytest.approx(cell["err_mean"], rel=1e-3)
        whisker = trace.y[0] - trace.error_y.arrayminus[0]
        assert whisker == pytest.approx(cell["err_mean_low_95"], rel=1e-2)


def test_tables_hold_every_run_and_can_be_read_again(report, small):
    with (report / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(small.table) == 36
    (bad,) = [row for row in rows if row["status"] != "done"]
    assert (bad["status"], bad["err"]) == ("timeout", "")
    assert bad["stopped"].startswith("'=no end"), "a spreadsheet must not compute it"
    again = pd.read_parquet(report / "results.parquet")
    pd.testing.assert_frame_equal(again, small.to_frame("run"), check_dtype=False)


def test_a_report_is_the_same_whatever_the_order_of_runs_and_replaces_only_its_own_files(
    report, tmp_path
):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "cells.csv").write_text("of an older report")
    write_report(analyse(reversed(runs())), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {*FILES, "notes.txt"}
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (report / name).read_bytes(), name


@pytest.mark.parametrize(
    "runs",
    [
        [done(spec(), vector(friction=0.3))],
        [failed(spec(run=0)), failed(spec(run=1))],
        list(study(2, algorithms=("de",))),
        list(study(1, cases=tuple(f"Multi {n}" for n in range(14)), algorithms=("de", "mine"))),
    ],
    ids=["one run", "all failed", "one algorithm", "many cases"],
)
def test_a_report_of_little_is_written_all_the_same(runs, tmp_path):
    analysis = analyse(runs)
    write_report(analysis, tmp_path / "report")
    text = (tmp_path / "report/index.html").read_text()
    assert "What can and cannot be concluded" in text
    many = len(analysis.table.cases) > MOST_CASES
    assert ("The first 12 of 14 cases are drawn" in text) == many


@pytest.fixture
def store(tmp_path):
    runs = list(study(2, cases=("Low F", "High Z"), history_points=20))
    return stored(tmp_path / "study.db", runs)


def test_the_command_prints_for_people_or_answers_as_json(store, ematwin):
    assert "Average rank" in ematwin("report", store).out
    told = ematwin("report", store, "--out", "report", "--json").told
    assert told["runs"] == 24
    assert set(told["report"]["files"]) == FILES
    assert (store.parent / "report" / "index.html").exists()
    assert (
        "wrote report/index.html and 5 more files"
        in ematwin("report", store, "--out", "report").out
    )


def test_pages_do_not_depend_on_the_hashes_of_a_process(store, ematwin, ematwin_process):
    ematwin("report", store, "--out", "here")
    ematwin_process("report", store, "--out", "there", PYTHONHASHSEED="1")
    here, there = ((store.parent / name / "index.html").read_bytes() for name in ("here", "there"))
    assert here == there


def test_the_command_refuses_in_one_sentence(store, tmp_path, ematwin):
    empty = tmp_path / "empty.db"
    with Store(empty) as opened:
        opened.begin(settings_of(spec()))
    (tmp_path / "file").write_text("")
    for arguments in (
        (tmp_path / "none.db",),
        (empty,),
        (store, "--out", tmp_path / "file"),
        (store, "--out", "/proc/nowhere/report"),
        (store, "--threshold", "2"),
        (store, "--seed", "-1"),
    ):
        refused(ematwin("report", *arguments), "")
    assert not (tmp_path / "none.db").exists()


def test_without_pandas_a_study_is_done_and_its_report_names_the_extra(
    store, tmp_path, ematwin, monkeypatch
):
    monkeypatch.setitem(sys.modules, "pandas", None)
    refused = ematwin("report", store)
    assert 'pip install "ematwin[study]"' in refused.err
    cases = tmp_path / "cases.toml"
    cases.write_text("[cases.Worn]\nfriction = 2\n")
    done = ematwin(
        "compare", "--actuator", "rm1605", "--cases", cases, "--algorithms", "random", "--runs", 1,
        "--population", 4, "--iterations", 2, "--workers", 1, "--store", "other.db",
    )  # fmt: skip
    assert "1 done" in done.out, done.err
