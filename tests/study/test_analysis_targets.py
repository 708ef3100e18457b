"""Running times to absolute targets, ranks by other middles, what a test can tell at all."""

import math

import numpy as np
import pytest
from scipy import stats
from synthetic import done, failed, spec, study, vector

from ematwin.comparison.analysis.convergence import (
    TARGETS,
    evaluations_to_target,
    expected_by_case,
)
from ematwin.comparison.analysis.paper import standing_for
from ematwin.comparison.analysis.ranks import (
    average_ranks,
    compare_ranks,
    effect_sizes,
    least_p,
    mean_effect,
)
from ematwin.comparison.analysis.runs import collect
from ematwin.comparison.analysis.study import analyse
from ematwin.errors import InputError

SCALE = 400.0  # cost of a twin that does not answer, in the runs made here


def run(algorithm: str, number: int, *history: tuple[int, float], case: str = "Low F"):
    """A run whose history is given as evaluations and relative misfit."""
    pairs = [(n, SCALE * misfit**2) for n, misfit in history]
    return done(
        spec(case, algorithm, number), vector(friction=0.25), history=pairs,
        cost=pairs[-1][1], relative_misfit=history[-1][1], evaluations=history[-1][0],
    )  # fmt: skip


def test_running_times_of_a_worked_example():
    table = collect([
        run("de", 0, (10, 0.5), (100, 0.05), (300, 0.001)),
        run("de", 1, (10, 0.5), (400, 0.2)),
        run("ga", 0, (10, 0.6), (1000, 0.55)),
    ])  # fmt: skip
    ga, de = evaluations_to_target(table, (0.1, 0.02))
    assert (ga.algorithm, de.algorithm) == ("ga", "de")
    assert (de.reached, de.expected) == ({0.1: 0.5, 0.02: 0.5}, {0.1: 500.0, 0.02: 700.0})
    assert ga.share[-1] == 0.0
    assert ga.expected[0.1] == math.inf
    assert math.isnan(ga.interval[0.1][0])  # of one run there is nothing to draw
    met = [1.0, np.mean(TARGETS >= 0.2)]  # the first run met all, the second those above 0.2
    assert de.share[-1] == pytest.approx(np.mean(met))


def test_targets_do_not_move_when_an_algorithm_is_added():
    alone = [run("de", n, (10, 0.5), (100 + n, 0.05)) for n in range(4)]
    better = [run("ga", n, (10, 0.5), (100, 0.001)) for n in range(4)]
    (before,) = evaluations_to_target(collect(alone))
    after = evaluations_to_target(collect([*alone, *better]))[1]
    assert after.algorithm == "de"
    assert (before.reached, before.expected) == (after.reached, after.expected)
    assert before.share[-1] == after.share[-1]


def test_running_times_and_shares_agree_with_a_loop_over_runs():
    table = collect(_random_runs(5))
    for a, curve in enumerate(evaluations_to_target(table)):
        pairs, total, hits, spent = 0, np.zeros(len(curve.evaluations)), 0, 0.0
        for r in np.flatnonzero(table.algorithm == a):
            n, cost = table.history(r)
            misfit = np.sqrt(cost / SCALE)
            for target in TARGETS:
                pairs += 1
                first = next((k for k in range(len(n)) if misfit[k] <= target), None)
                if first is not None:
                    total += curve.evaluations >= n[first]
            first = next((k for k in range(len(n)) if misfit[k] <= 0.02), None)
            hits += first is not None
            spent += float(n[-1] if first is None else n[first])
        assert curve.share == pytest.approx(total / pairs)
        assert curve.expected[0.02] == pytest.approx(spent / hits if hits else math.inf)


def test_intervals_agree_with_a_bootstrap_that_draws_runs_one_by_one():
    runs = list(_random_runs(6))
    table = collect(runs)
    (ga, de) = evaluations_to_target(table)
    rng = np.random.default_rng(11)
    for curve in (ga, de):
        of = {
            case: [r for r in runs if (r.spec.case, r.spec.algorithm) == (case, curve.algorithm)]
            for case in table.cases
        }
        times, shares = [], []
        for _ in range(1500):
            drawn = [rng.choice(len(part), len(part)) for part in of.values()]
            again = [
                part[k].result.history
                for part, places in zip(of.values(), drawn, strict=True)
                for k in places
            ]
            met = [[n for n, cost in one if cost <= SCALE * 0.1**2] for one in again]
            spent = sum(m[0] if m else one[-1][0] for m, one in zip(met, again, strict=True))
            hits = sum(bool(m) for m in met)
            times.append(spent / hits if hits else math.inf)
            shares.append(
                np.mean([one[-1][1] <= SCALE * target**2 for one in again for target in TARGETS])
            )
        expected = np.quantile(times, [0.025, 0.975], method="inverted_cdf")
        assert curve.interval[0.1] == pytest.approx(expected, rel=0.08)
        ends = np.quantile(shares, [0.025, 0.975])
        assert (curve.share_low[-1], curve.share_high[-1]) == pytest.approx(ends, abs=0.02)


def _random_runs(seed: int):
    """Two algorithms on three cases, eight runs each."""
    rng = np.random.default_rng(seed)
    for case in ("Low F", "High F", "Low B"):
        for algorithm, pace in (("ga", 0.7), ("de", 1.6)):
            for number in range(8):
                n = np.cumsum(rng.integers(20, 200, 12))
                misfit = 0.6 * np.exp(-pace * np.cumsum(rng.exponential(0.25, 12)))
                pairs = zip(n.tolist(), misfit.tolist(), strict=True)
                yield run(algorithm, number, *pairs, case=case)


def test_a_failed_run_meets_no_target_and_a_study_of_failures_has_none():
    table = collect([run("de", 0, (10, 0.5), (100, 0.01)), failed(spec(algorithm="de", run=1))])
    (de,) = evaluations_to_target(table)
    assert de.reached[0.02] == 0.5
    (none,) = evaluations_to_target(collect([failed(spec())]))
    assert none.reached[0.02] == 0.0
    assert none.expected[0.02] == math.inf


def test_running_times_of_each_case_rank_unmet_targets_last_and_alike():
    table = collect([
        run("ga", 0, (10, 0.5), (100, 0.01)),
        run("de", 0, (10, 0.5), (50, 0.01)),
        run("gwo", 0, (10, 0.5), (70, 0.3)),
        run("da", 0, (10, 0.5), (90, 0.4)),
    ])  # fmt: skip
    found = expected_by_case(table, 0.02)
    assert found.tolist() == [[100.0, 50.0, math.inf, math.inf]]
    assert average_ranks(found).tolist() == [2.0, 1.0, 3.5, 3.5]


def test_average_ranks_are_those_of_scipy_over_whole_rows():
    values = np.random.default_rng(1).uniform(size=(6, 4))
    values[2, 1] = np.nan
    whole = np.delete(values, 2, axis=0)
    assert average_ranks(values) == pytest.approx(stats.rankdata(whole, axis=1).mean(axis=0))
    assert np.isnan(average_ranks(np.full((2, 3), np.nan))).all()


@pytest.mark.parametrize("blocks", [2, 6, 10, 13])
def test_least_p_is_scipys_where_one_always_wins(blocks):
    x = np.arange(1.0, blocks + 1.0)
    assert least_p(blocks) == pytest.approx(stats.wilcoxon(x, 3.0 * x, method="exact").pvalue)


def test_ten_blocks_and_fifteen_pairs_allow_no_p_below_three_hundredths():
    means = np.arange(6.0) + np.random.default_rng(2).uniform(0.0, 0.1, (10, 1))
    names = list("abcdef")
    found = compare_ranks(means, np.full((6, 6), 0.5), [str(n) for n in range(10)], names)
    assert found.smallest_holm == pytest.approx(0.029, abs=5e-4)
    assert min(pair.p_holm for pair in found.pairs) == pytest.approx(found.smallest_holm)


def test_too_many_pairs_for_the_cases_are_told():
    means = np.random.default_rng(3).uniform(size=(7, 12))
    found = compare_ranks(
        means, np.full((12, 12), 0.5), list("abcdefg"), [str(n) for n in range(12)]
    )
    assert found.smallest_holm == 1.0
    assert any("no corrected p" in note for note in found.notes)


def test_holm_and_wilcoxon_are_those_of_scikit_posthocs():
    posthocs = pytest.importorskip("scikit_posthocs")
    means = np.random.default_rng(4).uniform(0, 1, (12, 4)) + np.array([0.0, 0.3, 0.4, 0.9])
    names = list("abcd")
    found = compare_ranks(means, np.full((4, 4), 0.5), [str(n) for n in range(12)], names)
    theirs = posthocs.posthoc_wilcoxon(list(means.T), p_adjust="holm").to_numpy()
    assert found.significance() == pytest.approx(theirs)


def test_effect_size_of_a_case_counts_pairs_of_its_runs():
    table = collect(study(runs=5, algorithms=("ga", "de"), cases=("Low F", "High F")))
    a12 = effect_sizes(table)
    for c in range(2):
        ga, de = (table.scalars["err"][table.cell(c, a)] for a in range(2))
        wins = sum((x < y) + 0.5 * (x == y) for x in ga for y in de)
        assert a12[c, 0, 1] == pytest.approx(wins / 25.0)
        assert a12[c, 1, 0] == pytest.approx(1.0 - wins / 25.0)
    assert mean_effect(a12)[0, 1] == pytest.approx(a12[:, 0, 1].mean())


def test_coefficients_by_evaluations_do_not_depend_on_seconds():
    runs = list(study(runs=2))
    found = analyse(runs)
    errors = np.array([[cell.metrics["err"].mean for cell in row] for row in found.cells])
    share = errors / errors.sum(axis=1, keepdims=True)  # all spend the same here
    assert found.coefficients_by_evaluations == pytest.approx(100.0 * (1.0 - share))
    assert not np.allclose(found.coefficients, found.coefficients_by_evaluations)


def test_claims_are_judged_with_the_forms_as_published():
    both = ["ga-holland", "ga", "pso-inertia", "pso", "de-rand", "de", "gwo", "da", "woa"]
    assert list(standing_for(both).values()) == [
        "ga-holland", "pso-inertia", "de-rand", "gwo", "da", "woa"
    ]  # fmt: skip
    assert standing_for(["ga", "gwo", "cma"]) == {"ga": "ga", "gwo": "gwo"}
    published = ("ga-holland", "pso-inertia", "de-rand", "gwo", "da", "woa")
    found = analyse(study(runs=5, algorithms=(*published, "pso"), seed=3))
    (claim,) = [claim for claim in found.claims if "lowest mean Err% for low" in claim.text]
    place = found.table.algorithms.index("pso-inertia")
    low = [row[place].metrics["err"].mean for row in found.cells if row[0].case.startswith("Low")]
    assert f"PSO {np.mean(low):.3g}" in claim.evidence


@pytest.mark.parametrize("misfits", [(), (0.0,), (1.0,), (math.nan,)])
def test_senseless_misfits_are_refused(misfits):
    with pytest.raises(InputError, match="Misfits"):
        analyse(study(runs=1), misfits=misfits)


def test_the_six_of_a_preset_are_also_tested_among_themselves():
    six = ("ga-holland", "pso-inertia", "de-rand", "gwo", "da", "woa")
    alone = analyse(study(runs=2, algorithms=six, seed=3))
    assert alone.within == {}
    many = analyse(study(runs=2, algorithms=(*six, "pso", "de", "ga", "random"), seed=3))
    ranks = many.within["paper"]
    assert (len(ranks.pairs), len(many.ranks.pairs)) == (15, 45)
    errors = np.array([[cell.metrics["err"].mean for cell in row] for row in many.cells])
    for pair in ranks.pairs:
        first, second = (
            errors[:, many.table.algorithms.index(n)] for n in (pair.first, pair.second)
        )
        assert pair.p == pytest.approx(stats.wilcoxon(first, second).pvalue)
    assert any("preset paper alone" in sentence for sentence in many.conclusions)
