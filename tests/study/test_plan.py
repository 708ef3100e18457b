"""Cases, runs, seeds and boxes of a plan."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import small_plan

from ematwin.benchmarking.execute import RemappedProblem, execute, shifts
from ematwin.benchmarking.plan import Plan, unpack
from ematwin.benchmarking.subject import Subject, cases_of
from ematwin.errors import InputError, ParameterError
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import find, named
from ematwin.models.bldc.faults import HEALTHY, PAPER_CASES
from ematwin.models.scenario import Profile, Scenario
from naive.toy import Toy, fault, stacked


def multi(count, seed, actuator=None):
    return cases_of("multi", actuator, count=count, seed=seed)


def test_the_paper_study_has_600_runs():
    plan = small_plan(cases=cases_of("paper"), algorithms=("ga", "pso", "de", "gwo", "da", "woa"))
    specs = replace(plan, runs=10).specs()
    assert len({spec.id for spec in specs}) == 600
    assert len({spec.seed for spec in specs}) == 600
    assert {spec.case for spec in specs} == set(PAPER_CASES)


def test_all_algorithms_of_a_repetition_see_one_record():
    specs = small_plan().specs()
    seeds = {(spec.case, spec.run): {s.record_seed for s in specs if s.run == spec.run}
             for spec in specs}  # fmt: skip
    assert all(len(found) == 1 for found in seeds.values())
    assert len({seed for found in seeds.values() for seed in found}) == 3


def test_a_larger_plan_holds_the_runs_of_the_smaller_one():
    small = {spec.id for spec in small_plan().specs()}
    more_cases = {"Other": (0.1,) * 8, **small_plan().cases}
    large = small_plan(cases=more_cases, algorithms=("de", "pso", "ga"), runs=5)
    assert small < {spec.id for spec in large.specs()}


@pytest.mark.parametrize(("actuator", "faults", "most"), [("servo48", 8, 4), ("rm1605", 3, 3)])
def test_random_cases_have_two_faults_and_more_between_healthy_and_the_bounds(
    actuator, faults, most
):
    subject = Subject.of(actuator)
    cases = multi(50, 7, subject.actuator)
    assert cases == multi(50, 7, subject.actuator) != multi(50, 8, subject.actuator)
    assert list(multi(60, 7, subject.actuator).items())[:50] == list(cases.items())
    for vector in cases.values():
        away = np.abs(np.array(vector) - subject.healthy) / (subject.upper - subject.lower)
        if actuator == "servo48":
            away[6] = 0.0  # the direction belongs to the eccentricity
        assert 2 <= (away > 0.0).sum() <= most
        assert np.all(away[faults:] == 0.0), "a nuisance is no fault"
        assert np.all((subject.lower <= vector) & (vector <= subject.upper))


def test_cases_of_a_file(tmp_path):
    path = tmp_path / "cases.toml"
    path.write_text('[cases."Worn gear"]\nbacklash = 0.4\n[cases.Sound]\n')
    assert cases_of(str(path)) == {
        "Worn gear": (0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5),
        "Sound": tuple(HEALTHY),
    }


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "must hold tables"),
        ("[cases.A]\nfrictio = 0.2\n", "Case 'A' of .*Did you mean friction"),
        ("[cases.A]\nfriction = 2\n", r"must lie in \[0, 1\]"),
        ("[cases]\nA = 1\n", "must be a table"),
        ("runs = 3\n[cases.A]\n", "received 'runs'"),
    ],
)
def test_cases_that_cannot_be_used(tmp_path, text, sentence):
    path = tmp_path / "cases.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        cases_of(str(path))


def test_recorded_profiles_travel_with_the_runs(tmp_path):
    (tmp_path / "move.csv").write_text("time,command\n0,0\n0.5,0.002\n1,0\n")
    part = Profile(file=tmp_path / "move.csv", column="command")
    plan = small_plan(scenario=Scenario(duration=1.0, command=[part]))
    (kept,) = plan.settings()["scenario"]["command"]
    assert kept["file"] is None
    assert kept["value"] == [0.0, 0.002, 0.0]


def test_a_remapped_box_is_one_to_one_and_a_search_of_it_answers_with_values():
    toy = Toy(lambda values: stacked(values["wear"], values["gap"]), wear=0.4, gap=0.7)
    remapped = RemappedProblem(Problem([toy], (fault("wear"), fault("gap"))))
    x = np.random.default_rng(1).random((1000, 2))
    k = remapped.from_box(x)
    assert ((k >= 0.0) & (k <= 1.0)).all()
    shift = shifts(remapped.unknowns)  # where healthy lies: both are so at zero
    np.testing.assert_allclose(np.mod(k + shift, 1.0), x, atol=1e-12)
    assert ((shift > 0.2) & (shift < 0.8)).all()
    found = find(remapped, named("de", population=30), budget=3000)
    np.testing.assert_allclose(found.point, [0.4, 0.7], atol=1e-3)


def test_the_remapped_box_of_the_brushless_actuator_stays_as_it_was():
    shift = [0.31, 0.64, 0.42, 0.73, 0.27, 0.58, 0.19, 0.87]
    assert shifts(Subject.of("servo48").unknowns).tolist() == shift


@pytest.fixture
def spec():
    return small_plan(population=32, iterations=4).specs()[0]


def test_a_run_repeats_bit_for_bit(spec):
    first, second = execute(spec), execute(spec)
    assert first.faults == second.faults
    assert first.history == second.history
    assert first.evaluations == 128
    evaluations, costs = unpack(first.history)
    assert (evaluations[-1], costs[-1]) == (128, first.cost)
    assert first.provenance["engine"] == "none"


def test_a_run_that_cannot_start_is_a_result(spec):
    result = execute(replace(spec, algorithm="nobody"))
    assert result.status == "failed"
    assert "no algorithm 'nobody'" in result.stopped


# Any kind of actuator


def test_a_case_of_another_kind_is_refused():
    screw = {"High friction": cases_of(actuator="rm1605")["High friction"]}
    with pytest.raises(InputError, match="'High friction' has 5 values, but servo48 has 8"):
        Plan(screw, actuator="servo48")


def test_random_cases_of_the_brushless_actuator_stay_as_they_were():
    found = list(multi(4, 1).values())
    assert found[0] == (0.0, 0.0, 0.439, 0.0, 0.762, 0.0, 0.5, 0.021)
    assert found[2] == (0.0, 0.0, 0.14, 0.174, 0.0, 0.322, 0.822, 0.5)
    assert found[3] == (0.921, 0.0, 0.0, 0.0, 0.502, 0.0, 0.5, 0.935)


def test_what_is_not_searched_makes_no_case(tmp_path):
    path = tmp_path / "cases.toml"
    path.write_text("[cases.Pitted]\nroughness = 0.5\n")
    with pytest.raises(InputError, match=r"roughness is derived from .* leave it out of the case"):
        cases_of(str(path), "rm1605")
    path.write_text("[cases.Loaded]\nload = 300\nfriction = 2\n")
    (vector,) = cases_of(str(path), "rm1605").values()
    assert vector[0] == 2.0
    assert vector[3] == 300.0


def test_a_kind_that_is_not_installed_says_so():
    with pytest.raises(InputError, match=r"no kind of actuator 'piston'.*install the package"):
        Subject.stored({"kind": "piston", "name": "mine"})
    with pytest.raises(ParameterError, match=r"actuator mine of the study: .* is missing"):
        Subject.stored({"name": "mine", "description": ""})


@pytest.mark.parametrize("method", ["multistart", "ga"])
def test_a_budget_too_small_for_a_method_is_refused(method):
    smallest = named(method).smallest_budget
    assert small_plan(algorithms=(method,), population=smallest, iterations=1).runs == 3
    if smallest > 1:
        with pytest.raises(InputError, match=f"at least {smallest}, received {smallest - 1}"):
            small_plan(algorithms=(method,), population=smallest - 1, iterations=1)
