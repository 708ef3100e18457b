import math

import numpy as np
import pytest

from ematwin import BldcActuator, Faults, Noise, Recording, simulate
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.faults import FAULTS

ACTUATOR = BldcActuator.load()
FAULTY = Faults(friction=0.2, backlash=0.1, gain=0.6)


class Misfit(BldcComparison):
    """The comparison, asked with fault vectors (B, 8)."""

    def __call__(self, k: np.ndarray) -> np.ndarray:
        return self.costs(by_name(k), len(k))

    def residuals_at(self, k: np.ndarray) -> np.ndarray:
        return self.residuals(by_name(k), len(k))

    def relative_misfit(self, cost: float) -> float:
        return math.sqrt(cost / self.scale)


def by_name(k: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(FAULTS, k.T, strict=True))


@pytest.fixture(scope="module")
def twin_record() -> Recording:
    return simulate("monitor", faults=FAULTY)


@pytest.mark.parametrize("places", [(), ("motor.inertia", "transmission.friction_torque")])
def test_costs_above_their_limits_are_infinite_on_any_number_of_threads(twin_record, places):
    random = np.random.default_rng(1)
    k = by_name(random.random((37, len(FAULTS))))
    k |= {place: ACTUATOR.value(place) * random.uniform(0.9, 1.1, 37) for place in places}
    costs = BldcComparison(twin_record, ACTUATOR, threads=1).costs(k, 37)
    limits = np.full(37, np.median(costs))
    for threads in (1, 2, 16):
        comparison = BldcComparison(twin_record, ACTUATOR, threads=threads)
        np.testing.assert_array_equal(
            comparison.costs_within(k, 37, limits), np.where(costs > limits, np.inf, costs)
        )
        np.testing.assert_array_equal(comparison.costs(k, 37), costs)


def test_magnitudes_are_compared_where_the_rotor_angle_is_not_known() -> None:
    record = simulate("reference", faults=FAULTY)
    assert not Misfit(record, ACTUATOR).rectify
    blind = record.changed(motor_position=None, motor_speed=None)
    objective = Misfit(blind, ACTUATOR)
    assert objective.rectify
    assert (objective.target >= -0.05).all()  # the low-pass undershoots a little
    assert objective.relative_misfit(objective(FAULTY.vector[None])[0]) < 0.01


def test_record_need_not_start_at_rest() -> None:
    whole = simulate("reference", faults=FAULTY)
    moving = whole.between(0.12, 0.5)
    assert abs(moving.motor_speed[0]) > 50.0  # type: ignore[index]
    objective = Misfit(moving, ACTUATOR)
    assert objective.relative_misfit(objective(FAULTY.vector[None])[0]) < 0.01


def test_masked_stretches_count_for_nothing(twin_record: Recording) -> None:
    current = twin_record.current.copy()  # type: ignore[union-attr]
    hole = (twin_record.time >= 0.2) & (twin_record.time <= 0.21)
    current[hole] = 0.0
    torn = twin_record.changed(current=current)
    told = torn.changed(provenance={"masked_s": [[0.2, 0.21]]})
    objective = Misfit(told, ACTUATOR)
    assert (objective.weights[hole] == 0.0).all()
    misfit = objective.relative_misfit(objective(FAULTY.vector[None])[0])
    blind = Misfit(torn, ACTUATOR)
    assert misfit < 0.2 * blind.relative_misfit(blind(FAULTY.vector[None])[0])


@pytest.mark.parametrize("white", [0.01, 0.05])
def test_the_noise_of_a_recording_leaves_the_misfit_that_was_measured_on_it(white: float) -> None:
    record = simulate("monitor", faults=FAULTY, noise=Noise(white=white), seed=4)
    objective = Misfit(record, ACTUATOR)
    left = objective.relative_misfit(objective(FAULTY.vector[None])[0])
    assert objective.recorded_noise == pytest.approx(left, rel=0.35)
