import pickle

import numpy as np
import pytest

from ematwin import Actuator, Faults, Record, simulate
from ematwin.errors import InputError, RecordError
from ematwin.faults import HEALTHY
from ematwin.identification.objective import Objective, initial_state

ACTUATOR = Actuator.load()
FAULTY = Faults(friction=0.2, backlash=0.1, gain=0.6)


@pytest.fixture(scope="module")
def twin_record() -> Record:
    return simulate("monitor", faults=FAULTY)


def test_twin_explains_its_own_record(twin_record: Record) -> None:
    objective = Objective(twin_record, ACTUATOR)
    costs = objective(np.array([FAULTY.vector, HEALTHY]))
    # not zero: between samples the command is a straight line here, a chirp there
    assert objective.relative_misfit(costs[0]) < 1e-3
    assert objective.relative_misfit(costs[1]) > 0.1


def test_cost_is_the_sum_of_squared_residuals(twin_record: Record) -> None:
    objective = Objective(twin_record, ACTUATOR)
    k = np.random.default_rng(5).random((7, 8))
    squares = (objective.residuals(k) ** 2).sum(axis=1)
    assert np.allclose(objective(k), squares, rtol=1e-9)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_costs_do_not_depend_on_threads_or_batch(twin_record: Record, threads: int) -> None:
    k = np.random.default_rng(6).random((70, 8))
    whole = Objective(twin_record, ACTUATOR, threads=threads)(k)
    alone = np.concatenate(
        [Objective(twin_record, ACTUATOR, threads=1)(row[None]) for row in k[:9]]
    )
    assert (whole[:9] == alone).all()


def test_magnitudes_are_compared_where_the_rotor_angle_is_not_known() -> None:
    record = simulate("reference", faults=FAULTY)
    assert not Objective(record, ACTUATOR).rectify
    blind = record.changed(motor_position=None, motor_speed=None)
    objective = Objective(blind, ACTUATOR)
    assert objective.rectify
    assert (objective.target >= -0.05).all()  # the low-pass undershoots a little
    assert objective.relative_misfit(objective(FAULTY.vector[None])[0]) < 0.01


def test_record_need_not_start_at_rest() -> None:
    whole = simulate("reference", faults=FAULTY)
    moving = whole.between(0.12, 0.5)
    assert abs(moving.motor_speed[0]) > 50.0  # type: ignore[index]
    objective = Objective(moving, ACTUATOR)
    assert objective.relative_misfit(objective(FAULTY.vector[None])[0]) < 0.01


def test_first_state_falls_back_on_slopes_and_the_command() -> None:
    record = simulate("reference").between(0.1, 0.5)
    full = initial_state(record, ACTUATOR, 1.5)
    slopes = initial_state(record.changed(motor_speed=None, output_speed=None), ACTUATOR, 1.5)
    assert full[0] == slopes[0] == 1.5
    assert np.allclose(full[[1, 3]], slopes[[1, 3]], rtol=0.02)
    bare = record.changed(
        motor_position=None, motor_speed=None, output_position=None, output_speed=None
    )
    state = initial_state(bare, ACTUATOR, None)
    assert state[2] == state[4] == record.command[0] * ACTUATOR.transmission.ratio


def test_masked_stretches_count_for_nothing(twin_record: Record) -> None:
    current = twin_record.current.copy()  # type: ignore[union-attr]
    hole = (twin_record.time >= 0.2) & (twin_record.time <= 0.21)
    current[hole] = 0.0
    torn = twin_record.changed(current=current)
    told = torn.changed(provenance={"masked_s": [[0.2, 0.21]]})
    objective = Objective(told, ACTUATOR)
    assert (objective.weights[hole] == 0.0).all()
    misfit = objective.relative_misfit(objective(FAULTY.vector[None])[0])
    blind = Objective(torn, ACTUATOR)
    assert misfit < 0.2 * blind.relative_misfit(blind(FAULTY.vector[None])[0])


def test_objective_travels_to_other_processes(twin_record: Record) -> None:
    objective = Objective(twin_record, ACTUATOR)
    k = np.random.default_rng(7).random((40, 8))
    costs = objective(k)
    assert (pickle.loads(pickle.dumps(objective))(k) == costs).all()


def test_short_constant_and_slow_records_are_refused(twin_record: Record) -> None:
    with pytest.raises(RecordError, match="at least 100"):
        Objective(twin_record.between(0.0, 0.002), ACTUATOR)
    flat = twin_record.changed(current=np.zeros(len(twin_record)))
    with pytest.raises(RecordError, match="constant"):
        Objective(flat, ACTUATOR)
    with pytest.raises(InputError, match="2000 Hz"):
        Objective(simulate("monitor", sample_rate=1000.0), ACTUATOR)


def test_step_divides_the_sampling_interval() -> None:
    for rate in (2_000.0, 20_000.0, 30_000.0, 100_000.0, 250_000.0):
        objective = Objective(simulate("monitor", sample_rate=rate), ACTUATOR)
        assert objective.step <= ACTUATOR.steps.monitor * (1.0 + 1e-9)
        assert np.isclose(objective.step * objective.substeps, 1.0 / rate)


def test_thinned_residuals_of_a_long_record_have_the_same_cost() -> None:
    record = simulate("reference", faults=FAULTY, sample_rate=100_000.0)
    objective = Objective(record, ACTUATOR)
    k = np.random.default_rng(8).random((5, 8))
    residuals = objective.residuals(k)
    assert residuals.shape[1] <= 20_000 < len(record)
    assert np.allclose((residuals**2).sum(axis=1), objective(k), rtol=5e-3)
