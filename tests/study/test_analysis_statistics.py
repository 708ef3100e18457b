"""Each statistic against a worked example or an independent computation."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats
from synthetic import done, failed, spec, study, vector

from ematwin.comparison.analysis.convergence import bands
from ematwin.comparison.analysis.diagnosis import diagnose
from ematwin.comparison.analysis.paper import (
    PAPER_ALGORITHMS,
    TABLE_2,
    TABLE_2_AVERAGE,
    paper_coefficients,
)
from ematwin.comparison.analysis.performance import likeness_to_paper, performance_coefficients
from ematwin.comparison.analysis.ranks import compare_ranks, effect_sizes, holm, vargha_delaney
from ematwin.comparison.analysis.runs import collect, thinned
from ematwin.comparison.analysis.summary import spreads_of, summarise
from ematwin.errors import InputError
from ematwin.models.bldc.faults import PAPER_CASES


def test_papers_table_2_adds_up_to_500_per_case_within_its_rounding():
    assert set(TABLE_2) == set(PAPER_CASES)
    for row in TABLE_2.values():
        assert abs(sum(row) - 500) <= 6 * 0.5


def test_papers_averages_are_the_means_of_its_columns_within_rounding():
    means = np.mean(list(TABLE_2.values()), axis=0)
    assert np.abs(means - TABLE_2_AVERAGE).max() <= 1.0


def test_coefficient_of_a_worked_example():
    # products 1, 2, 5 of 8 in all
    pc = performance_coefficients(np.array([1.0, 2.0, 5.0]), np.array([1.0, 1.0, 1.0]))
    assert pc == pytest.approx([87.5, 75.0, 37.5])
    assert pc.sum() == pytest.approx(200.0)


def test_coefficients_of_six_add_up_to_500():
    rng = np.random.default_rng(1)
    pc = performance_coefficients(rng.uniform(1, 2, (10, 6)), rng.uniform(0.1, 9, (10, 6)))
    assert pc.sum(axis=1) == pytest.approx(500.0)


def test_shares_taken_from_table_2_give_table_2_back():
    table = paper_coefficients(list(TABLE_2), list(PAPER_ALGORITHMS))
    pc = performance_coefficients(np.ones((10, 6)), 100.0 - table)
    assert np.abs(pc - table).max() < 1.0  # the rows of the paper add up to 500 only nearly


def test_an_algorithm_without_result_leaves_the_sum():
    pc = performance_coefficients(np.ones(3), np.array([1.0, 3.0, np.nan]))
    assert pc[:2] == pytest.approx([75.0, 25.0])
    assert math.isnan(pc[2])
    assert np.isnan(performance_coefficients(np.ones(2), np.array([1.0, np.nan]))).all()
    assert np.isnan(performance_coefficients(np.ones(2), np.zeros(2))).all()


def test_the_papers_own_table_is_wholly_like_itself():
    cases, algorithms = list(TABLE_2), list(PAPER_ALGORITHMS)
    found = likeness_to_paper(paper_coefficients(cases, algorithms), cases, algorithms)
    assert found.cells.spearman == pytest.approx(1.0)
    assert found.average.kendall == pytest.approx(1.0)
    assert found.cells.pairs == 60
    turned = likeness_to_paper(-paper_coefficients(cases, algorithms), cases, algorithms)
    assert turned.cells.spearman == pytest.approx(-1.0)


def test_holm_follows_its_worked_example():
    # sorted 0.005, 0.01, 0.03, 0.04 times 4, 3, 2, 1, never falling
    assert holm(np.array([0.01, 0.04, 0.03, 0.005])) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_holm_leaves_unknown_values_out_of_the_count():
    assert holm(np.array([0.02, np.nan, 0.5]))[0] == pytest.approx(0.04)


def test_vargha_delaney_counts_pairs():
    rng = np.random.default_rng(2)
    x, y = rng.integers(0, 5, 7).astype(float), rng.integers(0, 5, 9).astype(float)
    wins = sum((a < b) + 0.5 * (a == b) for a, b in itertools.product(x, y))
    assert vargha_delaney(x, y) == pytest.approx(wins / 63.0)
    assert vargha_delaney(np.array([1.0]), np.array([2.0])) == 1.0


def test_friedman_and_wilcoxon_are_those_of_scipy_over_case_means():
    rng = np.random.default_rng(3)
    means = rng.uniform(0, 1, (10, 4)) + np.array([0.0, 0.2, 0.4, 0.9])
    names = ["a", "b", "c", "d"]
    found = compare_ranks(means, np.full((4, 4), 0.5), [f"c{n}" for n in range(10)], names)
    expected = stats.friedmanchisquare(*means.T)
    assert found.friedman == pytest.approx(expected.statistic)
    assert found.friedman_p == pytest.approx(expected.pvalue)
    by_hand = np.mean([[1 + sum(o < v for o in row) for v in row] for row in means], axis=0)
    assert found.average_ranks == pytest.approx(by_hand)
    for pair in found.pairs:
        i, j = names.index(pair.first), names.index(pair.second)
        assert pair.p == pytest.approx(stats.wilcoxon(means[:, i], means[:, j]).pvalue)
        assert pair.p_holm >= pair.p


def test_a_case_without_a_result_is_left_out_by_name():
    means = np.array([[1.0, 2.0], [np.nan, 1.0], [1.0, 3.0]])
    found = compare_ranks(means, np.full((2, 2), 0.5), ["x", "y", "z"], ["a", "b"])
    assert (found.blocks, found.left_out) == (["x", "z"], ["y"])
    assert any("y" in note for note in found.notes)
    assert math.isnan(found.friedman)


def test_bootstrap_interval_is_scipys_and_repeats_with_its_seed():
    sample = np.random.default_rng(4).exponential(1.0, 12)
    (found,) = spreads_of([sample], seed=7)
    expected = stats.bootstrap(
        (sample,), np.mean, n_resamples=999, method="percentile",
        random_state=np.random.default_rng(7),
    ).confidence_interval  # fmt: skip
    assert found.mean_interval == pytest.approx((expected.low, expected.high))
    assert found == spreads_of([sample], seed=7)[0]
    assert (found.mean, found.median) == pytest.approx((sample.mean(), np.median(sample)))
    assert found.iqr == pytest.approx(stats.iqr(sample))


def test_bootstrap_covers_the_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(5)
    found = spreads_of([rng.normal(3.0, 1.0, 30) for _ in range(400)], seed=1)
    covered = np.mean([low <= 3.0 <= high for low, high in (s.mean_interval for s in found)])
    assert 0.90 <= covered <= 0.98


def test_spread_of_one_run_has_no_interval_and_of_none_no_middle():
    one, none, same = spreads_of([np.array([2.0]), np.array([]), np.array([1.0, 1.0])])
    assert one.mean == 2.0
    assert math.isnan(one.mean_interval[0])
    assert math.isnan(none.mean)
    assert same.mean_interval == (1.0, 1.0)


def test_failed_runs_count_against_success_and_have_no_error():
    of = [spec(run=n) for n in range(4)]
    good = vector(friction=0.25)
    runs = [done(of[0], good), done(of[1], good), failed(of[2]), failed(of[3], "timeout")]
    ((cell,),) = summarise(collect(runs))
    assert (cell.runs, cell.done, cell.failed) == (4, 2, 2)
    assert cell.success[0.5] == 0.5
    assert cell.metrics["err"].mean == 0.0


def test_a_failed_run_loses_to_every_other():
    runs = [done(spec(algorithm="de"), vector(friction=0.9)), failed(spec(algorithm="ga"))]
    table = collect(runs)
    a12 = effect_sizes(table)
    assert a12[0, table.algorithms.index("de"), table.algorithms.index("ga")] == 1.0


def test_columns_do_not_depend_on_the_order_of_the_runs():
    runs = list(study(2, cases=("Low F", "High Z"), history_points=20))
    one, other = collect(runs), collect(reversed(runs))
    assert one.ids == other.ids
    assert np.array_equal(one.scalars["err"], other.scalars["err"])
    assert np.array_equal(one.history(3)[1], other.history(3)[1])
    assert one.algorithms == list(PAPER_ALGORITHMS)
    part = one.cell(1, 2)
    assert {one.ids[n] for n in range(part.start, part.stop)} == {
        r.spec.id for r in runs if (r.spec.case, r.spec.algorithm) == ("High Z", "de")
    }


def test_thinning_keeps_first_and_last_and_never_gains():
    rng = np.random.default_rng(6)
    history = list(zip(range(1, 1001), rng.exponential(1.0, 1000).tolist(), strict=True))
    evaluations, cost = thinned(history, most=20)
    best = np.minimum.accumulate([c for _, c in history])
    assert len(cost) <= 20
    assert (evaluations[0], evaluations[-1]) == (1, 1000)
    assert np.array_equal(cost, best[evaluations - 1])
    assert np.all(np.diff(cost) <= 0.0)


def test_thinning_drops_what_is_not_finite():
    evaluations, cost = thinned([(1, math.inf), (2, math.nan), (3, 5.0), (4, 6.0)])
    assert (evaluations.tolist(), cost.tolist()) == ([3, 4], [5.0, 5.0])
    assert len(thinned([])[0]) == 0


def _with_history(algorithm: str, run: int, *pairs: tuple[int, float]):
    return done(spec(algorithm=algorithm, run=run), vector(friction=0.25), history=pairs)


def test_band_is_the_quartiles_of_the_runs():
    table = collect([_with_history("de", n, (10, 10.0 + n), (100, 1.0 + n)) for n in range(5)])
    (band,) = bands(table, 0)
    assert (band.q1[0], band.median[0], band.q3[0]) == (11.0, 12.0, 13.0)
    assert (band.q1[-1], band.median[-1], band.q3[-1]) == (2.0, 3.0, 4.0)


def test_diagnosis_counts_missed_false_and_confused():
    runs = [
        done(spec("Low Na", run=0), vector(short_a=0.3)),  # exact
        done(spec("Low Na", run=1), vector(short_b=0.3)),  # confused
        done(spec("Low Na", run=2), vector()),  # missed
        done(spec("Low Na", run=3), vector(short_a=0.3, gain=0.55)),  # false alarm
        done(spec("Low Na", run=4), vector(short_a=0.3, gain=0.54)),  # within the threshold
        failed(spec("Low Na", run=5)),
    ]
    (found,) = diagnose(collect(runs), 0.05)
    assert (found.runs, found.without, found.exact) == (5, 1, 2)
    assert (found.missed, found.faults) == (2, 5)
    assert (found.false_alarms, found.chances) == (2, 5 * 6)
    assert found.confused == 1
    assert found.confusions == {("short_a", "short_b"): 1}


def test_direction_counts_only_with_eccentricity_and_as_an_angle():
    ahead = {"faults": tuple(vector(eccentricity=0.5, eccentricity_phase=0.01).tolist())}
    runs = [
        done(spec("Low F", run=0), vector(friction=0.25, eccentricity_phase=0.9)),
        done(spec("z", run=0, **ahead), vector(eccentricity=0.5, eccentricity_phase=0.99)),
        done(spec("z", run=1, **ahead), vector(eccentricity=0.5, eccentricity_phase=0.5)),
    ]
    (found,) = diagnose(collect(runs), 0.05)
    assert (found.directions, found.direction_wrong) == (2, 1)
    assert found.exact == 3


def test_no_runs_are_refused():
    with pytest.raises(InputError, match="no runs"):
        collect([])
