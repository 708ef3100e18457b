"""Life left beside closed forms of first passage; metrics beside their definitions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import gamma, invgauss

from ematwin.errors import InputError
from ematwin.fleet.learning import learn
from ematwin.fleet.life import Life, Requirement, job_left, life_left, paths, process_of, sooner
from ematwin.fleet.metrics import (
    alpha_lambda,
    convergence,
    cumulative_relative_accuracy,
    is_accurate,
    monotonicity,
    prognosability,
    prognostic_horizon,
    trendability,
)
from ematwin.fleet.trend import Series, Wear, trend
from ematwin.models.registry import load_actuator, model_of

LIMIT, SPEED, Q = 0.5, 0.2, 4e-3


def known(level=0.0, slope=SPEED, q=Q):
    """A trend whose level and slope are certain, and whose slope stays."""
    wear = Wear(np.zeros(6), np.full(6, 0.1), q, 1e-18, 1.0, 0.01, 1.0, 1.0)
    one = trend(Series(np.zeros(1), np.zeros(1), np.full(1, 1e-3), np.zeros((1, 2))), wear)
    one.mean, one.covariance = np.array([level, slope, 0.0]), 1e-18 * np.eye(3)
    return one


def test_wiener_life_is_inverse_gaussian():
    life = life_left("x", known(), LIMIT, 0.0, "wiener", draws=20_000)
    mean, shape = LIMIT / SPEED, LIMIT**2 / Q
    peer = invgauss(mean / shape, scale=shape)
    for share in (0.1, 0.5, 0.9):
        assert life.quantile(share) == pytest.approx(peer.ppf(share), rel=0.03)


def test_gamma_life_is_where_a_gamma_process_passes():
    life = life_left("x", known(), LIMIT, 0.0, "gamma", draws=20_000)
    for years in (1.8, 2.5, 3.2):
        peer = gamma.sf(LIMIT, SPEED**2 * years / Q, scale=Q / SPEED)
        assert life.within(years) == pytest.approx(peer, abs=0.02)


@pytest.mark.parametrize("process", ["wiener", "gamma"])
def test_life_counts_from_the_moment_and_downwards_too(process):
    later = life_left("x", known(), LIMIT, 1.0, process, draws=4000)
    assert later.median == pytest.approx(LIMIT / SPEED - 1.0, rel=0.1)
    down = life_left("x", known(slope=-SPEED), -LIMIT, 0.0, process, upwards=False)
    assert down.median == pytest.approx(LIMIT / SPEED, rel=0.1)


def test_what_is_beyond_its_limit_has_no_life_left_and_what_rests_lives_on():
    passed = life_left("x", known(0.6), LIMIT, 0.0)
    assert passed.interval == (0.0, 0.0)
    assert str(passed) == "none: beyond the limit"
    passed = known(0.6)
    passed.covariance = np.diag([1e-6, 4.0, 1e-18])  # its slope is of a few days
    assert life_left("x", passed, LIMIT, 0.5).interval == (0.0, 0.0)
    resting = life_left("x", known(0.1, 0.0, 1e-9), LIMIT, 0.0)
    assert str(resting) == "more than 10 years"


def test_the_sooner_of_two_lives_is_shorter_than_both():
    a = Life("a", np.array([1.0, 5.0, 3.0]), 0.0)
    b = Life("b", np.array([2.0, 1.0, 1.0]), 0.0)
    both = sooner([a, b])
    assert both.draws.tolist() == [1.0, 1.0, 1.0]
    assert both.name == "b"
    assert sooner([]) is None


def test_intervals_of_forecasts_from_a_few_estimates_hold_what_follows():
    held = []
    for seed in range(20):  # wear by powers of time and by exponentials
        random = np.random.default_rng(seed)
        time = np.linspace(0.0, 1.0, 30)
        power = time ** random.uniform(0.7, 2.2)
        level = random.uniform(0.1, 0.8) * (power if seed % 2 else np.expm1(3.0 * time) / 19.1)
        value = level + random.normal(0.0, 0.02, 30)
        series = Series(time, value, np.zeros(30), np.zeros((30, 2))).part(slice(20))
        ahead, to_come, _ = paths(trend(series, learn([series], 0.0, 1.0)), time[19], "wiener")
        low, high = np.quantile(to_come, [0.1, 0.9], axis=0)
        at = time[21::4] - time[19]
        held += list(np.interp(at, ahead, low) < level[21::4])
        held += list(level[21::4] < np.interp(at, ahead, high))
    assert 0.85 < np.mean(held) < 0.98  # 90 % on either side; paths are 20 only


@pytest.mark.parametrize("process", ["wiener", "gamma"])
def test_evidence_names_the_process_that_made_the_increments(process):
    random = np.random.default_rng(3)
    dt, slope, q = 0.02, 0.1, 1.5e-3
    several = []
    for _ in range(25):
        n = 150
        if process == "gamma":
            steps = random.gamma(slope**2 * dt / q, q / slope, n)
        else:
            steps = random.normal(slope * dt, np.sqrt(q * dt), n)
        value = np.cumsum(steps) + random.normal(0.0, 0.002, n)
        several.append(Series(dt * np.arange(1, n + 1), value, np.full(n, 0.002), np.zeros((n, 2))))
    wear = replace(learn(several, 0.0, 1.0), jump_rate=1e-9)
    assert process_of([trend(one, wear) for one in several]) == process


def test_an_actuator_does_its_job_until_its_twin_does_not():
    actuator = load_actuator("servo48")
    required = Requirement("following_error_rms", 0.0, "step")
    healthy = required.value(actuator, {})
    limit = required.value(actuator, {"friction": 0.25})
    assert limit > healthy
    required = replace(required, limit=limit)
    one = known(level=0.05, slope=0.2, q=1e-9)
    process = {"friction": "wiener"}
    life = job_left({"friction": one}, process, 0.0, actuator, required, draws=1)
    assert life.median == pytest.approx(1.0, rel=0.15)  # from 0.05 to 0.25 at 0.2 a year
    later = job_left({"friction": one}, process, 0.5, actuator, required, draws=1)
    assert later.median == pytest.approx(0.5, rel=0.3)
    failed = {"friction": known(level=0.3, slope=-1.0)}  # that it mends is no forecast
    assert job_left(failed, process, 0.5, actuator, required, draws=1).median == 0.0
    with pytest.raises(InputError, match="measures one of"):
        replace(required, measure="beauty").value(actuator, {})


def test_nothing_follows_a_command_of_another_unit(monkeypatch):
    actuator = load_actuator("servo48")
    kind = type(model_of(actuator))
    metres = [replace(c, unit="m") if c.name == "output_position" else c for c in kind.channels]
    monkeypatch.setattr(kind, "channels", tuple(metres))
    with pytest.raises(InputError, match="one of current_rms, current_peak; received"):
        Requirement("following_error_rms", 1.0, "step").value(actuator, {})


END = 10.0
PERFECT = [Life("x", np.full(50, END - t), t) for t in (2.0, 4.0, 6.0, 8.0)]


def test_perfect_predictions_have_the_best_metrics():
    assert prognostic_horizon(PERFECT, END) == 8.0
    assert alpha_lambda(PERFECT, END)
    assert cumulative_relative_accuracy(PERFECT, END) == 1.0
    assert convergence(PERFECT, END) == 0.0


def test_metrics_follow_their_definitions():
    late = [
        Life("x", np.full(50, (END - t) * f), t) for t, f in ((2.0, 2.0), (6.0, 1.5), (8.0, 1.1))
    ]
    assert [is_accurate(one, END) for one in late] == [False, False, True]
    # errors 8, 2 and 0.2; 20 % of the whole life is 2
    assert prognostic_horizon(late, END) == 4.0
    assert cumulative_relative_accuracy(late, END) == pytest.approx((0.0 + 0.5 + 0.9) / 3.0)
    # a rectangle of 4 x 8 and one of 2 x 2, centres at 4 and 7
    area = 32.0 + 4.0
    at = (32.0 * 4.0 + 4.0 * 7.0) / area - 2.0
    height = (32.0 * 4.0 + 4.0 * 1.0) / area
    assert convergence(late, END) == pytest.approx(np.hypot(at, height))
    with pytest.raises(InputError, match="before the end of life"):
        prognostic_horizon(late, 7.0)
    with pytest.raises(InputError, match="at least one prediction"):
        convergence([], END)


def test_health_indicators_by_their_definitions():
    rising = [np.linspace(0.0, 1.0, 20), np.linspace(0.0, 1.0, 30)]
    assert monotonicity(rising) == 1.0
    assert trendability(rising) == pytest.approx(1.0)
    assert prognosability(rising) == 1.0
    assert monotonicity([np.array([0.0, 1.0, 0.0])]) == 0.0
    assert prognosability([np.array([0.0, 1.0]), np.array([0.0, 3.0])]) == pytest.approx(
        np.exp(-np.std([1.0, 3.0], ddof=1) / 2.0)
    )
