"""Each statistic of a study against a worked example, a library or an independent computation."""

import itertools
import json
import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from synthetic import done, failed, spec, study, vector

from ematwin.benchmarking.analysis import analyse
from ematwin.benchmarking.convergence import TARGETS, evaluations_to_target
from ematwin.benchmarking.plan import pack, unpack
from ematwin.benchmarking.statistics import (
    compare_ranks,
    diagnose,
    effect_sizes,
    performance_coefficients,
    spreads,
    summarise,
    vargha_delaney,
)
from ematwin.benchmarking.table import collect
from ematwin.errors import InputError
from ematwin.models.bldc.faults import PAPER_CASES

SCALE = 400.0  # cost of a twin that does not answer, in the runs made here
NO_EFFECTS = pd.DataFrame({"case": [], "first": [], "second": [], "a12": []})


def run(algorithm, number, *history, case="Low F"):
    """A run whose history is given as evaluations and relative misfit."""
    evaluations, misfits = zip(*history, strict=True)
    costs = SCALE * np.square(misfits)
    return done(
        spec(case, algorithm, number), vector(friction=0.25), history=pack(evaluations, costs),
        cost=float(costs[-1]), relative_misfit=misfits[-1], evaluations=evaluations[-1],
    )  # fmt: skip


def table_of(means):
    cases = [f"case {n}" for n in range(len(means))]
    return pd.DataFrame(means, index=cases, columns=list("abcdefghijkl")[: means.shape[1]])


# The table of the runs


def test_no_runs_and_runs_of_different_studies_are_refused():
    with pytest.raises(InputError, match="no runs"):
        collect([])
    with pytest.raises(InputError, match="of different studies"):
        collect([done(spec(), vector()), done(spec(run=1, box="remapped"), vector())])


# Middles, spreads, success, coefficients


def test_bootstrap_intervals_are_scipys_and_repeat_with_their_seed():
    sample = np.random.default_rng(4).exponential(1.0, 12)
    (found,) = spreads([sample], seed=7)
    expected = stats.bootstrap(
        (sample,), np.mean, n_resamples=999, method="percentile",
        random_state=np.random.default_rng(7),
    ).confidence_interval  # fmt: skip
    assert found[4:6] == pytest.approx((expected.low, expected.high))
    assert np.array_equal(found, spreads([sample], seed=7)[0])
    middles = (sample.mean(), *np.quantile(sample, [0.5, 0.25, 0.75]))
    assert found[:4] == pytest.approx(middles)


def test_spread_of_one_run_has_no_interval_and_of_none_no_middle():
    one, none, same = spreads([np.array([2.0]), np.array([]), np.array([1.0, 1.0])])
    assert one[0] == 2.0
    assert np.isnan(one[4:]).all()
    assert np.isnan(none).all()
    assert same[4:].tolist() == [1.0] * 4


def test_failed_runs_count_against_success_and_have_no_error():
    of = [spec(run=n) for n in range(4)]
    good = vector(friction=0.25)
    runs = [done(of[0], good), done(of[1], good), failed(of[2]), failed(of[3], "timeout")]
    (cell,) = summarise(collect(runs)).itertuples()
    assert (cell.runs, cell.done, cell.failed) == (4, 2, 2)
    assert cell.err_mean == 0.0
    assert summarise(collect(runs))["share_err_at_most_0.5"].tolist() == [0.5]


def test_coefficient_of_a_worked_example():
    # products 1, 2, 5 of 8 in all
    pc = performance_coefficients(np.array([1.0, 2.0, 5.0]), np.ones(3))
    assert pc == pytest.approx([87.5, 75.0, 37.5])
    without = performance_coefficients(np.ones(3), np.array([1.0, 3.0, np.nan]))
    assert without[:2] == pytest.approx([75.0, 25.0])
    assert math.isnan(without[2])
    assert np.isnan(performance_coefficients(np.ones(2), np.array([1.0, np.nan]))).all()
    assert np.isnan(performance_coefficients(np.ones(2), np.zeros(2))).all()


# Ranks and tests


def test_friedman_and_wilcoxon_are_those_of_scipy_over_case_means():
    means = np.random.default_rng(3).uniform(0, 1, (10, 4)) + np.array([0.0, 0.2, 0.4, 0.9])
    found = compare_ranks(table_of(means), NO_EFFECTS)
    expected = stats.friedmanchisquare(*means.T)
    assert (found.friedman, found.friedman_p) == pytest.approx(
        (expected.statistic, expected.pvalue)
    )
    by_hand = np.mean([[1 + sum(o < v for o in row) for v in row] for row in means], axis=0)
    assert list(found.average.values()) == pytest.approx(by_hand)
    for pair in found.pairs.itertuples():
        i, j = "abcd".index(pair.first), "abcd".index(pair.second)
        assert pair.p == pytest.approx(stats.wilcoxon(means[:, i], means[:, j]).pvalue)


def test_corrected_pairs_are_those_of_scikit_posthocs():
    posthocs = pytest.importorskip("scikit_posthocs")
    means = np.random.default_rng(4).uniform(0, 1, (12, 4)) + np.array([0.0, 0.3, 0.4, 0.9])
    found = compare_ranks(table_of(means), NO_EFFECTS)
    theirs = posthocs.posthoc_wilcoxon(list(means.T), p_adjust="holm").to_numpy()
    for pair in found.pairs.itertuples():
        expected = theirs["abcd".index(pair.first), "abcd".index(pair.second)]
        assert pair.p_holm == pytest.approx(expected)
        assert found.differ(pair.second, pair.first) == (expected < 0.05)


@pytest.mark.parametrize(
    ("cases", "methods", "smallest"), [(10, 6, 15 * 2.0**-9), (7, 12, 1.0), (6, 2, 2.0**-5)]
)
def test_the_least_corrected_p_is_met_where_one_always_wins(cases, methods, smallest):
    """Ten blocks and fifteen pairs, as in the paper's study, allow no p below 0.029."""
    means = np.arange(methods) * np.arange(1.0, cases + 1.0)[:, None]
    found = compare_ranks(table_of(means), NO_EFFECTS)
    assert found.smallest_holm == pytest.approx(smallest)
    assert found.pairs["p_holm"].min() == pytest.approx(found.smallest_holm)
    assert (smallest >= 0.05) == any("no corrected p" in note for note in found.notes)


def test_average_ranks_share_ties_and_leave_out_rows_that_are_not_whole():
    values = table_of(np.array([[1.0, 9.0, 9.0], [3.0, 2.0, 1.0], [1.0, np.nan, 2.0]]))
    assert compare_ranks(values, NO_EFFECTS).average == {"a": 2.0, "b": 2.25, "c": 1.75}
    none = compare_ranks(values.iloc[2:], NO_EFFECTS)
    assert all(math.isnan(rank) for rank in none.average.values())


def test_effect_size_of_a_case_counts_pairs_of_its_runs():
    rng = np.random.default_rng(2)
    x, y = rng.integers(0, 5, 7).astype(float), rng.integers(0, 5, 9).astype(float)
    wins = sum((a < b) + 0.5 * (a == b) for a, b in itertools.product(x, y))
    assert vargha_delaney(x, y) == pytest.approx(wins / 63.0)
    runs = [done(spec(algorithm="de"), vector(friction=0.9)), failed(spec(algorithm="ga"))]
    (row,) = effect_sizes(collect(runs)).itertuples()
    assert (row.first, row.second, row.a12) == ("ga", "de", 0.0), "a failed run loses to any other"


# Convergence


def test_running_times_of_a_worked_example():
    table = collect([
        run("de", 0, (10, 0.5), (100, 0.05), (300, 0.001)),
        run("de", 1, (10, 0.5), (400, 0.2)),
        run("ga", 0, (10, 0.6), (1000, 0.55)),
    ])  # fmt: skip
    curves, times = evaluations_to_target(table, (0.1, 0.02))
    de, ga = (times[times["algorithm"] == name] for name in ("de", "ga"))
    assert de["reached"].tolist() == [0.5, 0.5]
    assert de["expected"].tolist() == [500.0, 700.0]
    assert np.isinf(ga["expected"]).all()
    assert ga["low_95"].isna().all(), "of one run there is nothing to draw"
    last = curves.groupby("algorithm")["share"].last()
    assert last["ga"] == 0.0
    met = [1.0, np.mean(TARGETS >= 0.2)]  # the first run met all, the second those above 0.2
    assert last["de"] == pytest.approx(np.mean(met))


def random_runs(seed):
    """Two algorithms on three cases, eight runs each."""
    rng = np.random.default_rng(seed)
    for case in ("Low F", "High F", "Low B"):
        for algorithm, pace in (("ga", 0.7), ("de", 1.6)):
            for number in range(8):
                n = np.cumsum(rng.integers(20, 200, 12))
                misfit = 0.6 * np.exp(-pace * np.cumsum(rng.exponential(0.25, 12)))
                pairs = zip(n.tolist(), misfit.tolist(), strict=True)
                yield run(algorithm, number, *pairs, case=case)


def test_times_shares_and_intervals_agree_with_a_bootstrap_run_by_run():
    runs = list(random_runs(6))
    curves, times = evaluations_to_target(collect(runs))
    rng = np.random.default_rng(11)
    for algorithm in ("ga", "de"):
        of = [
            [unpack(r.history) for r in runs
             if (r.spec.case, r.spec.algorithm) == (case, algorithm)]
            for case in ("Low F", "High F", "Low B")
        ]  # fmt: skip

        def summed(histories):
            met = [n[cost <= SCALE * 0.1**2] for n, cost in histories]
            spent = sum(m[0] if len(m) else n[-1] for m, (n, _) in zip(met, histories, strict=True))
            hits = sum(map(len, met)) and sum(bool(len(m)) for m in met)
            shares = [cost[-1] <= SCALE * target**2 for _, cost in histories for target in TARGETS]
            return spent / hits if hits else math.inf, float(np.mean(shares))

        row = times[(times["algorithm"] == algorithm) & (times["misfit"] == 0.1)].iloc[0]
        last = curves[curves["algorithm"] == algorithm].iloc[-1]
        every = summed([one for part in of for one in part])
        assert (row["expected"], last["share"]) == pytest.approx(every)
        again = [
            summed([part[k] for part in of for k in rng.choice(len(part), len(part))])
            for _ in range(1000)
        ]
        (low, share_low), (high, share_high) = np.quantile(
            again, [0.025, 0.975], axis=0, method="inverted_cdf"
        )
        assert (row["low_95"], row["high_95"]) == pytest.approx((low, high), rel=0.08)
        assert (last["low_95"], last["high_95"]) == pytest.approx((share_low, share_high), abs=0.02)


def test_a_failed_run_meets_no_target_and_a_study_of_failures_has_none():
    table = collect([run("de", 0, (10, 0.5), (100, 0.01)), failed(spec(algorithm="de", run=1))])
    _, times = evaluations_to_target(table)
    assert times["reached"].tolist() == [0.5, 0.5, 0.0]
    _, none = evaluations_to_target(collect([failed(spec())]))
    assert none["reached"].tolist() == [0.0] * 3
    assert np.isinf(none["expected"]).all()


# Diagnosis


def test_diagnosis_counts_missed_false_and_confused():
    runs = [
        done(spec("Low Na", run=0), vector(short_a=0.3)),  # exact
        done(spec("Low Na", run=1), vector(short_b=0.3)),  # confused
        done(spec("Low Na", run=2), vector()),  # missed
        done(spec("Low Na", run=3), vector(short_a=0.3, gain=0.55)),  # false alarm
        done(spec("Low Na", run=4), vector(short_a=0.3, gain=0.54)),  # within the threshold
        failed(spec("Low Na", run=5)),
    ]
    (found,) = diagnose(collect(runs), 0.05).itertuples()
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
    (found,) = diagnose(collect(runs), 0.05).itertuples()
    assert (found.directions, found.direction_wrong) == (2, 1)
    assert found.exact == 3


# The whole analysis


def test_a_study_of_six_finds_the_order_that_was_put_in():
    six = analyse(study(6))
    assert (six.ranks.order[0], six.ranks.order[-1]) == ("de", "woa")
    assert six.ranks.friedman_p < 0.001
    text = " ".join(six.conclusions)
    assert text.count("measurement uncertainty") == 1
    assert "not measurement uncertainty" in text
    assert str(six).splitlines()[1:] == six.conclusions
    json.dumps(six.as_dict(), allow_nan=False)


def test_equal_algorithms_are_not_said_to_differ():
    rng = np.random.default_rng(8)
    runs = [
        done(of, np.clip(np.array(of.faults) + 0.01 * rng.standard_normal(8), 0, 1))
        for of in (
            spec(case, algorithm, n)
            for case in PAPER_CASES
            for algorithm in ("ga", "de", "pso")
            for n in range(5)
        )
    ]
    text = " ".join(analyse(runs).conclusions)
    assert "cannot be concluded" in text
    assert " before pso" not in text
    assert " before ga" not in text


@pytest.mark.parametrize(
    ("runs", "sentence"),
    [
        ([done(spec(), vector(friction=0.3))], "one algorithm only"),
        ([failed(spec()), failed(spec(run=1), "timeout")], "No run has a result"),
        (list(study(2, cases=("Low F", "High Z"))), "fewer than 5 runs"),
        ([done(spec(), vector()), failed(spec(algorithm="ga"))], "No result yet: ga on Low F"),
    ],
    ids=["one run", "all failed", "few runs", "a failed algorithm"],
)
def test_what_could_not_be_computed_is_said(runs, sentence):
    found = analyse(runs)
    assert any(sentence in text for text in found.conclusions), found.conclusions
    assert len(found.failures) == sum(one.status != "done" for one in runs)
    json.dumps(found.as_dict(), allow_nan=False)
    assert "<table" in found._repr_html_()


@pytest.mark.parametrize(
    "options",
    [
        {"targets": (0.0,)},
        {"targets": ()},
        {"threshold": 0.5},
        {"misfits": ()},
        {"misfits": (1.0,)},
    ],
)
def test_senseless_options_are_refused(options):
    with pytest.raises(InputError, match="must"):
        analyse(study(1, cases=("Low F",)), **options)  # type: ignore[arg-type]
