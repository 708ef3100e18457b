"""Pieces of the monitor model, and the whole of it, against scipy's integrator with events.

The independent solution (``tests/naive/hybrid.py``) has no steps: it finds the instants at which
a mass stops, breaks loose, meets the other or leaves it. The kernels must come close to it, and
closer in proportion when their step is shortened.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ematwin.models.bldc import batch
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.faults import Faults
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Scenario
from ematwin.numerics.backlash import advance_rigid_play
from ematwin.numerics.compile import loop, step
from ematwin.numerics.friction import (
    advance_on_bristles,
    advance_through_rest,
    fading,
    sliding_torque,
)
from naive import motor as naive_motor
from naive.hybrid import Mass, TwoMasses

ACTUATOR = BldcActuator.load()
C = kernel_constants(ACTUATOR)
INTERVAL = 1e-4  # s, between compared instants
HEALTHY = Faults()


def relative(seen, expected):
    return float(np.sqrt(np.mean((seen - expected) ** 2) / np.mean(expected**2)))


# One mass that sticks and slips under a torque

INERTIA, STATIC, DYNAMIC = 2.5e-6, 0.06, 0.03


@step
def torque_of_time(t):
    return 0.06 * math.sin(2.0 * math.pi * 20.0 * t) + 0.03 * math.sin(2.0 * math.pi * 73.0 * t)


@loop
def stick_slip(dt, substeps, samples):
    speeds = np.zeros(samples)
    w, t = 0.0, 0.0
    for sample in range(1, samples):
        for _ in range(substeps):
            act, before = torque_of_time(t + 0.5 * dt), torque_of_time(t - 0.5 * dt)
            w, _, _ = advance_through_rest(
                w, act, 1.0 / INERTIA, DYNAMIC, act, before, 1.0 / INERTIA, STATIC, DYNAMIC, dt
            )
            t += dt
        speeds[sample] = w
    return speeds


def test_stick_slip_of_one_mass_is_that_of_an_integrator_with_events():
    times = np.arange(1501) * INTERVAL
    far_away = TwoMasses(
        Mass(INERTIA, STATIC, DYNAMIC), Mass(1.0, 1.0, 1.0), 1e9,
        lambda t, y: torque_of_time(t), lambda t, y: 0.0,
    )  # fmt: skip
    states, log = far_away.run([0.0, 0.0, 0.0, 0.0], times)
    kinds = [what for _, what in log]
    assert kinds.count("motor breaks loose") >= 2
    assert kinds.count("motor stops") >= 3
    assert (states[:, 1] == 0.0).sum() > 50  # it sticks for whole stretches
    errors = [
        relative(stick_slip(INTERVAL / n, n, times.size), states[:, 1]) for n in (10, 20, 40, 80)
    ]
    assert errors[0] < 0.003
    assert errors[-1] < 0.3 * errors[0]


@loop
def on_bristles(dt, substeps, samples, stiffness, damping, w_stribeck):
    states = np.zeros((samples, 2))
    w, bent, t = 0.0, 0.0, 0.0
    for sample in range(1, samples):
        for _ in range(substeps):
            fade = fading(w, w_stribeck)
            w, bent = advance_on_bristles(
                w, bent, 0.7 * torque_of_time(t + 0.5 * dt), 1.0 / INERTIA,
                sliding_torque(DYNAMIC, STATIC / DYNAMIC, fade), stiffness, fade * damping, dt,
            )  # fmt: skip
            t += dt
        states[sample] = w, bent
    return states


def test_a_mass_on_bristles_is_that_of_an_integrator():
    stiffness, damping, w_stribeck = 20.0, 0.002, 1.5

    def slopes(t, x):
        w, z = x
        gone = math.exp(-((w / w_stribeck) ** 2))
        dz = w - stiffness * abs(w) * z / (DYNAMIC + (STATIC - DYNAMIC) * gone)
        act = 0.7 * torque_of_time.py_func(t)
        return (act - stiffness * z - damping * gone * dz) / INERTIA, dz

    times = np.arange(1001) * INTERVAL
    exact = solve_ivp(
        slopes, (0.0, times[-1]), [0.0, 0.0], method="LSODA", t_eval=times, rtol=1e-8, atol=1e-10
    ).y.T
    bends = np.array([abs(slopes(0.0, x)[1]) > 0.5 * abs(x[0]) for x in exact])
    assert 0.1 < bends.mean() < 0.9  # it gives, and it slides
    runs = [on_bristles(INTERVAL / n, n, times.size, stiffness, damping, w_stribeck)
            for n in (100, 200)]  # fmt: skip
    errors = [[relative(run[:, n], exact[:, n]) for n in (0, 1)] for run in runs]
    assert max(errors[0]) < 0.01
    assert np.less(errors[1], np.multiply(0.6, errors[0])).all()


# Two masses with a gap, inelastic impacts and friction, under a torque on the motor


@loop
def play(dt, substeps, samples, j_m, j_o, ts_m, td_m, ts_o, td_o, half_gap, viscous):
    states = np.zeros((samples, 4))
    x_m, w_m, x_o, w_o, t = 0.0, 0.0, 0.0, 0.0, 0.0
    for sample in range(1, samples):
        for _ in range(substeps):
            x_m, w_m, x_o, w_o, _, _, _ = advance_rigid_play(
                x_m, w_m, x_o, w_o, torque_of_time(t + 0.5 * dt) - viscous * w_m,
                torque_of_time(t - 0.5 * dt) - viscous * w_m, 0.0,
                1.0 / j_m, 1.0 / j_o, 1.0 / (j_m + j_o), j_o / (j_m + j_o),
                ts_m, td_m, ts_o, td_o, half_gap, dt,
            )  # fmt: skip
            t += dt
        states[sample] = x_m, w_m, x_o, w_o
    return states


def test_two_masses_with_a_gap_move_as_with_an_integrator_with_events():
    motor, output = Mass(2.5e-6, 0.015, 0.01), Mass(1e-6, 0.03, 0.02)
    half_gap, viscous = 0.3, 2e-4
    times = np.arange(1001) * INTERVAL
    exact = TwoMasses(
        motor, output, half_gap,
        lambda t, y: torque_of_time(t) - viscous * y[1], lambda t, y: 0.0,
    )  # fmt: skip
    states, log = exact.run([0.0, 0.0, 0.0, 0.0], times)
    kinds = [what for _, what in log]
    assert kinds.count("meet") >= 3
    assert {"part", "output stops"} <= set(kinds)
    errors = []
    for substeps in (10, 20, 40, 80, 160):
        seen = play(
            INTERVAL / substeps, substeps, times.size, motor.inertia, output.inertia,
            motor.static, motor.dynamic, output.static, output.dynamic, half_gap, viscous,
        )  # fmt: skip
        errors.append([relative(seen[:, n], states[:, n]) for n in range(4)])
    errors = np.array(errors)
    assert (errors[0] < 0.002).all()
    assert (errors[-1] < 0.25 * errors[0]).all()


# The current under a voltage limit


@pytest.mark.parametrize("speed", [0.0, 300.0, -500.0])
def test_current_rises_to_its_reference_as_the_supply_allows(speed):
    """L di/dt = V - R i - kappa w until the reference is reached, and stays there."""
    wanted = 8.0
    # the rotor is too heavy to change its speed, and the speed loop asks for all it may
    c = C._replace(mobility_m=1e-9, mobility_both=1e-9, k_demand=1e8, i_max=wanted, w_max=1e4)
    dt, samples = 1e-6, 600
    command = np.full(samples + 1, 1e6)
    motor = ACTUATOR.motor
    # the state holds the current in the middle of the step before
    slope = (ACTUATOR.drive.supply_voltage - motor.emf_constant * speed) / motor.inductance
    start = np.array([-0.5 * dt * slope, speed, 0.0, speed, 0.0, 0.0, -0.5 * dt * slope])
    trace = batch.monitor_trace(
        HEALTHY.vector, command, np.zeros_like(command), start, c, dt, 1, 1, None
    )

    def reached(t, i):
        return i[0] - wanted

    reached.terminal = True
    rise = solve_ivp(
        lambda t, i: (
            (ACTUATOR.drive.supply_voltage - motor.resistance * i - motor.emf_constant * speed)
            / motor.inductance
        ),
        (0.0, dt * samples), [0.0], events=reached, rtol=1e-10, atol=1e-12, dense_output=True,
    )  # fmt: skip
    middle = (np.arange(samples) + 0.5) * dt  # the trace holds the mean of each step
    expected = np.where(middle < rise.t[-1], rise.sol(np.minimum(middle, rise.t[-1]))[0], wanted)
    assert rise.status == 1
    np.testing.assert_allclose(trace[:, 0], expected, atol=2e-3 * wanted)


# The whole monitor model


def test_healthy_monitor_model_is_that_of_an_integrator_with_events():
    """The first 0.1 s of the default scenario, without reference to a step.

    Friction lets go, the gap is crossed, the masses meet and stop; later the motor reverses,
    leaves the output and meets it again on the other side.
    """
    gear, motor = ACTUATOR.transmission, ACTUATOR.motor
    kappa = motor.emf_constant  # healthy: the pair on its flats
    times = np.arange(1001) * INTERVAL
    grid = np.linspace(0.0, times[-1], 10 * (times.size - 1) + 1)
    command, load = Scenario.load_file("default").histories(grid)
    assert not load.any()

    def current(t, y):
        wanted = np.interp(t, grid, command) * gear.ratio
        return naive_motor.current_reference(wanted, y[2], y[1], HEALTHY, ACTUATOR)

    ripple = kappa * ACTUATOR.drive.hysteresis_band / 2.0
    static = max(motor.friction_torque, gear.static_ratio * motor.friction_torque - ripple)
    exact = TwoMasses(
        Mass(motor.inertia, static, motor.friction_torque),
        Mass(gear.output_inertia, gear.static_ratio * gear.friction_torque, gear.friction_torque),
        gear.backlash / 2.0,
        lambda t, y: kappa * current(t, y) - motor.viscous_damping * y[1],
        lambda t, y: 0.0,
    )
    fine = np.linspace(0.0, times[-1], 10 * (times.size - 1) + 1)
    states, log = exact.run([0.0, 0.0, 0.0, 0.0], fine)
    kinds = [what for _, what in log]
    assert kinds.count("meet") >= 2
    assert "both stop" in kinds
    # mean current of each interval, as the trace holds it
    current_now = np.array([current(t, y) for t, y in zip(fine, states, strict=True)])
    mean = (0.5 * (current_now[1:] + current_now[:-1])).reshape(-1, 10).mean(axis=1)
    states = states[::10]
    errors = []
    for substeps in (2, 4, 8):
        dt = INTERVAL / substeps
        steps = np.linspace(0.0, times[-1], substeps * (times.size - 1) + 1)
        trace = batch.monitor_trace(
            HEALTHY.vector, np.interp(steps, grid, command) * gear.ratio, np.zeros_like(steps),
            np.zeros(7), C, dt, 1, substeps, None,
        )  # fmt: skip
        errors.append(
            [
                relative(trace[:, 1], states[1:, 0]),
                relative(trace[:, 2], states[1:, 1]),
                relative(trace[:, 3], states[1:, 2]),
                relative(trace[:, 0], mean),
            ]
        )
    errors = np.array(errors)
    assert (errors[:, :3] < 5e-4).all()  # of steps of 50, 25 and 12.5 us
    assert errors[-1, 3] < 0.5 * errors[0, 3]
    # the independent solution lets the current jump after an impact; the supply does not
    assert errors[1, 3] < 0.01
