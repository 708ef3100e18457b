"""A store that ematwin 0.1.0 wrote: it opens, is reported, and its plan is found done."""

import json
import shutil
from pathlib import Path

import pytest

from ematwin.comparison.analysis.study import analyse
from ematwin.comparison.study.cases import cases_of
from ematwin.comparison.study.execute import execute
from ematwin.comparison.study.plan import Plan
from ematwin.comparison.study.store import open_store
from ematwin.models.registry import load_actuator, shipped_actuators

# ematwin compare --cases paper --algorithms multistart,random --runs 1 --population 10
#     --iterations 30 --scenario step
STORE = Path(__file__).parents[1] / "data" / "0.1" / "study.db"
ASKED = (
    "--cases", "paper", "--algorithms", "multistart,random", "--runs", 1, "--population", 10,
    "--iterations", 30, "--scenario", "step",
)  # fmt: skip


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return Path(shutil.copy(STORE, tmp_path / "study.db"))


@pytest.fixture
def actuator(tmp_path: Path) -> Path:
    """The file of the shipped actuator as it was: its monitor model took shorter steps."""
    now = shipped_actuators()["servo48"].read_text(encoding="utf-8")
    before = now.replace(
        'monitor = { value = 50, unit = "us"', 'monitor = { value = 10, unit = "us"'
    )
    assert before != now
    path = tmp_path / "servo48.toml"
    path.write_text(before, encoding="utf-8")
    return path


def plan(actuator: Path) -> Plan:
    return Plan(
        cases_of("paper"), ("multistart", "random"), runs=1, population=10, iterations=30,
        scenario="step", actuator=load_actuator(actuator),
    )  # fmt: skip


def test_its_runs_are_those_of_the_same_plan_now(store: Path, actuator: Path) -> None:
    with open_store(store) as opened:
        stored = {one.spec.id: one for one in opened.runs()}
        assert opened.settings() == plan(actuator).settings()
    specs = plan(actuator).specs()
    assert {spec.id for spec in specs} == set(stored)
    for spec in specs:
        assert spec == stored[spec.id].spec


def test_the_shipped_actuator_of_now_is_another_study(store: Path, ematwin) -> None:  # type: ignore[no-untyped-def]
    told = ematwin("compare", *ASKED, "--store", store)
    assert told.code == 2
    assert "its actuator.steps.monitor is 1e-05, received 5e-05" in told.err


def test_it_is_reported(store: Path) -> None:
    with open_store(store) as opened:
        analysis = analyse(opened.runs())
    assert analysis.table.subject.kind == "bldc"
    assert int(analysis.table.done.sum()) == 20
    assert analysis.claims == []  # none of the paper's six took part


def test_its_study_is_found_done(store: Path, actuator: Path, ematwin) -> None:  # type: ignore[no-untyped-def]
    answer = json.loads(
        ematwin("compare", *ASKED, "--actuator", actuator, "--store", store, "--json").out
    )
    assert (answer["planned"], answer["found"], answer["finished"]) == (20, 20, 0)
    told = ematwin("report", store, "--out", store.parent / "report", "--slim")
    assert told.code == 0, told.err
    assert "20 of 20 runs ended well" in told.out


def test_its_runs_come_out_alike_when_done_again(store: Path, actuator: Path) -> None:
    with open_store(store) as opened:
        stored = {one.spec.id: one.result for one in opened.runs()}
    for spec in plan(actuator).specs()[4:6]:  # multistart and random on Low B
        result = execute(spec)
        before = stored[spec.id]
        assert result.stopped == before.stopped
        # the monitor model of 0.1 treated a reversal otherwise
        assert result.faults == pytest.approx(before.faults, abs=0.01)
        assert result.err == pytest.approx(before.err, abs=0.2)
