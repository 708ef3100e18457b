"""Cases, runs, seeds and boxes of a plan."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import small_plan

from ematwin import load_actuator
from ematwin.benchmarking.box import RemappedProblem, places, shifts
from ematwin.benchmarking.execute import execute
from ematwin.benchmarking.plan import Plan
from ematwin.benchmarking.run import pack, unpack
from ematwin.benchmarking.subject import Subject, cases_of
from ematwin.errors import InputError, ParameterError
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import find, named
from ematwin.models.bldc.faults import HEALTHY, PAPER_CASES
from ematwin.models.comparison import Comparison
from ematwin.models.scenario import Profile, Scenario


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


def test_an_alias_is_the_same_algorithm():
    names = small_plan(algorithms=(" PSO ", "pso", "multistart")).algorithms
    assert names == ("pso", "multistart")


def test_random_cases_have_two_to_four_faults_and_repeat():
    cases = multi(50, 7)
    assert cases == multi(50, 7)
    assert cases != multi(50, 8)
    assert list(multi(60, 7).items())[:50] == list(cases.items())
    for vector in cases.values():
        differs = np.array(vector) != HEALTHY
        differs[6] = False  # the direction belongs to the eccentricity
        assert 2 <= differs.sum() <= 4
        assert all(0.0 <= k <= 1.0 for k in vector)


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


class Bowl(Comparison):
    """Misfit that grows with the distance from a vector, whatever the actuator."""

    model_error = 1.0

    noise = 0.0  # priors do not count

    def __init__(self, subject, bottom):
        self._subject, self._bottom = subject, bottom
        self.scale = 1.0

    def responses(self, candidates, count):  # type: ignore[no-untyped-def]
        values = np.column_stack([candidates[name] for name in self._subject.names])
        return {"share": values / (self._subject.upper - self._subject.lower)}

    def measured(self):  # type: ignore[no-untyped-def]
        return {"share": self._bottom / (self._subject.upper - self._subject.lower)}

    def captions(self):  # type: ignore[no-untyped-def]
        return {"share": ("share", "")}

    def residuals(self, candidates, count):  # type: ignore[no-untyped-def]
        return self.responses(candidates, count)["share"] - self.measured()["share"]


def bowl(actuator):
    subject = Subject.of(actuator)
    bottom = subject.lower + 0.4 * (subject.upper - subject.lower)
    return Problem([Bowl(subject, bottom)], subject.unknowns)


@pytest.mark.parametrize("actuator", ["servo48", "rm1605"])
def test_the_remapped_box_is_one_to_one_and_healthy_lies_inside(actuator):
    subject, problem = Subject.of(actuator), bowl(actuator)
    remapped = RemappedProblem(problem)
    lower, width = subject.lower, subject.upper - subject.lower
    x = np.random.default_rng(1).random((1000, len(width))) * width + lower
    k = remapped.from_box(x)
    assert np.all((k >= subject.lower) & (k <= subject.upper))
    np.testing.assert_allclose((remapped.to_box(k) - x) / width, 0.0, atol=1e-12)
    healthy = ((remapped.to_box(subject.healthy[None])[0]) - lower) / width
    assert np.all((healthy > 0.2) & (healthy < 0.8) & (np.abs(healthy - 0.5) > 0.05))
    np.testing.assert_array_equal(problem.from_box(x), x)
    np.testing.assert_array_equal(remapped.costs(k), problem.costs(k))


def test_the_remapped_box_of_the_brushless_actuator_stays_as_it_was():
    shift = [0.31, 0.64, 0.42, 0.73, 0.27, 0.58, 0.19, 0.87]
    assert shifts(Subject.of("servo48").unknowns).tolist() == shift


@pytest.mark.parametrize("dimension", range(1, 40))
def test_healthy_lies_nowhere_special_in_any_dimension(dimension):
    place = places(dimension)
    assert len(place) == dimension
    assert np.all((place >= 0.25) & (place <= 0.75) & (np.abs(place - 0.5) >= 0.05))
    assert len(set(place)) == dimension
    assert dimension < 3 or np.ptp(place) > 0.2


@pytest.mark.parametrize("method", ["de", "levenberg-marquardt"])
def test_a_search_of_the_remapped_box_answers_with_values(method):
    problem = RemappedProblem(bowl("rm1605"))
    assert np.abs(problem.start - problem.healthy).max() > 0.0  # it shall not begin at the answer
    np.testing.assert_allclose(problem.to_box(problem.start[None])[0],
                               0.5 * (problem.lower + problem.upper))  # fmt: skip
    found = find(problem, named(method, population=30), budget=3000)
    share = (found.point - problem.lower) / (problem.upper - problem.lower)
    np.testing.assert_allclose(share, 0.4, atol=1e-3)
    assert found.cost == problem.costs(found.point[None])[0]


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


def test_noise_changes_the_record(spec):
    noisy = execute(replace(spec, noise={"white": 0.02, "offset": 0.0, "bits": 12,
                                         "full_scale": 25.0}))  # fmt: skip
    assert noisy.status == "done"
    assert noisy.cost != execute(spec).cost


def test_a_run_that_cannot_start_is_a_result(spec):
    result = execute(replace(spec, algorithm="nobody"))
    assert result.status == "failed"
    assert "no algorithm 'nobody'" in result.stopped


def test_histories_are_packed_without_loss():
    evaluations, costs = np.arange(50, 10_001, 50), np.pi / np.arange(1, 201)
    again = unpack(pack(evaluations, costs))
    np.testing.assert_array_equal(again[0], evaluations)
    np.testing.assert_array_equal(again[1], costs)
    assert [len(part) for part in unpack(pack([], []))] == [0, 0]
    assert [len(part) for part in unpack(b"")] == [0, 0]


# Any kind of actuator


@pytest.fixture
def screw():
    """A study of the ball-screw actuator: one case, three methods, two runs."""
    chosen = load_actuator("rm1605")
    cases = {"High friction": cases_of(actuator=chosen)["High friction"]}
    return Plan(
        cases, ("de", "multistart", "levenberg-marquardt"), runs=2, population=20, iterations=15,
        actuator=chosen,
    )  # fmt: skip


def test_runs_of_another_kind_name_it(screw):
    (spec, *_) = screw.specs()
    assert spec.actuator["kind"] == "ball-screw"
    assert spec.scenario["name"] == "out-and-back"
    assert len(spec.faults) == 5
    assert "kind" not in small_plan().specs()[0].actuator
    again = Subject.stored(spec.actuator)
    assert again.actuator.fingerprint == load_actuator("rm1605").fingerprint
    assert again.names == Subject.of("rm1605").names


def test_runs_of_another_kind_find_its_faults(screw):
    results = {spec.algorithm: execute(spec) for spec in screw.specs()[:3]}
    assert {result.status for result in results.values()} == {"done"}
    for result in results.values():
        assert result.err == result.err_wrapped  # no unknown of it has a direction
        assert len(result.faults) == 5
    assert results["multistart"].err < 2.0
    assert results["levenberg-marquardt"].err < 2.0
    assert results["levenberg-marquardt"].evaluations <= 300
    assert results["de"].evaluations == 300


def test_sensors_of_a_kind_that_has_them_differ_from_run_to_run(screw):
    first, second = (spec for spec in screw.specs() if spec.algorithm == "levenberg-marquardt")
    assert first.record_seed != second.record_seed
    assert execute(first).cost != execute(second).cost


def test_a_case_of_another_kind_is_refused(screw):
    with pytest.raises(InputError, match="'High friction' has 5 values, but servo48 has 8"):
        replace(screw, actuator="servo48", scenario=None)


def test_cases_default_to_those_of_the_kind():
    assert cases_of() == cases_of("paper")
    assert list(cases_of()) == list(PAPER_CASES)
    assert set(cases_of(actuator="rm1605")) == {
        f"{size} {name}" for name in ("friction", "backlash", "gain") for size in ("Low", "High")
    }
    with pytest.raises(InputError, match="--cases paper is for the kind bldc"):
        cases_of("paper", "rm1605")


def test_random_cases_of_any_kind_lie_between_healthy_and_the_bounds():
    subject = Subject.of("rm1605")
    cases = multi(50, 7, subject.actuator)
    assert cases == multi(50, 7, subject.actuator)
    width = subject.upper - subject.lower
    for vector in cases.values():
        away = np.abs(np.array(vector) - subject.healthy) / width
        assert 2 <= (away > 0.0).sum() <= 3  # it has three faults
        assert np.all(away[3:] == 0.0), "a nuisance is no fault"
        assert np.all((away[away > 0.0] > 0.01) & (away[away > 0.0] < 0.91))
        assert np.all((subject.lower <= vector) & (vector <= subject.upper))


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
