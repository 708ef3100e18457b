"""The whole analysis: conclusions with their guards, claims, failures, JSON, IOHprofiler files."""

import json
import re

import numpy as np
import pytest
from synthetic import done, failed, spec, study, vector

from ematwin.comparison.analysis.ioh import export_ioh
from ematwin.comparison.analysis.study import analyse
from ematwin.errors import FileError, InputError
from ematwin.models.bldc.faults import PAPER_CASES


@pytest.fixture(scope="module")
def six():
    return analyse(study(6))


def test_study_of_six_finds_the_order_that_was_put_in(six):
    order = np.argsort(six.ranks.average_ranks)
    assert six.table.algorithms[order[0]] == "de"
    assert six.table.algorithms[order[-1]] == "woa"
    assert six.ranks.friedman_p < 0.001
    assert six.coefficients.sum(axis=1) == pytest.approx(500.0)


def test_claims_are_decided_from_the_numbers(six):
    verdicts = {claim.text: claim.verdict for claim in six.claims}
    assert verdicts["PSO, DE and GWO are the best of the six"] == "holds"
    assert verdicts["WOA is poor on High Z (among the two worst)"] == "holds"
    assert verdicts["GWO errs by more than 4 % on High Z"] == "does not hold"


def test_an_order_of_means_is_decided_only_where_their_intervals_tell():
    err = {"ga": 0.10, "pso": 0.10, "de": 0.11, "gwo": 0.20, "da": 0.30, "woa": 0.101}
    rng = np.random.default_rng(2)
    runs = []
    for case in PAPER_CASES:
        for algorithm, size in err.items():
            for run in range(8):
                of = spec(case, algorithm, run)
                found = np.array(of.faults)
                found[4] += size * rng.uniform(0.8, 1.2)  # short_c, healthy in every case
                runs.append(done(of, found))
    verdicts = {claim.text: claim.verdict for claim in analyse(runs).claims}
    assert verdicts["WOA is the best on High Gain"] == "cannot be told"
    assert verdicts["PSO has the lowest mean Err% for low faults"] == "cannot be told"
    assert verdicts["DA is poor on High Z (among the two worst)"] == "holds"
    assert verdicts["WOA is poor on High Z (among the two worst)"] == "does not hold"


def test_nothing_is_claimed_with_too_few_runs():
    found = analyse(study(2))
    assert {claim.verdict for claim in found.claims} == {"cannot be told"}
    assert any("fewer than 5 runs" in text for text in found.conclusions)


def test_equal_algorithms_are_not_said_to_differ():
    rng = np.random.default_rng(8)
    runs = []
    for case in PAPER_CASES:
        for algorithm in ("ga", "de", "pso"):
            for run in range(5):
                of = spec(case, algorithm, run)
                found = np.clip(np.array(of.faults) + 0.01 * rng.standard_normal(8), 0, 1)
                runs.append(done(of, found))
    text = " ".join(analyse(runs).conclusions)
    assert "cannot be concluded" in text
    assert "DE before" not in text
    assert "PSO before" not in text
    assert "GA before" not in text


def test_one_algorithm_is_reported_and_nothing_compared():
    found = analyse(study(5, algorithms=("de",)))
    assert found.ranks.pairs == []
    assert any("one algorithm only" in text for text in found.conclusions)
    assert found.cells[0][0].done == 5


def test_one_run_is_reported():
    found = analyse([done(spec(), vector(friction=0.3))])
    assert found.cells[0][0].metrics["err"].mean == pytest.approx(5.0)
    json.dumps(found.as_dict(), allow_nan=False)


def test_failures_are_all_listed_and_nothing_but_failures_can_be_reported():
    runs = [failed(spec(run=0)), failed(spec(run=1), "timeout", "no end after 60 s")]
    found = analyse(runs)
    assert [one.status for one in found.failures] == ["failed", "timeout"]
    assert any("No run has a result" in text for text in found.conclusions)
    json.dumps(found.as_dict(), allow_nan=False)


def test_mixed_settings_are_told():
    runs = [done(spec(run=0), vector()), done(spec(run=1, box="remapped"), vector())]
    text = " ".join(analyse(runs).conclusions)
    assert "differ in search box" in text
    assert "Repeat the study with the remapped box" in text
    assert "lies beside a cliff" in text


def test_search_spread_is_never_called_measurement_uncertainty(six):
    text = " ".join(six.conclusions)
    assert "not measurement uncertainty" in text
    assert text.count("measurement uncertainty") == 1


@pytest.mark.parametrize("options", [{"targets": (0.0,)}, {"targets": ()}, {"threshold": 0.5}])
def test_senseless_options_are_refused(options):
    with pytest.raises(InputError, match="must"):
        analyse(study(1, cases=("Low F",)), **options)


def test_export_keeps_to_the_iohprofiler_format(tmp_path):
    runs = [*study(2, cases=("Low F", "High Z"), algorithms=("de", "ga")), failed(spec(run=9))]
    assert export_ioh(runs, tmp_path / "ioh", ["Low F", "High Z"]) == (8, 1)
    metas = sorted((tmp_path / "ioh").glob("*/IOHprofiler_f*_*.json"))
    assert len(metas) == 4
    for path in metas:
        meta = json.loads(path.read_text())
        assert meta["maximization"] is False
        assert meta["attributes"] == ["evaluations", "raw_y"]
        assert meta["algorithm"]["name"] == path.parent.name
        (scenario,) = meta["scenarios"]
        assert scenario["dimension"] == 8
        lines = (path.parent / scenario["path"]).read_text().splitlines()
        starts = [n for n, line in enumerate(lines) if line == "evaluations raw_y"]
        assert len(starts) == len(scenario["runs"]) == 2
        for start, stop, run in zip(
            starts, [*starts[1:], len(lines)], scenario["runs"], strict=True
        ):
            body = [line.split(" ") for line in lines[start + 1 : stop]]
            assert all(re.fullmatch(r"\d+", n) and np.isfinite(float(y)) for n, y in body)
            evaluations = [int(n) for n, _ in body]
            assert evaluations[0] == 1  # by which readers tell runs apart
            assert np.all(np.diff(evaluations) > 0)
            assert evaluations[-1] == run["evals"] == 10_000
            assert min(float(y) for _, y in body) == run["best"]["y"]
            assert len(run["best"]["x"]) == 8


def test_export_does_not_write_into_a_folder_with_something_in_it(tmp_path):
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(FileError, match="not empty"):
        export_ioh(study(1), tmp_path, list(PAPER_CASES))
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
