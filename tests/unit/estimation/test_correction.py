"""Minima of a reference model, found by a fast one that is off."""

import copy

import numpy as np
import pytest

from ematwin.estimation.correction import corrected
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import laplace
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
        self.slope, self.lost, self.target, self.asked = slope, lost, self.recording.y, 0

    def responses(self, candidates, count):
        return {"y": stacked(self.slope * candidates["wear"], candidates["gap"]) @ BASES}

    def residuals(self, candidates, count):
        return self.responses(candidates, count)["y"] - self.target

    def exact(self, values):
        self.asked += 1
        return {"y": true_answer(values["wear"], values["gap"])[0] + (np.nan if self.lost else 0.0)}

    def with_missed(self, missed):
        other = copy.copy(self)
        other.target = self.recording.y - missed["y"]
        return other


class OneModel(TwoModels):
    def exact(self, values):
        return None


def ended(comparison):
    problem = Problem([comparison], FAULTS)
    descent = Descent(settled=np.inf)
    first = laplace(problem, np.array([0.5, 0.5]), descent)
    return first, corrected(problem, first, descent)


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


def test_each_round_takes_one_answer_of_the_reference():
    comparison = TwoModels()
    _, end = ended(comparison)
    assert comparison.asked == end.rounds


@pytest.mark.parametrize("comparison", [OneModel(), TwoModels(lost=True)])
def test_a_peak_stays_where_there_is_no_reference_or_it_diverges(comparison):
    first, end = ended(comparison)
    assert end.peak is first
    assert end.rounds == 0
