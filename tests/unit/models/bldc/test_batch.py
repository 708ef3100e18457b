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


def scoring(
    k, rectify=True, keep=True, target=None, c=C, by_candidate=None, power=None, limits=None
):
    """Costs, responses and the target of a batch, with weights of the misfit."""
    command, load = history(SAMPLES - 1, 1.0 / RATE)
    t = np.arange(SAMPLES) / RATE
    target = 2.0 + np.sin(2.0 * math.pi * 80.0 * t) if target is None else target
    weights = SlopeWeighting(500.0).weights(target, 1.0 / RATE)
    low_pass = LowPass(500.0)
    costs = np.empty((1, len(k)))
    response = np.empty((1, len(k), SAMPLES if keep else 0))
    batch.monitor_scores(
        k, command, load, np.zeros(1, dtype=np.int64), SAMPLES, np.zeros((1, 7)), c, by_candidate,
        1.0 / (RATE * SUBSTEPS), SUBSTEPS, low_pass.taps(RATE, float(target[0]))[None], rectify,
        target, weights, costs, response, power,
        np.full(len(k), np.inf) if limits is None else limits, None,
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


# Limits


@pytest.mark.parametrize("each", [False, True])
def test_costs_within_their_limits_are_the_same_bit_for_bit_and_the_others_infinite(each):
    """Ranks close many times, also where the load of each candidate is late by its own time."""
    k = random_faults(3 * LANES)
    constants = varied(len(k)) if each else None
    if each:
        constants[:, batch.LOAD_DELAY] = np.random.default_rng(5).uniform(0.0, 5e-3, len(k))
    costs, _, _ = scoring(k, keep=False, by_candidate=constants)
    limits = costs * np.random.default_rng(6).choice([0.0, 0.1, 0.5, 0.9, 1.0, 2.0], len(k))
    within, _, _ = scoring(k, keep=False, by_candidate=constants, limits=limits)
    np.testing.assert_array_equal(within, np.where(costs > limits, np.inf, costs))
    unhurt = scoring(k, keep=False, by_candidate=constants, limits=np.full(len(k), 1e300))[0]
    np.testing.assert_array_equal(unhurt, costs)  # in segments, and in one piece
    np.testing.assert_array_equal(costs, scoring(k, keep=True, by_candidate=constants)[0])


# Constants by candidate


def varied(count, seed=3):
    """(B, 32) constants of actuators that differ by up to a tenth; pole pairs are counted."""
    scale = np.random.default_rng(seed).uniform(0.9, 1.1, (count, len(C)))
    scale[:, C._fields.index("pole_pairs")] = 1.0
    return scale * np.array(C)
