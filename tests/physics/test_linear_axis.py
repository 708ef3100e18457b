"""The linear axis against what is known without simulating it: limits, energy, linear systems."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

import ematwin
from ematwin.models.linear_axis.parameters import LinearAxis, loop_radius
from ematwin.models.linear_axis.twin import AxisState, axis_constants, axis_step, follow
from ematwin.recordings.recording import Recording

AXIS = LinearAxis.load().changed({"friction.standstill_ratio": 0.5})
# without what is not linear, and the same both ways
LINEAR = AXIS.changed({
    "friction.coulomb": 1e-12, "friction.viscous_ratio": 1.0, "drive.voltage_limit": 1e6,
})  # fmt: skip
INTERVAL = AXIS.controller.sample_time


def driven(axis: LinearAxis, voltage: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Time and position under a voltage from rest."""
    time = np.arange(voltage.size) * INTERVAL
    # a position that never moves says that it starts from rest
    rest = np.zeros(voltage.size)
    free = Recording(time, {"reference": rest, "voltage": voltage, "position": rest})
    return time, follow(axis, free, {}, 1, closed=False)["position"][0]


def quiet(*parts: np.ndarray) -> np.ndarray:
    """A voltage that begins with the samples from which the first state is taken, at rest."""
    return np.concatenate([np.zeros(30), *parts])


@pytest.mark.parametrize("way", [1, -1])
def test_a_constant_voltage_leads_to_the_speed_at_which_friction_takes_its_force(way):
    _, x = driven(AXIS, quiet(np.full(10_000, 2.0 * way)))
    speed = abs(x[-1] - x[-2]) / INTERVAL
    friction = AXIS.friction
    coulomb = friction.coulomb * friction.coulomb_ratio ** (-0.5 * way)
    viscous = friction.viscous * friction.viscous_ratio ** (-0.5 * way)
    near_rest = 1.0 / (1.0 + (speed / friction.fading_speed) ** 2)
    force = coulomb * (1.0 - 0.5 * near_rest) + viscous * speed
    assert force == pytest.approx(2.0 * AXIS.drive.gain, rel=1e-6)


@pytest.mark.parametrize(("share", "moves"), [(0.99, False), (1.01, True)])
def test_friction_holds_the_axis_up_to_that_at_standstill(share, moves):
    friction = AXIS.friction
    held = 0.5 * friction.coulomb / math.sqrt(friction.coulomb_ratio)
    _, x = driven(AXIS, quiet(np.full(200, share * held / AXIS.drive.gain)))
    assert (x[-1] > 0.0) == moves
    assert moves or not x.any()


def test_without_friction_mass_is_force_over_acceleration():
    axis = LINEAR.changed({"friction.viscous": 1e-9})
    time, x = driven(axis, quiet(np.full(1000, 3.0)))
    since = np.maximum(time - 30 * INTERVAL, 0.0)
    lag = axis.drive.response_time
    # twice the integral of 1 - exp(-t/T)
    left = since**2 / 2.0 - lag * since + lag**2 * (1.0 - np.exp(-since / lag))
    exact = 3.0 * axis.drive.gain / axis.carriage.mass * left
    np.testing.assert_allclose(x, exact, atol=1e-5 * exact[-1])


def test_small_motions_are_those_of_the_linear_sampled_loop():
    """scipy's zero-order hold of the continuous plant, with the controller's equations around."""
    drive, mass, control = LINEAR.drive, LINEAR.carriage.mass, LINEAR.controller
    viscous = LINEAR.friction.viscous
    a = np.array([
        [0.0, 1.0, 0.0],
        [0.0, -viscous / mass, drive.gain / mass],
        [0.0, 0.0, -1.0 / drive.response_time],
    ])  # fmt: skip
    b = np.array([[0.0], [0.0], [1.0 / drive.response_time]])
    ad, bd, *_ = cont2discrete((a, b, np.eye(3), np.zeros((3, 1))), INTERVAL)
    reference = 1e-3 * np.sin(2 * np.pi * 7.0 * np.arange(800) * INTERVAL)
    state, x_1, x_2 = np.zeros(3), 0.0, 0.0
    expected = []
    for wanted in reference:
        speed = (state[0] - x_2) / (2.0 * INTERVAL)
        demand = control.position_gain * (wanted - state[0])
        output = control.velocity_gain * (demand - speed)
        expected.append(output)
        x_1, x_2 = state[0], x_1
        state = ad @ state + bd[:, 0] * output
    start = Recording(np.arange(800) * INTERVAL, {"reference": reference})
    voltage = follow(LINEAR, start, {}, 1)["voltage"]
    gap = np.abs(voltage[0] - expected).max()
    assert gap < 1e-3 * np.abs(expected).max()
    finer = LINEAR.changed({"steps.twin": 0.5 * LINEAR.steps.twin})
    voltage = follow(finer, start, {}, 1)["voltage"]
    assert np.abs(voltage[0] - expected).max() == pytest.approx(gap / 4.0, rel=0.1)


def test_the_loop_decays_as_its_largest_eigenvalue_says():
    time = np.arange(400) * INTERVAL
    step = Recording(time, {"reference": np.where(time > 0.0, 1e-6, 0.0)})
    x = follow(LINEAR, step, {}, 1)["position"]
    left = np.abs(x[0] - 1e-6)
    envelope = [left[n : n + 80].max() for n in (100, 200)]
    assert (envelope[1] / envelope[0]) ** 0.01 == pytest.approx(loop_radius(LINEAR), rel=2e-3)


def test_motion_one_way_is_that_of_solve_ivp():
    """Friction is smooth there, so that any solver can do it."""
    friction, drive, mass = AXIS.friction, AXIS.drive, AXIS.carriage.mass
    coulomb = friction.coulomb / math.sqrt(friction.coulomb_ratio)
    viscous = friction.viscous / math.sqrt(friction.viscous_ratio)

    def rates(t, y):
        _, v, u = y
        near_rest = 1.0 / (1.0 + (v / friction.fading_speed) ** 2)
        rubbing = coulomb * (1.0 - 0.5 * near_rest) + viscous * v
        return [v, (drive.gain * u - rubbing) / mass, (2.0 - u) / drive.response_time]

    _, x = driven(AXIS, quiet(np.full(500, 2.0)))
    # from the sample on at which friction has let go: some microseconds after the step
    held = 0.5 * coulomb / drive.gain
    late = -drive.response_time * math.log(1.0 - held / 2.0)
    end = 499 * INTERVAL
    found = solve_ivp(rates, (late, end), [0.0, 0.0, held], rtol=1e-10, atol=1e-13, max_step=1e-3)
    assert x[-1] == pytest.approx(found.y[0, -1], rel=2e-4)


def test_halving_the_step_quarters_the_error():
    """Through reversals and rest, on the shipped scenario."""
    axis = AXIS.changed({"friction.standstill_ratio": 1.5})
    recording = ematwin.simulate(actuator=axis)
    command = Recording(recording.time, {"reference": recording.reference})
    traces = [
        follow(axis.changed({"steps.twin": INTERVAL / n}), command, {}, 1)["voltage"][0]
        for n in (2, 4, 8, 64)
    ]
    errors = [float(np.linalg.norm(one - traces[-1])) for one in traces[:-1]]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.min() > 1.3  # two where nothing turns; the samples at which it does are less
    assert errors[1] < 0.01 * np.linalg.norm(traces[-1])


def test_friction_never_adds_energy():
    """In no step does the mass gain more than the force does: the midpoint rule is exact there."""
    c = axis_constants(AXIS, {})
    rng = np.random.default_rng(1)
    dt = INTERVAL / AXIS.steps.within(INTERVAL)
    now, lost, turned = AxisState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), [], 0
    for voltage in np.repeat(rng.uniform(-4.0, 4.0, 100), 50):
        push = c.gain * (voltage + (now.u - voltage) * c.lagging) - c.offset
        after = axis_step(now._replace(output=voltage), 0.0, 0.0, c, dt)
        gained = 0.5 * AXIS.carriage.mass * (after.v**2 - now.v**2)
        lost.append(push * (after.x - now.x) - gained)
        turned += now.v * after.v < 0.0
        now = after
    assert turned > 10
    assert min(lost) > -1e-15
    assert sum(lost) > 0.1  # J


def test_an_axis_that_is_left_alone_slows_down_and_stays():
    _, x = driven(AXIS, quiet(np.full(60, 4.0), np.zeros(2000)))
    slower = np.diff(x)[95:]
    assert slower[0] > 0.0
    assert (np.diff(slower) <= 1e-15).all()
    assert slower[-1] == 0.0
