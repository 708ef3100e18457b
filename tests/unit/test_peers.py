"""The simulators that benchmarks/peers times beside the lanes compute what the lanes compute."""

import numpy as np
import pytest
from benchmarks.peers import numba_single, numpy_batch, simulators
from benchmarks.peers.task import Task


@pytest.fixture(scope="module")
def task() -> Task:
    return Task.make(duration=0.01)


@pytest.fixture(scope="module")
def candidates() -> np.ndarray:
    return np.random.default_rng(7).random((6, 8))


@pytest.mark.parametrize("peer", [numpy_batch, numba_single])
def test_a_peer_at_the_same_step_gives_the_costs_of_the_lanes(peer, task, candidates):
    off = simulators.disagreement(peer.costs, task, candidates)
    assert off.max() < simulators.SAME_STEP


@pytest.mark.parametrize("peer", [numpy_batch, numba_single])
def test_a_peer_agrees_where_the_motor_turns_back_from_the_face_it_pushed(peer):
    # Small faults: the random candidates above do not get there. Without it 3e-5.
    mild = np.random.default_rng(2026).random((16, 8)) * [0.2, 0.02, 0.1, 0.1, 0.1, 1.0, 1.0, 1.0]
    off = simulators.disagreement(peer.costs, Task.make(duration=0.05), mild)
    assert off.max() < 1e-6


def test_a_peer_with_other_physics_is_seen_to_disagree(task, candidates):
    lighter = task.plant._replace(j_m=0.999 * task.plant.j_m)
    wrong = Task(**{**vars(task), "plant": lighter})
    off = simulators.disagreement(lambda _, k: numba_single.costs(wrong, k), task, candidates)
    assert off.max() > simulators.SAME_STEP
