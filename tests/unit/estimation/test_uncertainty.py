"""Laplace, profile and posterior where the right answer can be worked out by hand."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ematwin
from ematwin import Recording
from ematwin.errors import InputError, MissingExtraError
from ematwin.estimation.joint import Joint
from ematwin.estimation.laplace import laplace, sharp_errors
from ematwin.estimation.posterior import (
    Posterior,
    PosteriorUncertainty,
    autocorrelation_times,
    split_rhat,
)
from ematwin.estimation.problem import Problem
from ematwin.estimation.profile import Profiles
from ematwin.estimation.spike_and_slab import fault_sets
from ematwin.estimation.thresholds import thresholds_of
from ematwin.estimation.uncertainty import LaplaceIntervals, Question
from ematwin.models.unknown import Unknown
from naive.toy import BASES, NOISE, SAMPLES, Toy, fault, stacked

FACTOR = 2.0
ERROR = FACTOR * NOISE / np.sqrt(SAMPLES)  # of what answers by one basis alone
QUICK = Posterior(effective=600.0, most=60_000)


def question(comparison, unknowns, *starts, thresholds=None):
    """What is asked of a toy whose search ended at ``starts``, the best first."""
    problem = Problem([comparison], unknowns)
    peaks = [laplace(problem, np.array(start, dtype=float)) for start in starts]
    own = sum(one.role == "fault" for one in unknowns)
    joint = Joint(tuple(peaks), FACTOR, own)
    names = problem.names[:own]
    sharp = dict(zip(names, sharp_errors(peaks[0], own, FACTOR).tolist(), strict=True))
    sets = fault_sets(problem.chart, peaks[0].unbounded(FACTOR), peaks[0].widened(FACTOR))
    ends = {
        one.name: sets.given(one.direction_of or one.name).interval(one.name, one.lower, one.upper)
        for one in problem.unknowns
    }  # fmt: skip
    intervals = {n: SimpleNamespace(low=low, high=high) for n, (low, high) in ends.items()}
    assessed = SimpleNamespace(
        values=problem.values(np.array(starts[0], dtype=float)),
        intervals=intervals, sets=sets, sharp_errors=sharp, strained={}, others=(),
    )  # fmt: skip
    limits = thresholds_of(thresholds or {}, unknowns, None)  # type: ignore[arg-type]
    return Question(problem, None, assessed, joint, limits)  # type: ignore[arg-type]


def run(method, asked, seed=1):
    return method.run(asked, seed=seed, report=lambda spent, most: None)


# wear times a size that is known to 5 %, and another fault on a basis of its own
SPREAD = 0.05
LINEAR = (fault("wear"), fault("gap"), Unknown(
    "part.size", "m", "", 1.0, 0.2, 5.0, "nominal", spread=SPREAD, logarithmic=True))  # fmt: skip


def linear(values):
    return stacked(values["wear"] + np.log(values["part.size"]), values["gap"])


@pytest.fixture(scope="module")
def asked():
    toy = Toy(linear, wear=0.4, gap=0.5, **{"part.size": 1.0})
    return question(toy, LINEAR, (0.41, 0.5, 1.0), thresholds={"wear": 0.45, "gap": 0.49})


@pytest.fixture(scope="module")
def by_posterior(asked):
    return run(QUICK, asked)


def test_three_methods_give_the_known_posterior_of_a_linear_problem(asked, by_posterior):
    wear = 1.96 * np.hypot(SPREAD, ERROR)
    for found in (run(LaplaceIntervals(), asked), run(Profiles(), asked), by_posterior):
        for name, middle, reach in (("wear", 0.4, wear), ("gap", 0.5, 1.96 * ERROR)):
            low, high = found.intervals[name]
            assert 0.5 * (low + high) == pytest.approx(middle, abs=0.2 * reach), found.method
            assert 0.5 * (high - low) == pytest.approx(reach, rel=0.15), found.method
        # by the noise of this record, 0.0906; three standard errors of 600 effective samples
        assert found.exceeds["wear"] == pytest.approx(0.165, abs=0.05), found.method
        assert found.exceeds["gap"] == pytest.approx(0.865, abs=0.05), found.method
        assert found.present == {"wear": pytest.approx(1.0), "gap": pytest.approx(1.0)}


def test_converged_chains_say_so_and_their_size(by_posterior):
    assert by_posterior.diagnostics.converged
    assert not any("converged" in doubt for doubt in by_posterior.doubts)
    assert "effective samples" in str(by_posterior)
    told = by_posterior.as_dict()
    assert told["diagnostics"]["converged"] is True
    assert told["exceeds"]["wear"]["threshold"] == "0.45"


def test_same_seed_same_draws(asked, by_posterior):
    again = run(QUICK, asked)
    np.testing.assert_array_equal(again.draws.values, by_posterior.draws.values)
    other = run(QUICK, asked, seed=2)
    assert not np.array_equal(other.draws.values[:50], by_posterior.draws.values[:50])


def test_what_only_the_prior_tells_is_named(by_posterior):
    assert any("adds nothing" in doubt and "part.size" in doubt for doubt in by_posterior.doubts)


def test_fault_without_information_is_named_and_its_interval_is_the_prior():
    toy = Toy(lambda v: stacked(v["gap"], 0.0 * v["wear"]), wear=0.3, gap=0.5)
    case = question(toy, LINEAR[:2], (0.3, 0.5))
    for method in (Profiles(), QUICK):
        found = run(method, case)
        low, high = found.intervals["wear"]
        assert low == 0.0
        assert high > 0.9
        assert any("no information on wear" in doubt for doubt in found.doubts), found.method


def test_uniform_prior_of_a_magnitude_is_uniform_on_its_circle():
    """In components a flat density would favour large magnitudes (Rayleigh: median 1.18 errors)."""
    size = fault("size")
    turn = fault("turn", healthy=0.5, direction_of="size")

    def components(values):
        phi = 2.0 * np.pi * values["turn"]
        return stacked(values["size"] * np.cos(phi), values["size"] * np.sin(phi))

    case = question(Toy(components, size=0.0, turn=0.5), (size, turn), (0.0, 0.5))
    found = run(Posterior(effective=800.0, most=80_000), case)
    error = FACTOR * case.joint.problem.noise / np.sqrt(SAMPLES)  # of the noise that is there
    assert np.median(found.draws.of("size")) == pytest.approx(0.674 * error, rel=0.12)
    assert found.intervals["size"][0] == 0.0
    quarters = np.histogram(found.draws.of("turn"), 4, (0.0, 1.0))[0] / len(found.draws.values)
    np.testing.assert_allclose(quarters, 0.25, atol=0.06)
    assert run(Profiles(), case).intervals["size"] == pytest.approx((0, 1.96 * ERROR), rel=0.1)


def test_fault_at_its_bound_has_half_a_normal_distribution():
    toy = Toy(lambda v: stacked(v["wear"], v["gap"]), wear=0.0, gap=0.5)
    case = question(toy, LINEAR[:2], (0.001, 0.5))
    error = ERROR * case.joint.problem.noise / NOISE  # by the noise that residuals show
    for method in (LaplaceIntervals(), Profiles(), QUICK):
        low, high = run(method, case).intervals["wear"]
        assert low == 0.0
        assert high == pytest.approx(1.96 * error, rel=0.12), method.name


def two_minima():
    """Two gaps that answer alike but for a little: exact weights by integration."""
    curve = 3.0

    def features(values):
        gap = values["gap"]
        return stacked(curve * (gap - 0.5) ** 2, 0.012 * (gap > 0.5))

    toy = Toy(features, gap=0.25)
    case = question(toy, (fault("gap"),), (0.25,), (0.75,))
    fine = np.linspace(0.0, 1.0, 20_001)[:, None]
    density = case.joint.log_density(case.joint.to_even(fine))
    weight = np.exp(density - density.max())
    return case, float(weight[fine[:, 0] > 0.5].sum() / weight.sum())


def test_posterior_weighs_two_minima_as_the_exact_integral_does():
    case, exact = two_minima()
    assert 0.1 < exact < 0.4
    found = run(Posterior(effective=600.0, most=100_000), case)
    assert found.diagnostics.converged
    share = float((found.draws.of("gap") > 0.5).mean())
    assert share == pytest.approx(exact, abs=0.05)
    assert found.valleys[1] == pytest.approx(exact, abs=0.05)
    assert any("Several answers" in sentence for sentence in found.sentences)
    assert any("this one only" in doubt for doubt in run(Profiles(), case).doubts)


def test_shapes_of_profiles_say_what_a_recording_cannot_tell():
    def features(values):
        return stacked(
            values["first"] + values["second"], values["bounded"],
            0.02 * np.minimum(values["capped"], 0.5), 0.0,
        )  # fmt: skip

    names = ("first", "second", "bounded", "capped")
    truth = {"first": 0.5, "second": 0.5, "bounded": 0.0, "capped": 0.9}
    unknowns = tuple(fault(name) for name in names)
    case = question(Toy(features, **truth), unknowns, tuple(truth.values()))
    walks = run(Profiles(), case).walks
    assert walks["bounded"].shape == "at its bound"
    assert walks["first"].shape == "flat"
    assert walks["first"].partners == ("second",)
    assert walks["capped"].shape == "flat"


def test_faults_that_make_up_for_one_another_are_named():
    def features(values):
        return stacked(values["first"] + values["second"], 0.1 * values["first"])

    toy = Toy(features, first=0.5, second=0.5)
    case = question(toy, (fault("first"), fault("second")), (0.5, 0.5))
    walk = run(Profiles(), case).walks["first"]
    assert walk.shape == "bounded"
    assert walk.partners == ("second",)
    reach = 1.96 * ERROR / 0.1
    assert walk.interval == pytest.approx((0.5 - reach, 0.5 + reach), abs=0.15 * reach)


def test_profile_of_a_logarithmic_fault_is_in_its_own_values():
    toy = Toy(lambda v: stacked(np.log(v["wear"])), wear=2.0)
    wear = fault("wear", healthy=1.0, lower=0.25, upper=4.0, logarithmic=True)
    found = run(Profiles(), question(toy, (wear,), (2.0,)))
    reach = np.exp(1.96 * ERROR)
    assert found.intervals["wear"] == pytest.approx((2.0 / reach, 2.0 * reach), rel=3e-3)


def test_ripple_hardly_moves_a_profile():
    def features(values):
        ripple = 0.7 * ERROR * np.sin(values["wear"] / (0.2 * ERROR))
        return stacked(values["wear"] + ripple, values["gap"])

    case = question(Toy(features, wear=0.5, gap=0.5), LINEAR[:2], (0.5, 0.5))
    intervals = run(Profiles(), case).intervals
    reach = 1.96 * ERROR
    for name in ("wear", "gap"):
        assert intervals[name] == pytest.approx((0.5 - reach, 0.5 + reach), abs=0.4 * reach), name


def test_error_of_the_model_widens_profiles_and_draws():
    toy = Toy(lambda v: stacked(v["wear"], v["gap"]), wear=0.5, gap=0.5)
    case = question(toy, LINEAR[:2], (0.5, 0.5))
    wider = replace(case, joint=replace(case.joint, scatter={"gap": 3.0 * ERROR}))
    for method in (Profiles(), QUICK):
        low, high = run(method, wider).intervals["gap"]
        assert 0.5 * (high - low) == pytest.approx(1.96 * np.sqrt(10.0) * ERROR, rel=0.1)


def test_a_step_of_the_misfit_ends_the_interval():
    """Within a standard error: regressions over the width do not see it sharper."""

    def features(values):
        return stacked(values["wear"] - 0.2 * (values["wear"] < 0.5 - ERROR))

    case = question(Toy(features, wear=0.5), LINEAR[:1], (0.5,))
    low, high = run(Profiles(), case).intervals["wear"]
    assert 0.5 - 1.2 * ERROR < low < 0.5
    assert high == pytest.approx(0.5 + 1.96 * ERROR, abs=0.4 * ERROR)


def test_a_profile_holds_the_answer_that_the_search_gave():
    toy = Toy(lambda v: stacked(v["wear"], v["gap"]), wear=0.5, gap=0.5)
    case = question(toy, LINEAR[:2], (0.5, 0.5))
    case.assessed.values["gap"] = 0.5 + 3.0 * ERROR
    ends = run(Profiles(), case).intervals["gap"]
    assert ends == pytest.approx((0.5 - 1.96 * ERROR, 0.5 + 3.0 * ERROR), abs=0.2 * ERROR)


def test_chains_that_have_not_arrived_are_said_to_be_so(asked):
    found = run(Posterior(most=500), asked)
    assert not found.diagnostics.converged
    assert any("have not converged: sampling reached its limit" in one for one in found.doubts)


def test_interrupted_chains_keep_what_they_have(asked):
    def pressed(spent, most):
        if spent > 2000:
            raise KeyboardInterrupt

    found = Posterior(effective=1e6).run(asked, seed=1, report=pressed)
    assert isinstance(found, PosteriorUncertainty)
    assert len(found.draws.values) > 100
    assert any("was interrupted" in doubt for doubt in found.doubts)


def test_interrupted_profiles_keep_what_they_have(asked):
    def pressed(spent, most):
        raise KeyboardInterrupt

    found = Profiles().run(asked, seed=1, report=pressed)
    assert any("interrupted" in doubt for doubt in found.doubts)


def test_intervals_hold_the_truth_as_often_as_they_promise():
    """Truth from the prior, noise as assumed: ranks are uniform, 95 % hold (16 records)."""
    rng = np.random.default_rng(3)
    held, ranks = [], []
    for _ in range(16):
        wear, gap, size = rng.uniform(0.3, 0.7), rng.random(), np.exp(SPREAD * rng.normal())
        toy = Toy(linear, wear=wear, gap=gap, **{"part.size": size})
        # noise of the size that the model's own error promises
        shift = FACTOR * NOISE * rng.standard_normal(SAMPLES) / 1.0
        y = toy.recording.y + BASES.T @ (BASES @ shift) / SAMPLES
        toy.recording = Recording(toy.recording.time, {"y": y})
        case = question(toy, LINEAR, (wear, gap, 1.0))
        found = run(Posterior(effective=100.0, most=6_500), case)
        for name, truth in (("wear", wear), ("gap", gap), ("part.size", size)):
            low, high = found.intervals[name]
            held.append(low <= truth <= high)
            ranks.append(float((found.draws.of(name) < truth).mean()))
    assert 0.87 <= np.mean(held) <= 1.0
    # chi-squared of four bins of 48 ranks: 99.9 % below 16.3 for three degrees of freedom
    counts, _ = np.histogram(ranks, 4, (0.0, 1.0))
    assert ((counts - 12.0) ** 2 / 12.0).sum() < 16.3


def test_of_parameters_alone_there_are_draws_and_no_profiles():
    size = Unknown("part.size", "m", "", 1.0, 0.2, 5.0, "nominal", logarithmic=True)
    toy = Toy(lambda v: stacked(np.log(v["part.size"])), **{"part.size": 1.2})
    case = question(toy, (size,), (1.2,))
    for method in (LaplaceIntervals(), Posterior(effective=100.0, most=6_500)):
        found = run(method, case)
        assert (found.present, found.healthy) == ({}, 1.0)
        assert found.intervals["part.size"][0] < 1.2 < found.intervals["part.size"][1]
    with pytest.raises(InputError, match=r"only part\.size was searched; search a fault"):
        run(Profiles(), case)


def test_too_few_walkers_are_refused(asked):
    with pytest.raises(InputError, match="at least twice the 3 unknowns; received 4"):
        run(Posterior(walkers=4), asked)


def test_chains_go_to_arviz_by_name_and_it_is_asked_for_where_it_is_missing(
    by_posterior, monkeypatch
):
    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(MissingExtraError, match=r'pip install "ematwin\[arviz\]"'):
        by_posterior.to_arviz()
    taken = SimpleNamespace(from_dict=lambda **groups: groups)
    monkeypatch.setitem(sys.modules, "arviz", taken)
    groups = by_posterior.to_arviz()
    steps, walkers, _ = by_posterior.chains.shape
    assert groups["posterior"]["wear"].shape == (walkers, steps)
    assert groups["sample_stats"]["lp"].shape == (walkers, steps)


def test_rhat_is_one_where_chains_agree_and_large_where_they_do_not():
    rng = np.random.default_rng(1)
    alike = rng.standard_normal((1000, 8, 1))
    assert split_rhat(alike) == pytest.approx(1.0, abs=0.01)
    assert split_rhat(alike + np.repeat([0.0, 1.0], 4)[:, None]) > 1.1
    assert split_rhat(alike + np.linspace(0.0, 3.0, 1000)[:, None, None]) > 1.1


def test_autocorrelation_time_of_a_known_process():
    """AR(1) with coefficient a: tau = (1 + a)/(1 - a)."""
    rng, a = np.random.default_rng(2), 0.8
    x = np.zeros((3000, 16, 1))
    for t in range(1, len(x)):
        x[t] = a * x[t - 1] + rng.standard_normal((16, 1))
    assert autocorrelation_times(x) == pytest.approx(9.0, rel=0.15)


def test_three_methods_agree_on_a_short_monitor_record():
    scenario = ematwin.Scenario(
        duration=0.12,
        command=[{"type": "chirp", "amplitude": 0.005, "f_start": 10.0, "f_end": 30.0}],
    )
    noise = ematwin.Noise(white=0.02)
    record = ematwin.simulate("monitor", scenario, {"friction": 0.3}, noise=noise, seed=3)
    only = ("friction", "gain")
    found = {
        how if isinstance(how, str) else how.name: ematwin.identify(
            record, exact=True, only=only, uncertainty=how, thresholds={"friction": "0.04 N*m"}
        ).uncertainty
        for how in ("laplace", "profile", Posterior(effective=200.0, most=8000))
    }
    assert found["posterior"].diagnostics.effective["friction"] > 200.0
    for name in only:
        low, high = found["laplace"].intervals[name]
        for one in found.values():
            assert one.intervals[name] == pytest.approx((low, high), abs=0.35 * (high - low))
    for one in found.values():
        assert one.exceeds["friction"] > 0.99
        assert one.thresholds["friction"] == "0.04 N m"
        assert one.intervals["friction"][0] < 0.3 < one.intervals["friction"][1]
