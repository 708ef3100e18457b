"""The GPU's scores in numba-cuda's simulator; `test_gpu` runs this file with the simulator on."""

from collections.abc import Sequence

import numpy as np
import pytest
from numba import config

import ematwin
from bldc_inputs import SEVERE, history
from ematwin import simulate
from ematwin.models.bldc import batch
from ematwin.models.bldc.channels import VOLTAGES
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.faults import HEALTHY, Faults
from ematwin.models.bldc.gpu import launch as gpu
from ematwin.models.bldc.model import MODEL
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.stretches import PowerStretches, Stretches
from ematwin.numerics.lanes import LANES
from ematwin.numerics.signals import LowPass

C = kernel_constants(BldcActuator.load())
RATE, SUBSTEPS, SAMPLES, KEPT = 20_000.0, 2, 101, 21
STEP = 1.0 / (RATE * SUBSTEPS)


SHORT = ematwin.Scenario(
    name="short", duration=0.01, command=[{"type": "step", "value": 0.0175, "time": 0.002}]
)


@pytest.fixture(scope="module", autouse=True)
def simulator() -> None:
    assert config.ENABLE_CUDASIM
    gpu.CANDIDATES_PER_CORE = 0


@pytest.fixture(scope="module")
def record():  # type: ignore[no-untyped-def]
    return simulate("reference", SHORT, Faults(**SEVERE), also=VOLTAGES)


def stretches(power: bool = True, starts: Sequence[int] = (0,)) -> Stretches:
    """Of a recording that is as long as the last one needs."""
    size = starts[-1] + SAMPLES
    command, load = history(size - 1, 1.0 / RATE)
    t = np.arange(size) / RATE
    target = 2.0 + np.sin(2.0 * np.pi * 80.0 * t)
    taps = np.stack([LowPass(500.0).taps(RATE, 2.0 + 0.1 * n) for n in range(len(starts))])
    states = np.outer(np.arange(len(starts)), [0.5, 1.0, 0.0, 1.0, 0.0, 0.1, 0.5])
    watts = PowerStretches(target, np.ones(size), 1.5 * taps[:, 5:])
    return Stretches(
        command, load, target, 1.0 + t, np.array(starts), SAMPLES, states, taps, KEPT,
        watts if power else None,
    )  # fmt: skip


def random_faults(count: int) -> np.ndarray:
    k = np.random.default_rng(1).random((count, 8))
    k[0], k[1], k[2] = HEALTHY, 1.0, 0.0
    return k


def of_lanes(k, some, own, rectify):  # type: ignore[no-untyped-def]
    shape = len(some), len(k)
    costs, response, watts = np.empty(shape), np.empty((*shape, KEPT)), np.empty((*shape, KEPT))
    batch.monitor_scores(
        k, some.command, some.load, some.starts, some.samples, some.states, C, own, STEP, SUBSTEPS,
        some.taps, rectify, some.target, some.weights, costs, response,
        (some.power.states, watts), np.full(len(k), np.inf), None,
    )  # fmt: skip
    return costs.sum(axis=0), np.hstack(response), np.hstack(watts)


@pytest.mark.parametrize(
    ("vary", "starts", "rectify"),
    [(False, (0,), True), (True, (0,), False), (True, (0, 40, 90), True)],
)
def test_scores_are_those_of_the_lanes(vary: bool, starts: Sequence[int], rectify: bool) -> None:
    k, one, own = random_faults(LANES), stretches(starts=starts), None
    if vary:
        own = np.array(C) * np.random.default_rng(3).uniform(0.9, 1.1, (len(k), len(C)))
        own[:, C._fields.index("pole_pairs")] = C.pole_pairs
        own[:, C._fields.index("load_delay")] = np.resize([-1e-3, 0.0, 7e-4], len(k))
    few = 4  # the simulator runs in Python
    work = gpu.Work(one, k[:few], C if own is None else own[:few], STEP, SUBSTEPS, rectify, KEPT)
    for ours, theirs in zip(gpu.scores(work), of_lanes(k, one, own, rectify), strict=True):
        np.testing.assert_allclose(ours, theirs[:few], rtol=1e-9, atol=1e-9)


@pytest.mark.filterwarnings("ignore:.*invalid value:RuntimeWarning")  # the simulator is numpy
def test_a_diverged_candidate_costs_infinity_and_spoils_no_other() -> None:
    k, one, own = random_faults(5), stretches(), np.tile(np.array(C), (5, 1))
    (clean, *_), sick = gpu.scores(gpu.Work(one, k, C, STEP, SUBSTEPS, True, 0)), k.copy()
    sick[3, 0], sick[4, 5] = np.nan, np.inf
    own[2, C._fields.index("load_delay")] = np.nan
    costs, *_ = gpu.scores(gpu.Work(one, sick, own, STEP, SUBSTEPS, True, 0))
    assert np.isposinf(costs[2:]).all()
    np.testing.assert_array_equal(costs[:2], clean[:2])


def test_nothing_is_kept_but_what_is_asked_for() -> None:
    k = random_faults(3)
    for power, kept, shapes in (
        (True, KEPT, (KEPT, KEPT)),
        (False, 21, (21, 0)),
        (True, 0, (0, 0)),
    ):
        work = gpu.Work(stretches(power=power), k, C, STEP, SUBSTEPS, True, kept)
        scores = gpu.scores(work)
        assert [found.shape[1] for found in scores[1:]] == list(shapes)
        assert all(len(found) == 3 for found in scores)


@pytest.mark.parametrize("evidence", [False, True])
def test_a_comparison_gives_what_it_gives_on_the_processor(record, evidence: bool) -> None:
    actuator = BldcActuator.load()
    k = random_faults(3)[[0, 1, 1]]  # a descent asks for the same candidate more than once
    unknown = {name: k[:, n] for n, name in enumerate(Faults().as_dict())}
    unknown["motor.resistance"] = actuator.motor.resistance * np.array([0.9, 1.1, 1.1])
    there, here = (MODEL.compare(record, actuator, backend=b) for b in ("cuda", "cpu"))
    if evidence:
        there, here = there.with_evidence(), here.with_evidence()
    for ours, theirs in ((there, here), (there.restarted(), here.restarted())):
        np.testing.assert_allclose(ours.costs(unknown, 3), theirs.costs(unknown, 3), rtol=1e-9)
        residuals = ours.residuals(unknown, 3)
        expected = theirs.residuals(unknown, 3)
        np.testing.assert_allclose(residuals, expected, rtol=1e-9, atol=1e-9 * expected.std())
