"""The script beside the paper's study: its claims and Table 2 held against a study."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from synthetic import done, spec, stored, study

import commands
from ematwin.benchmarking.analysis import analyse
from ematwin.benchmarking.statistics import performance_coefficients
from ematwin.models.bldc.faults import PAPER_CASES

SCRIPT = Path(__file__).parents[2] / "examples" / "paper-study-published" / "claims.py"


@pytest.fixture(scope="module")
def script():
    found = importlib.util.spec_from_file_location("paper_claims", SCRIPT)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules["paper_claims"] = module
    found.loader.exec_module(module)
    return module


def verdicts(script, runs):
    return {claim.text: claim.verdict for claim in script.check_claims(analyse(runs))}


def test_table_2_adds_up_to_500_in_each_case_within_its_rounding(script):
    assert set(script.TABLE_2) == set(PAPER_CASES)
    table = np.array(list(script.TABLE_2.values()), dtype=float)
    assert np.abs(table.sum(axis=1) - 500.0).max() <= 6 * 0.5
    assert np.abs(table.mean(axis=0) - script.AVERAGE).max() <= 1.0
    again = performance_coefficients(np.ones((10, 6)), 100.0 - table)
    assert np.abs(again - table).max() < 1.0


def test_claims_are_decided_from_the_numbers(script):
    found = verdicts(script, study(6))
    assert found["PSO, DE and GWO are the best of the six"] == "holds"
    assert found["WOA is poor on High Z (among the two worst)"] == "holds"
    assert found["GWO errs by more than 4 % on High Z"] == "does not hold"


def test_an_order_of_means_is_decided_only_where_their_intervals_tell(script):
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
    said = verdicts(script, runs)
    assert said["WOA is the best on High Gain"] == "cannot be told"
    assert said["PSO has the lowest mean Err% for low faults"] == "cannot be told"
    assert said["DA is poor on High Z (among the two worst)"] == "holds"
    assert said["WOA is poor on High Z (among the two worst)"] == "does not hold"


def test_nothing_is_claimed_with_too_few_runs_or_of_another_study(script):
    assert set(verdicts(script, study(2)).values()) == {"cannot be told"}
    assert verdicts(script, study(1, algorithms=("random",))) == {}
    assert verdicts(script, study(1, cases=("mine",))) == {}


def test_claims_are_judged_with_the_forms_as_published(script):
    published = ("ga-holland", "pso-inertia", "de-rand", "gwo", "da", "woa")
    found = script.PaperStudy(analyse(study(1, algorithms=(*published, "pso", "cma"))))
    assert tuple(found.forms.values()) == published
    assert found.coefficients.sum(axis=1) == pytest.approx(500.0)
    own = script.PaperStudy(analyse(study(1, algorithms=("ga", "gwo", "cma"))))
    assert own.forms == {"ga": "ga", "gwo": "gwo"}


def test_the_script_runs(tmp_path):
    runs = list(study(1, cases=("Low F", "High Z"), history_points=20))
    answer = commands.script(SCRIPT, stored(tmp_path / "paper.db", runs))
    assert answer.code == 0, answer.err
    assert "| WOA is the best on High Gain | section 7.2, figure 5 | cannot be told |" in answer.out
    assert "| Average |" in answer.out
