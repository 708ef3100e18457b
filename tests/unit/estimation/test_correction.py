"""Minima of a reference model, found by a fast one that is off."""

import copy

import numpy as np
import pytest

from ematwin.errors import ParameterError
from ematwin.estimation.corrected_problem import corrected_at, exact_residuals
from ematwin.estimation.correction import corrected, with_model_error
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import laplace
from ematwin.estimation.prior import Information
from ematwin.estimation.problem import Problem
from naive.toy import BASES, NOISE, SAMPLES, OneChannel, fault, stacked

WEAR, GAP = 0.4, 0.3
FAULTS = [fault("wear"), fault("gap")]


def true_answer(wear, gap):
    return stacked(wear + 0.1 * gap**2, gap) @ BASES


class TwoModels(OneChannel):
    """A fast answer that is ``slope`` times as steep in wear and lacks a product."""

    def __init__(self, slope=1.1, lost=False):
        noise = NOISE * np.random.default_rng(3).standard_normal(SAMPLES)
        noise -= BASES.T @ (BASES @ noise) / SAMPLES  # the best point is the truth
        super().__init__(true_answer(WEAR, GAP)[0] + noise, NOISE)
        self.slope, self.lost, self.target, self.asked = slope, lost, self.recording.y, []

    def responses(self, candidates, count):
        return {"y": stacked(self.slope * candidates["wear"], candidates["gap"]) @ BASES}

    def residuals(self, candidates, count):
        return self.responses(candidates, count)["y"] - self.target

    def exact(self, values):
        self.asked.append(values)
        return {"y": true_answer(values["wear"], values["gap"])[0] + (np.nan if self.lost else 0.0)}

    def with_missed(self, missed):
        other = copy.copy(self)
        other.target = self.recording.y - missed["y"]
        return other


class OnlyTheReferenceHasALoop(TwoModels):
    """Its gain shifts a third feature of the reference alone."""

    unseen = frozenset({"loop.gain"})

    def __init__(self, gain):
        super().__init__()
        self.recording = self.recording.changed(y=self.recording.y + (gain - 1.0) * BASES[2])
        self.target = self.recording.y

    def exact(self, values):
        return {"y": super().exact(values)["y"] + (values.get("loop.gain", 1.0) - 1.0) * BASES[2]}


def ended(comparison, more=()):
    problem = Problem([comparison], [*FAULTS, *more])
    descent = Descent(settled=np.inf)
    start = np.r_[0.5, 0.5, np.ones(len(more))]
    return laplace(problem, start, descent), corrected(problem, start, descent)


def test_the_peak_is_that_of_the_reference_and_not_of_the_fast_model():
    first, end = ended(TwoModels())
    errors = np.sqrt(np.diag(end.peak.covariance))
    assert abs(first.point[0] - WEAR) > 3.0 * errors[0]
    assert not end.unsettled
    assert end.peak.point == pytest.approx([WEAR, GAP], abs=0.3 * errors.max())


def test_what_the_fast_model_misses_is_no_noise_once_it_is_corrected():
    _, end = ended(TwoModels())
    assert end.peak.problem.noise == pytest.approx(NOISE, rel=0.1)
    assert end.peak.problem.model_error == 1.0


@pytest.mark.parametrize("slope", [0.4, 3.0])
def test_secants_converge_where_rounds_alone_would_diverge_or_crawl(slope):
    _, end = ended(TwoModels(slope))
    assert not end.unsettled
    assert end.rounds <= 6
    assert end.peak.point[0] == pytest.approx(WEAR, abs=0.01)


class Edge(TwoModels):
    """A reference that diverges, or is an unstable loop, where the first round leads."""

    error: Exception | None = None

    def exact(self, values):
        if values["wear"] < 0.3:
            if self.error:
                raise self.error
            return {"y": np.full(SAMPLES, np.nan)}
        return super().exact(values)


@pytest.mark.parametrize("error", [None, ParameterError("the loop is unstable")])
def test_where_the_reference_has_no_answer_a_round_goes_half_way_back(error):
    comparison = Edge(slope=0.4)
    comparison.error = error
    _, end = ended(comparison)
    assert not end.unsettled
    assert end.peak.point == pytest.approx([WEAR, GAP], abs=0.01)


def test_what_only_the_reference_depends_on_is_learnt_through_it():
    gain = fault(
        "loop.gain", healthy=1.0, lower=0.2, upper=5.0, role="nominal", logarithmic=True, spread=0.4
    )
    comparison = OnlyTheReferenceHasALoop(1.3)
    comparison.expected_misfit = NOISE * np.sqrt(SAMPLES / comparison.scale)
    _, end = ended(comparison, [gain])
    assert end.peak.point == pytest.approx([WEAR, GAP, 1.3], abs=0.03)
    assert len(comparison.asked) == end.rounds + 2  # its slope, to both sides
    errors = np.sqrt(np.diag(end.peak.covariance)) * end.peak.problem.chart.widths
    assert errors[2] < 0.1 * 0.4


class Rough(TwoModels):
    """A reference that answers each candidate with a ripple of its own, as impacts do."""

    ripple = 0.5 * NOISE

    def exact(self, values):
        phase = 1e4 * (values["wear"] + values["gap"])
        wave = self.ripple * np.sqrt(2.0) * np.sin(phase + 2.0 * np.arange(SAMPLES))
        return {"y": super().exact(values)["y"] + wave}


class Scattering(OnlyTheReferenceHasALoop):
    """A reference whose every answer has another ripple, larger than the noise of the recording."""

    seed = 0

    def exact(self, values):
        own = hash((self.seed, values["wear"], values["gap"])) % 2**32
        ripple = np.random.default_rng(own).standard_normal(SAMPLES)
        return {"y": super().exact(values)["y"] + 3.0 * NOISE * ripple}


def test_where_answers_of_the_reference_scatter_rounds_end_and_intervals_hold():
    held, sizes = [], []
    for seed in range(40):
        comparison = Scattering(1.3)
        comparison.seed = seed
        problem = Problem([comparison], FAULTS, held={"loop.gain": 1.3})
        end = with_model_error(corrected(problem, np.array([0.5, 0.5]), Descent(settled=np.inf)))
        errors = np.sqrt(np.diag(end.covariance))
        held.append(np.abs(end.peak.point - [WEAR, GAP]) < 1.96 * errors)
        sizes.append(errors)
        assert len(comparison.asked) < 50  # rounds and regressions end
    assert 0.9 <= np.mean(held) <= 1.0
    assert np.median(sizes) > 2.0 * NOISE / np.sqrt(SAMPLES)  # noise is not all


def test_the_error_of_the_model_is_how_far_minima_move_where_they_are_corrected_elsewhere():
    twice = TwoModels(slope=2.0)
    _, end = ended(twice)
    error = np.sqrt(np.diag(with_model_error(end).model_error))
    # a slope twice as steep: half of where the truth may be is missed
    assert error[0] == pytest.approx(0.5 * np.sqrt(end.peak.covariance[0, 0]), rel=0.6)
    _, right = ended(TwoModels(slope=1.0))
    small = np.sqrt(np.diag(with_model_error(right).model_error))
    assert small[0] < 0.5 * error[0]


class Other(TwoModels):
    """Both models lack a part of the recording that is ten times its noise."""

    model_error, has_reference = 3.0, True

    def __init__(self):
        super().__init__()
        lacked = 10.0 * NOISE * BASES[3]
        self.recording = self.recording.changed(y=self.recording.y + lacked)
        self.target = self.recording.y
        self.expected_misfit = NOISE * np.sqrt(SAMPLES / self.scale)


def test_a_discrepancy_counts_by_the_model_error_and_noise_and_ripple_do_not():
    _, lacking = ended(Other())
    assert with_model_error(lacking).peak.problem.model_error == pytest.approx(3.0, rel=0.03)
    for one in (TwoModels, Rough):
        comparison = one()
        comparison.model_error = 3.0
        comparison.expected_misfit = NOISE * np.sqrt(SAMPLES / comparison.scale)
        _, end = ended(comparison)
        assert with_model_error(end).peak.problem.model_error < 1.3


WAYS = np.diag([0.2, 0.1])
START, EYE = np.array([0.5, 0.5]), np.eye(2)


def missed(problem, linear, *point):
    """What a regression misses of the reference at a point, root of the sum of squares."""
    there = np.array(point)
    left = exact_residuals(problem, there)[0] - linear.residuals(there[None])[0]
    return float(np.linalg.norm(left))


@pytest.mark.parametrize("slope", [0.0, 1.0, 9.0])
def test_a_regression_makes_up_for_slopes_that_the_fast_model_has_not(slope):
    comparison = TwoModels(slope)
    problem = Problem([comparison], FAULTS)
    linear = corrected_at(problem, START, ways=WAYS)
    assert len(comparison.asked) == 5
    curved = 0.1 * 0.1**2 * np.sqrt(SAMPLES)  # the product that no line has
    for point in ([0.5, 0.5], [0.7, 0.5], [0.3, 0.55], [0.45, 0.6]):
        assert missed(problem, linear, *point) < 2.0 * curved


def test_slopes_are_not_made_of_scatter():
    """Where the fast model is right a regression leaves it so, however the reference scatters."""
    made = []
    for seed in range(10):
        comparison = Scattering(1.3)
        comparison.seed, comparison.slope = seed, 1.0
        problem = Problem([comparison], FAULTS, held={"loop.gain": 1.3})
        linear = corrected_at(problem, START, ways=0.1 * WAYS)
        there = np.array([[0.9, 0.1]])  # 20 and 40 steps away
        change = linear.residuals(there) - linear.residuals(START[None])
        shapes = np.linalg.qr(BASES[:2].T)[0]
        made.append(np.linalg.norm(change - change @ shapes @ shapes.T))
    plain = 3.0 * NOISE * np.sqrt(SAMPLES) * np.hypot(20.0, 40.0) / np.sqrt(2.0)
    assert np.mean(made) < 0.15 * plain


def test_slopes_that_stand_out_of_scatter_are_found():
    comparison = Scattering(1.3)
    comparison.slope = 0.0
    problem = Problem([comparison], FAULTS, held={"loop.gain": 1.3})
    linear = corrected_at(problem, START, ways=20.0 * WAYS)  # as wide as the range
    change = linear.residuals(np.array([[0.7, 0.5]])) - linear.residuals(START[None])
    assert change[0] @ BASES[0] / SAMPLES == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize("start", [[0.0, 0.5], [1.0, 0.0]])
def test_at_a_bound_both_answers_lie_on_the_other_side(start):
    comparison = TwoModels(slope=0.0)
    problem = Problem([comparison], FAULTS)
    linear = corrected_at(problem, np.array(start), ways=WAYS)
    inside = np.clip(np.array(start) + 0.05, 0.0, 1.0)
    assert len(comparison.asked) == 5
    assert missed(problem, linear, *inside) < 0.05 * np.sqrt(SAMPLES) * 0.05


@pytest.mark.parametrize("lost", [False, True])
def test_where_knowledge_is_whole_the_closed_loop_is_checked_and_moves_nothing(lost):
    problem = Problem([OnlyTheReferenceHasALoop(1.0)], FAULTS)
    problem.comparisons[0].lost = lost
    z = problem.chart.from_values(np.array([[0.6, 0.2]]))[0]
    told = problem.informed(Information(problem.chart, z, 1e3 * EYE, np.zeros(2), {}, whole=True))
    end = corrected(told, np.array([0.5, 0.3]), Descent(settled=np.inf))
    assert end.peak.point == pytest.approx([0.6, 0.2], abs=5e-3)
    if lost:  # the reference has no answer: the fast model alone is left
        assert end.rounds == 0
        return
    left = told.comparisons[0].recording.y - true_answer(0.6, 0.2)[0]
    assert end.peak.cost == pytest.approx(left @ left)
    errors = np.sqrt(np.diag(end.covariance))
    assert errors == pytest.approx(1e-3, rel=0.01)
    assert with_model_error(end).covariance == pytest.approx(end.covariance)
