"""Scores of candidates in lanes: trace, filter and misfit in one, each on its own."""

import math

import numpy as np
import pytest

from bldc_inputs import history
from ematwin.models.bldc import batch
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.faults import HEALTHY
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.lanes import LANES
from ematwin.numerics.signals import LowPass, SlopeWeighting
from naive import signals as naive_signals

C = kernel_constants(BldcActuator.load())
RATE, SUBSTEPS, SAMPLES = 20_000.0, 5, 1_201


def scoring(k, rectify=True):
    """Costs (B,), responses (B, S) and the target (S,) of a batch, with weights of the misfit."""
    command, load = history(SAMPLES - 1, 1.0 / RATE)
    target = 2.0 + np.sin(2.0 * math.pi * 80.0 * np.arange(SAMPLES) / RATE)
    weights = SlopeWeighting(500.0).weights(target, 1.0 / RATE)
    taps = LowPass(500.0).taps(RATE, float(target[0]))[None]
    costs, response = np.empty((1, len(k))), np.empty((1, len(k), SAMPLES))
    batch.monitor_scores(
        k, command, load, np.zeros(1, dtype=np.int64), SAMPLES, np.zeros((1, 7)), C, None,
        1.0 / (RATE * SUBSTEPS), SUBSTEPS, taps, rectify, target, weights, costs, response, None,
        np.full(len(k), np.inf), None,
    )  # fmt: skip
    return costs[0], response[0], target


def random_faults(count, seed=1):
    k = np.random.default_rng(seed).random((count, 8))
    k[0], k[1], k[2] = HEALTHY, 1.0, 0.0
    return k


@pytest.mark.parametrize("rectify", [True, False])
def test_scores_are_trace_then_filter_then_misfit(rectify):
    k = random_faults(LANES)
    costs, response, target = scoring(k, rectify)
    command, load = history(SAMPLES - 1, 1.0 / RATE)
    for n in range(LANES):
        trace = batch.monitor_trace(
            k[n], command, load, np.zeros(7), C, 1.0 / (RATE * SUBSTEPS), SUBSTEPS, 1, None,
        )  # fmt: skip
        current = np.abs(trace[:, 0]) if rectify else trace[:, 0]
        filtered = naive_signals.low_pass([target[0], *current], 500.0, RATE)
        np.testing.assert_allclose(response[n], filtered, rtol=0.0, atol=1e-7)
        expected = naive_signals.misfit(target, filtered, 1.0 / RATE, 500.0)
        assert costs[n] == pytest.approx(expected, rel=1e-7)


def test_a_diverged_candidate_costs_infinity_and_spoils_no_other():
    k = random_faults(2 * LANES)
    clean = scoring(k)[0]
    sick = k.copy()
    next_block = LANES + 8
    sick[5, 0], sick[next_block, 5], sick[next_block + 1] = np.nan, np.inf, np.nan
    costs, _, _ = scoring(sick)
    bad = np.isin(np.arange(len(k)), [5, next_block, next_block + 1])
    assert np.isposinf(costs[bad]).all()
    np.testing.assert_array_equal(costs[~bad], clean[~bad])
