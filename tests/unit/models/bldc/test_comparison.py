import math

import numpy as np
import pytest

from ematwin import BldcActuator, Faults, Noise, Recording, simulate
from ematwin.errors import InputError, RecordError
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.faults import FAULTS, HEALTHY
from ematwin.models.bldc.stretches import initial_state
from ematwin.models.bldc.unknowns import FIXED
from ematwin.numerics.signals import LowPass

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


def test_costs_above_their_limits_are_infinite_on_any_number_of_threads(
    twin_record: Recording,
) -> None:
    k = by_name(np.random.default_rng(1).random((37, len(FAULTS))))
    costs = BldcComparison(twin_record, ACTUATOR, threads=1).costs(k, 37)
    limits = np.full(37, np.median(costs))
    for threads in (1, 2, 16):
        comparison = BldcComparison(twin_record, ACTUATOR, threads=threads)
        np.testing.assert_array_equal(
            comparison.costs_within(k, 37, limits), np.where(costs > limits, np.inf, costs)
        )
        np.testing.assert_array_equal(comparison.costs(k, 37), costs)


def test_a_coarse_comparison_looks_at_the_same_in_half_the_steps(twin_record: Recording) -> None:
    subject = BldcComparison(twin_record, ACTUATOR)
    candidates = by_name(np.array([FAULTY.vector, HEALTHY]))
    costs = subject.costs(candidates, 2)
    for one in (subject.coarse(), subject.coarse().smoothed(), subject.smoothed()):
        assert one.step == pytest.approx(2.0 * subject.step)
        assert len(one.recording) == 5_001
        assert one.substeps == 1
        near, far = np.sqrt(one.costs(candidates, 2) / one.scale)
        assert near < 6e-3
        assert far > 0.1
        # each sample stands for two: beside priors as much cost
        assert one.scale == pytest.approx(subject.scale, rel=0.15)
    assert subject.coarse().costs(candidates, 2)[1] == pytest.approx(costs[1], rel=0.02)
    assert subject.coarse().residuals(candidates, 2).shape == (2, 2_501)
    assert subject.smoothed().residuals(candidates, 2).shape == (2, 834)


def test_a_recording_that_is_sampled_slowly_stays_as_it_is(twin_record: Recording) -> None:
    """Of steps as long as the low-pass leaves room for, or as are stable."""
    slow = twin_record.changed(**{name: x[::4] for name, x in twin_record.columns()})
    subject = BldcComparison(slow, ACTUATOR)
    assert len(subject.coarse().recording) == len(slow)
    assert (subject.substeps, subject.coarse().substeps) == (4, 2)
    wide = BldcComparison(twin_record, ACTUATOR, low_pass=LowPass(2_000.0))
    assert len(wide.coarse().recording) == len(twin_record)


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


def test_short_constant_and_slow_records_are_refused(twin_record: Recording) -> None:
    with pytest.raises(RecordError, match="at least 100"):
        Misfit(twin_record.between(0.0, 0.002), ACTUATOR)
    flat = twin_record.changed(current=np.zeros(len(twin_record)))
    with pytest.raises(RecordError, match="constant"):
        Misfit(flat, ACTUATOR)
    with pytest.raises(InputError, match="2000 Hz"):
        Misfit(simulate("monitor", sample_rate=1000.0), ACTUATOR)


def test_a_refined_twin_is_nearer_to_one_with_very_short_steps(twin_record: Recording) -> None:
    usual = BldcComparison(twin_record, ACTUATOR)
    fine = usual.refined()
    short = BldcComparison(
        twin_record, ACTUATOR.changed({"steps.monitor": ACTUATOR.steps.monitor / 25})
    )
    k = by_name(FAULTY.vector[None])
    usual_far, fine_far = (
        np.abs(one.responses(k, 1)["current"] - short.responses(k, 1)["current"]).mean()
        for one in (usual, fine)
    )
    assert fine_far < 0.5 * usual_far
    assert usual.step == pytest.approx(4.0 * fine.step)


def test_thinned_residuals_of_a_long_record_have_the_same_cost() -> None:
    record = simulate("reference", faults=FAULTY, sample_rate=100_000.0)
    objective = Misfit(record, ACTUATOR)
    k = np.random.default_rng(8).random((5, 8))
    residuals = objective.residuals_at(k)
    assert residuals.shape[1] <= 20_000 < len(record)
    assert np.allclose((residuals**2).sum(axis=1), objective(k), rtol=5e-3)


def test_every_parameter_that_the_twin_uses_moves_the_answer_or_cannot_be_searched(
    twin_record: Recording,
) -> None:
    comparison = BldcComparison(twin_record, ACTUATOR)
    # current and travel limits are not reached here; the rest belongs to the reference model
    idle = {
        "drive.diode_drop", "drive.current_limit", "controller.speed_limit",
        "transmission.contact_stiffness", "transmission.contact_damping",
        "transmission.travel_low", "transmission.travel_high", "drive.supply_voltage",
        "motor.resistance", "motor.inductance", "motor.leakage_share",
    }  # fmt: skip
    for place, value, *_ in ACTUATOR.parameters():
        # less stiction changes nothing where the current breaks it loose at once
        other = 1.5 if place == "transmission.static_ratio" else 0.7
        pair = {place: np.array([value, other * value])}
        if place in FIXED:
            with pytest.raises(InputError, match="cannot be searched"):
                comparison.costs(pair, 2)
            continue
        before, after = comparison.costs(pair, 2)
        assert (before != after) or place in idle, place


@pytest.mark.parametrize("white", [0.01, 0.05])
def test_the_noise_of_a_recording_leaves_the_misfit_that_was_measured_on_it(white: float) -> None:
    record = simulate("monitor", faults=FAULTY, noise=Noise(white=white), seed=4)
    objective = Misfit(record, ACTUATOR)
    left = objective.relative_misfit(objective(FAULTY.vector[None])[0])
    assert objective.recorded_noise == pytest.approx(left, rel=0.35)
