"""A study of an actuator of another kind, from the shell to the report."""

import csv
import re

import numpy as np
import pytest

from ematwin.benchmarking.analysis import analyse
from ematwin.benchmarking.execute import execute
from ematwin.benchmarking.page import write_report
from ematwin.benchmarking.plan import Plan, Run, RunSpec, pack
from ematwin.benchmarking.statistics import diagnose
from ematwin.benchmarking.subject import Subject
from ematwin.benchmarking.table import collect
from ematwin.models.registry import models
from refusals import refused

SCREW = Subject.of("rm1605")


def screw_run(found, run=0, **injected):
    """A run of the ball-screw actuator that found some values."""
    of = RunSpec(
        case="Worn", faults=SCREW.vector(injected), algorithm="de", run=run, seed=run,
        population=10, iterations=10, noise=None, record_seed=run, actuator=SCREW.plain(),
        scenario={"name": "out-and-back"}, model="twin",
    )  # fmt: skip
    values = SCREW.vector(found)
    faults = SCREW.model.faults(SCREW.actuator)
    pair = SCREW.values(values), SCREW.values(of.faults)
    err = SCREW.model.study.error_percent(faults, *pair)
    return Run(of, "done", values, 1.0, 0.1, err, err, 100, 1.0, 1.0, pack([100], [1.0]), "budget")


@pytest.fixture(scope="module")
def worn():
    """Three runs: one right, one that missed, one that took backlash for friction."""
    return [
        screw_run({"friction": 2.05, "load": 900.0}, 0, friction=2.0),
        screw_run({}, 1, friction=2.0),
        screw_run({"backlash": 1e-3}, 2, friction=2.0),
    ]


def test_faults_are_diagnosed_by_shares_of_their_ranges(worn):
    (found,) = diagnose(collect(worn)).itertuples()
    assert (found.faults, found.missed, found.exact) == (3, 2, 1)
    assert found.confusions == {("friction", "backlash"): 1}
    assert found.chances + found.faults == 3 * found.runs, "a load is no fault"
    assert found.directions == found.direction_wrong == 0
    (strict,) = diagnose(
        collect(worn), 0.2
    ).itertuples()  # friction of 2 lies 0.17 of its range off
    assert strict.faults == 0


def test_a_report_says_nothing_of_what_the_kind_does_not_have(worn, tmp_path):
    analysis = analyse(worn)
    assert analysis.as_dict()["kind"] == "ball-screw"
    text = " ".join(analysis.conclusions)
    assert "2 of the 5 healthy values lie at a bound of this search box or at the origin" in text
    write_report(analysis, tmp_path / "report")
    page = (tmp_path / "report" / "index.html").read_text()
    body = re.sub(r"<(style|script).*?</\1>", "", page, flags=re.S)
    for word in ("paper", "eccentricity", "rapped", "irection"):
        assert word not in body, word
    with (tmp_path / "report" / "results.csv").open() as file:
        row = next(csv.DictReader(file))
    assert float(row["injected_friction"]) == 2.0
    assert "found_load" in row
    assert "found_short_a" not in row


@pytest.mark.parametrize("kind", list(models()))
def test_runs_of_each_kind_stay_within_its_bounds(kind):
    subject = Subject.of(models()[kind].parameters.default)
    fault = subject.unknowns[0]
    worn = {fault.name: fault.healthy + 0.4 * (fault.upper - fault.healthy)}
    plan = Plan(
        {"Worn": subject.vector(worn)}, ("de", "multistart", "descent"), runs=1, population=16,
        iterations=6, box="remapped", actuator=subject.actuator,
    )  # fmt: skip
    runs = [execute(spec) for spec in plan.specs()]
    assert {one.status for one in runs} == {"done"}
    for one in runs:
        found = np.array(one.faults)
        assert np.all((subject.lower <= found) & (found <= subject.upper))
    told = analyse(runs).as_dict()
    assert (told["kind"], told["unknowns"]) == (kind, list(subject.names))


def test_a_study_from_the_shell_to_its_report(ematwin, tmp_path):
    cases = tmp_path / "cases.toml"
    cases.write_text("[cases.Worn]\nfriction = 2.2\n[cases.Sound]\n")
    where = tmp_path / "study.db"
    asked = (
        "compare", "--actuator", "rm1605", "--cases", cases, "--algorithms", "de,multistart",
        "--runs", 1, "--population", 16, "--iterations", 6, "--workers", 1, "--store", where,
        "--json",
    )  # fmt: skip
    answer = ematwin(*asked)
    assert answer.code == 0, answer.err
    assert answer.told["counts"] == {"done": 4}
    again = ematwin(*asked).told
    assert (again["found"], again["finished"]) == (4, 0)
    told = ematwin("report", where, "--json").told
    assert (told["kind"], told["cases"]) == ("ball-screw", ["Sound", "Worn"])
    other = ematwin("compare", "--actuator", "servo48", "--store", where)
    refused(other, "holds another study")
