"""What is known of an actuator, in files and out of them, and what may have drifted since."""

import math
import tomllib
from dataclasses import asdict

import numpy as np
import pytest
import tomli_w

from ematwin import BldcActuator, simulate
from ematwin.errors import ParameterError
from ematwin.estimation.baseline import Baseline, ClosedLoop, baseline_of, with_all_free
from ematwin.estimation.prior import Prior
from ematwin.estimation.problem import Problem
from ematwin.models.registry import model_of

ACTUATOR = BldcActuator.load()
MODEL = model_of(ACTUATOR)
NAMES = ("motor.resistance", "motor.inertia", "load_gain")
KNOWN = Baseline(
    Prior(
        NAMES,
        np.array([math.log(1.2), math.log(2e-5), 1.0 / 3.0]),
        np.array([[4e-4, 1e-4, 0.0], [1e-4, 9e-4, -1e-5], [0.0, -1e-5, 1e-3]]),
    ),
    misfit=0.004,
    expected_misfit=1.0 / 300.0,
    scatter={"friction": 0.002, "gain": 1e-3},
    recordings=3,
    has_load=False,
    forms="Current loop of 50 us.",
    absent_forms=("cogging",),
    closed_loop=ClosedLoop(0.011, {"friction": 0.004}),
)


def through_toml(baseline: Baseline) -> Baseline:
    table = tomllib.loads(tomli_w.dumps({"baseline": baseline.as_table()}))
    return Baseline.from_table(table["baseline"], "mine.toml")


# Files


def test_a_baseline_returns_from_a_file_as_it_was() -> None:
    sheet = Baseline.of_template(MODEL, ACTUATOR)  # its misfits are not known
    for one in (KNOWN, sheet):
        np.testing.assert_equal(asdict(through_toml(one)), asdict(one))


def broken(**changes: object) -> dict[str, object]:
    return KNOWN.as_table() | changes


@pytest.mark.parametrize(
    "table",
    [
        {k: v for k, v in broken().items() if k != "covariance"},
        {k: v for k, v in broken().items() if k != "format"},
        broken(mean=[0.1, 0.2]),
        broken(mean="about one"),
        broken(covariance=[[1.0, 0.0], [0.0, 1.0]]),
        broken(covariance=[[1.0], [0.0, 1.0], []]),
        broken(mean=[0.1, math.nan, 0.2]),
        broken(names=3),
        broken(scatter=[0.1]),
        broken(scatter={"friction": "small"}),
        broken(recordings="three"),
        broken(closed_loop={"misfit": 0.1}),
        "a baseline",
        None,
    ],
)
def test_a_damaged_baseline_is_refused(table: object) -> None:
    with pytest.raises(ParameterError) as refusal:
        Baseline.from_table(table, "mine.toml")
    said = str(refusal.value)
    assert said.startswith("The baseline of mine.toml is damaged (")
    assert said.endswith("Make it anew with ematwin calibrate.")
    assert "\n" not in said


def test_a_damaged_file_or_one_of_a_newer_ematwin_is_refused_by_its_name(tmp_path) -> None:
    file = tmp_path / "mine.toml"
    for changes, said in (
        ({"mean": []}, r"mine\.toml is damaged"),
        (
            {"format": 99},
            r"of .*mine\.toml was written by a newer .* \(format 99, this one knows 1",
        ),
    ):
        file.write_text(tomli_w.dumps({"baseline": broken(**changes)}), encoding="utf-8")
        with pytest.raises(ParameterError, match=said):
            baseline_of(file, ACTUATOR)


# Tolerances and drifts


def test_a_tolerance_is_two_standard_deviations_of_the_logarithm() -> None:
    known = ACTUATOR.with_tolerances({"motor.resistance": "20 %"})
    prior = Baseline.of_template(MODEL, known).prior
    n = prior.names.index("motor.resistance")
    assert prior.mean[n] == pytest.approx(math.log(known.motor.resistance))
    assert math.exp(2.0 * math.sqrt(prior.covariance[n, n])) == pytest.approx(1.2)
    assert np.count_nonzero(prior.covariance) == len(prior.names)


def test_drift_widens_what_is_calibrated_and_nothing_else() -> None:
    drift = ACTUATOR.drift("motor.resistance")
    assert drift is not None
    assert ACTUATOR.drift("motor.inertia") is None
    found = KNOWN.drifted(ACTUATOR)
    widened = found.covariance - KNOWN.prior.covariance
    expected = np.diag([(0.5 * math.log1p(drift)) ** 2, 0.0, 0.0])
    assert np.allclose(widened, expected, atol=1e-15)
    assert (found.mean == KNOWN.prior.mean).all()
    sheet = Baseline.of_template(MODEL, ACTUATOR)  # its tolerances hold any drift
    assert not sheet.calibrated
    assert (sheet.drifted(ACTUATOR).covariance == sheet.prior.covariance).all()


def test_a_sum_that_healthy_recordings_told_stays_known_where_its_terms_move() -> None:
    """Of two frictions the sum is known to 0.1 %, and each to 15 %."""
    places = ("motor.friction_torque", "transmission.friction_torque")
    of_motor, of_gear = (ACTUATOR.value(place) for place in places)
    apart = np.array([1.0 / of_motor, -1.0 / of_gear]) * 0.15 * of_motor
    together = 1e-3 * np.ones(2)
    learnt = Prior(
        places,
        np.log([of_motor, of_gear]),
        np.outer(apart, apart) + np.outer(together, together) + 1e-10 * np.eye(2),
    )
    record = simulate("monitor", actuator=ACTUATOR)
    search = Problem([MODEL.compare(record, ACTUATOR)], MODEL.faults(ACTUATOR))
    baseline = Baseline(learnt, recordings=3, known=frozenset(places))  # and nothing drifts
    full = with_all_free(MODEL, ACTUATOR, search, baseline)
    point = full.start.copy()
    shift = 0.3 * of_motor  # two standard deviations
    for place, value in zip(places, (of_motor + shift, of_gear - shift), strict=True):
        point[full.names.index(place)] = value
    away = np.linalg.norm(full.prior_distances(point[None]) / full.noise)
    assert away == pytest.approx(2.0, rel=1e-3)
