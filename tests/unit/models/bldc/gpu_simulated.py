"""The GPU's scores in numba-cuda's simulator; `test_gpu` runs this file with the simulator on."""

import threading
import time
from collections.abc import Sequence

import numpy as np
import pytest
from numba import config

import ematwin
from bldc_inputs import SEVERE, history
from ematwin import simulate
from ematwin.benchmarking.engines.cuda import CudaEngine
from ematwin.benchmarking.execute import execute
from ematwin.benchmarking.store import Store
from ematwin.benchmarking.study import run_study
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
from ematwin.testing.store_contract import small_plan

C = kernel_constants(BldcActuator.load())
RATE, SUBSTEPS, SAMPLES, KEPT = 20_000.0, 2, 101, 21
STEP = 1.0 / (RATE * SUBSTEPS)


# the simulator takes a tenth of a millisecond for a step
SHORT = ematwin.Scenario(
    name="short", duration=0.02, command=[{"type": "step", "value": 0.0175, "time": 0.005}]
)


@pytest.fixture(scope="module", autouse=True)
def simulator() -> None:
    assert config.ENABLE_CUDASIM


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
        own[:, C._fields.index("load_delay")] = np.linspace(-1e-3, 1e-3, len(k))
    work = gpu.Work(one, k, C if own is None else own, STEP, SUBSTEPS, rectify, KEPT)
    for ours, theirs in zip(gpu.launched([work])[0], of_lanes(k, one, own, rectify), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


@pytest.mark.filterwarnings("ignore:.*invalid value:RuntimeWarning")  # the simulator is numpy
def test_a_diverged_candidate_costs_infinity_and_spoils_no_other() -> None:
    k, one, own = random_faults(5), stretches(), np.tile(np.array(C), (5, 1))
    (clean, *_), sick = gpu.launched([gpu.Work(one, k, C, STEP, SUBSTEPS, True, 0)])[0], k.copy()
    sick[3, 0], sick[4, 5] = np.nan, np.inf
    own[2, C._fields.index("load_delay")] = np.nan
    costs, *_ = gpu.launched([gpu.Work(one, sick, own, STEP, SUBSTEPS, True, 0)])[0]
    assert np.isposinf(costs[2:]).all()
    np.testing.assert_array_equal(costs[:2], clean[:2])


def test_works_of_all_sorts_share_a_launch() -> None:
    k = random_faults(7)
    works = [
        gpu.Work(stretches(), k[:2], C, STEP, SUBSTEPS, True, KEPT),
        gpu.Work(stretches(power=False), k[2:5], C, STEP, SUBSTEPS, False, 21),
        gpu.Work(stretches(), k[5:], C, STEP / 2.0, 2 * SUBSTEPS, True, 0),
    ]
    together = gpu.launched(works)
    for work, found in zip(works, together, strict=True):
        for ours, alone in zip(found, gpu.launched([work])[0], strict=True):
            np.testing.assert_array_equal(ours, alone)
    assert [found[1].shape for found in together] == [(2, KEPT), (3, 21), (0, 0)]
    assert [found[2].shape for found in together] == [(2, KEPT), (0, 0), (0, 0)]


def test_works_that_threads_bring_during_a_launch_go_together_in_the_next() -> None:
    launcher, one, k = gpu.Launcher(), stretches(), random_faults(6)
    found: dict[int, np.ndarray] = {}

    def search(n: int) -> None:
        work = gpu.Work(one, k[n : n + 1], C, STEP, SUBSTEPS, True, 0)
        found[n] = launcher.scores(work)[0]

    threads = [threading.Thread(target=search, args=(n,)) for n in range(len(k))]
    with launcher._launching:
        for thread in threads:
            thread.start()
        while len(launcher._queue) < len(k):
            time.sleep(0.01)
    for thread in threads:
        thread.join()
    assert launcher.launches == 1
    whole = launcher.scores(gpu.Work(one, k, C, STEP, SUBSTEPS, True, 0))[0]
    np.testing.assert_array_equal(np.concatenate([found[n] for n in range(len(k))]), whole)


def test_an_error_reaches_all_that_wait_and_the_next_launch_is_well() -> None:
    launcher, k = gpu.Launcher(), random_faults(3)
    with pytest.raises(ValueError, match="broadcast"):
        launcher.scores(gpu.Work(stretches(), k, np.ones((3, 5)), STEP, 2, True, 0))
    work = gpu.Work(stretches(), k, C, STEP, SUBSTEPS, True, 0)
    assert np.isfinite(launcher.scores(work)[0]).all()


@pytest.mark.parametrize("evidence", [False, True])
def test_a_comparison_gives_what_it_gives_on_the_processor(record, evidence: bool) -> None:
    actuator = BldcActuator.load()
    k = random_faults(3)
    unknown = {name: k[:, n] for n, name in enumerate(Faults().as_dict())}
    unknown["motor.resistance"] = actuator.motor.resistance * np.array([0.9, 1.0, 1.1])
    there, here = (MODEL.compare(record, actuator, backend=b) for b in ("cuda", "cpu"))
    if evidence:
        there, here = there.with_evidence(), here.with_evidence()
    for ours, theirs in ((there, here), (there.restarted(), here.restarted())):
        np.testing.assert_allclose(ours.costs(unknown, 3), theirs.costs(unknown, 3), rtol=1e-9)
        before = gpu.LAUNCHER.launches
        residuals = ours.residuals(unknown, 3)
        assert gpu.LAUNCHER.launches == before + 1  # all stretches at once
        expected = theirs.residuals(unknown, 3)
        np.testing.assert_allclose(residuals, expected, rtol=1e-9, atol=1e-9 * expected.std())


def test_a_study_has_the_same_runs_and_shares_launches(tmp_path) -> None:
    plan = small_plan(algorithms=("pso", "gwo"), runs=2, population=4, iterations=2, scenario=SHORT)
    before = gpu.LAUNCHER.launches
    with Store(str(tmp_path / "study.db")) as store:
        tally = run_study(plan, store, CudaEngine(searches=8))
        stored = {run.spec.id: run.result for run in store.runs()}
    assert tally.counts == {"done": len(plan.specs())}
    batches = 1 + 2  # for each run at most: one to compile, and its generations
    assert gpu.LAUNCHER.launches - before < batches * len(plan.specs())
    for spec in plan.specs():
        assert stored[spec.id].provenance["kernel"] == "numba-cuda on a GPU"
        assert stored[spec.id].cost == pytest.approx(execute(spec).cost, rel=1e-6)
