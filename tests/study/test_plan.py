"""Cases, runs, seeds and boxes of a plan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ematwin.errors import InputError
from ematwin.faults import HEALTHY, PAPER_CASES
from ematwin.plant.scenario import Profile, Scenario
from ematwin.study.box import SHIFT, from_faults, to_faults
from ematwin.study.cases import cases_of, multi_cases
from ematwin.study.execute import execute
from ematwin.study.history import PackedHistory, pack
from ematwin.study.run import RunSpec
from ematwin.testing.store_contract import small_plan


def test_the_paper_study_has_600_runs() -> None:
    plan = small_plan(cases=cases_of("paper"), algorithms=("ga", "pso", "de", "gwo", "da", "woa"))
    specs = replace(plan, runs=10).specs()
    assert len({spec.id for spec in specs}) == 600
    assert len({spec.seed for spec in specs}) == 600
    assert {spec.case for spec in specs} == set(PAPER_CASES)


def test_all_algorithms_of_a_repetition_see_one_record() -> None:
    specs = small_plan().specs()
    seeds = {(spec.case, spec.run): {s.record_seed for s in specs if s.run == spec.run}
             for spec in specs}  # fmt: skip
    assert all(len(found) == 1 for found in seeds.values())
    assert len({seed for found in seeds.values() for seed in found}) == 3


def test_a_larger_plan_holds_the_runs_of_the_smaller_one() -> None:
    small = {spec.id for spec in small_plan().specs()}
    more_cases = {"Other": (0.1,) * 8, **small_plan().cases}
    large = small_plan(cases=more_cases, algorithms=("de", "pso", "ga"), runs=5)
    assert small < {spec.id for spec in large.specs()}


def test_an_alias_is_the_same_algorithm() -> None:
    names = small_plan(algorithms=(" PSO ", "pso", "multistart")).algorithms
    assert names == ("pso", "multistart")


def test_random_cases_have_two_to_four_faults_and_repeat() -> None:
    cases = multi_cases(50, 7)
    assert cases == multi_cases(50, 7)
    assert cases != multi_cases(50, 8)
    assert list(multi_cases(60, 7).items())[:50] == list(cases.items())
    for vector in cases.values():
        differs = np.array(vector) != HEALTHY
        differs[6] = False  # the direction belongs to the eccentricity
        assert 2 <= differs.sum() <= 4
        assert all(0.0 <= k <= 1.0 for k in vector)


def test_cases_of_a_file(tmp_path: Path) -> None:
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
def test_cases_that_cannot_be_used(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "cases.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        cases_of(str(path))


def test_recorded_profiles_travel_with_the_runs(tmp_path: Path) -> None:
    (tmp_path / "move.csv").write_text("time,command\n0,0\n0.5,0.002\n1,0\n")
    part = Profile(file=tmp_path / "move.csv", column="command")
    plan = small_plan(scenario=Scenario(duration=1.0, command=[part]))
    (kept,) = plan.settings()["scenario"]["command"]
    assert kept["file"] is None
    assert kept["value"] == [0.0, 0.002, 0.0]


def test_the_remapped_box_is_one_to_one_and_healthy_lies_inside() -> None:
    x = np.random.default_rng(1).random((1000, 8))
    k = to_faults(x, "remapped")
    assert np.all((k >= 0.0) & (k <= 1.0))
    np.testing.assert_allclose(from_faults(k, "remapped"), x, atol=1e-12)
    healthy = from_faults(HEALTHY[None], "remapped")[0]
    assert np.all((healthy > 0.2) & (healthy < 0.8) & (np.abs(healthy - 0.5) > 0.05))
    assert len(set(SHIFT)) == 8
    np.testing.assert_array_equal(to_faults(x, "plain"), x)


@pytest.fixture
def spec() -> RunSpec:
    return small_plan(population=32, iterations=4).specs()[0]


def test_a_run_repeats_bit_for_bit(spec: RunSpec) -> None:
    first, second = execute(spec), execute(spec)
    assert first.faults == second.faults
    assert first.history == second.history
    assert first.evaluations == 128
    assert first.history[-1] == (128, first.cost)
    assert first.provenance["engine"] == "none"


@pytest.mark.parametrize("algorithm", ["de", "multistart"])
def test_runs_in_the_remapped_box(spec: RunSpec, algorithm: str) -> None:
    plain = execute(replace(spec, algorithm=algorithm))
    moved = execute(replace(spec, algorithm=algorithm, box="remapped"))
    assert moved.status == plain.status == "done"
    assert moved.faults != plain.faults
    assert all(0.0 <= k <= 1.0 for k in moved.faults)


def test_noise_changes_the_record(spec: RunSpec) -> None:
    noisy = execute(replace(spec, noise={"white": 0.02, "offset": 0.0, "bits": 12,
                                         "full_scale": 25.0}))  # fmt: skip
    assert noisy.status == "done"
    assert noisy.cost != execute(spec).cost


def test_a_run_that_cannot_start_is_a_result(spec: RunSpec) -> None:
    result = execute(replace(spec, algorithm="nobody"))
    assert result.status == "failed"
    assert "no algorithm 'nobody'" in result.stopped


def test_histories_are_packed_without_loss() -> None:
    history = tuple((50 * n, np.pi / n) for n in range(1, 201))
    packed = PackedHistory(pack(history))
    assert packed == history
    assert packed[-1] == history[-1]
    assert packed[:2] == history[:2]
    assert len(packed) == 200
    assert PackedHistory(pack(())) == ()
