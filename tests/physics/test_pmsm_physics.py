"""The reference model against what can be worked out on paper, and against itself."""

import math

import numpy as np
import pytest

from ematwin.models.pmsm.batch import reference_trace
from ematwin.models.pmsm.simulate import reference_states
from pmsm_inputs import ACTUATOR, SMOOTH, TICK, healthy, reference, smooth_move
from unit.models.pmsm.test_models import CASES, monitor, motion

STEPS = 50  # of 2 us in a tick
DAMPED = {**SMOOTH, "transmission.damping": 2e-3}  # so that motion becomes steady


def still(actuator):
    """The rotor held: so much friction that nothing moves it."""
    return actuator.changed({**SMOOTH, "motor.friction_torque": 1e6})


def test_a_locked_rotor_takes_the_current_of_its_resistance_and_time_constant():
    """A constant voltage along q: i = u/R (1 - exp(-R t/L)), without EMF."""
    motor = ACTUATOR.motor
    volts, step, count = 4.0, 1e-6, 8000
    c, now, loops, means = reference_states(still(ACTUATOR), healthy(), 0.0, step)
    # the current loops apply what they have pending; with no gain that stays
    c = c._replace(k_current=1e-12, k_voltage=0.0, set_flux=0.0, set_d=0.0, set_q=0.0)
    loops = loops._replace(total_q=volts, v_beta=volts)  # at angle zero q is beta
    trace, *_ = reference_trace(
        np.zeros(count // 100), np.zeros(count // 100), now, loops, means, c, step, 100,
        np.array(ACTUATOR.ticks), np.zeros(3), 1, count // 100,
    )  # fmt: skip
    time = np.arange(count // 100) * 100 * step
    wanted = (
        volts / motor.resistance * (1.0 - np.exp(-motor.resistance * time / motor.inductance_q))
    )
    np.testing.assert_allclose(trace[:, 1], wanted, atol=2e-4 * volts / motor.resistance)
    assert abs(trace[:, 0]).max() < 1e-9


def steady(actuator, speed, load, **faults):
    """Means of the last 20 ms of steady motion at a motor speed (rad/s) under a load (N m)."""
    count = round(0.4 / TICK) + 1
    command = speed * np.arange(count) * TICK
    found = reference(actuator, healthy(actuator, **faults), command, np.full(count, load))
    means = {name: float(np.mean(column[-200:])) for name, column in found.items()}
    means["loop_a_squared"] = float(np.mean(found["loop_a"][-200:] ** 2))
    taken = found["e_electrical"]
    means["power"] = float(taken[-1] - taken[-201]) / (200 * TICK)
    return means


@pytest.mark.parametrize("speed", [60.0, 110.0])
def test_no_load_motion_needs_the_emf_and_the_friction_and_nothing_else(speed):
    actuator = ACTUATOR.changed({
        **DAMPED, "motor.viscous_damping": 2e-4, "motor.friction_torque": 0.02,
        "transmission.static_ratio": 1.0,
    })  # fmt: skip
    motor, gear = actuator.motor, actuator.transmission
    found = steady(actuator, speed, 0.0)
    torque = 0.02 + (2e-4 + gear.viscous_damping) * speed
    i_q = torque / (1.5 * motor.pole_pairs * motor.flux)
    w_e = motor.pole_pairs * speed
    assert found["motor_speed"] == pytest.approx(speed, rel=1e-3)
    assert found["current_q"] == pytest.approx(i_q, rel=2e-3)
    assert abs(found["current_d"]) < 1e-3
    assert found["voltage_q"] == pytest.approx(motor.resistance * i_q + w_e * motor.flux, rel=1e-3)
    # voltages stand still for a tick while the rotor turns: some 1e-4 of their size
    wanted = pytest.approx(-w_e * motor.inductance_q * i_q, abs=3e-4 * found["voltage_q"])
    assert found["voltage_d"] == wanted
    lag = speed / actuator.controller.position_gain
    assert 0.4 * speed - found["output_position"] == pytest.approx(lag + 0.01 * speed, rel=2e-2)


def test_lost_flux_asks_for_more_current_and_less_voltage():
    actuator = ACTUATOR.changed(DAMPED)
    before, after = (steady(actuator, 110.0, 0.6, demagnetisation=k) for k in (0.0, 0.4))
    assert after["current_q"] / before["current_q"] == pytest.approx(1.0 / 0.8, rel=2e-3)
    emf = 110.0 * actuator.motor.pole_pairs * actuator.motor.flux
    drop = actuator.motor.resistance * (after["current_q"] - before["current_q"])
    assert after["voltage_q"] - before["voltage_q"] == pytest.approx(drop - 0.2 * emf, rel=5e-3)


def test_a_short_brakes_by_what_it_heats():
    """Voltages tell it from a warm magnet: the drive feeds a loop that does no work."""
    actuator = ACTUATOR.changed(DAMPED)
    before, after = (steady(actuator, 110.0, 0.6, short_a=k) for k in (0.0, 0.5))
    mu = 0.3 * math.sqrt(0.5)
    contact = actuator.motor.short_resistance
    volts = math.hypot(after["voltage_d"], after["voltage_q"])
    inside = contact + mu * (1.0 - 2.0 * mu / 3.0) * actuator.motor.resistance
    more = after["power"] - before["power"]
    loop = inside * after["loop_a_squared"] / mu**2
    assert loop < more < 1.05 * loop  # the rest heats the other turns, whose currents now ripple
    # peak values, the loop's reactance left out; the faulty phase sags by some per cent
    assert more == pytest.approx(0.5 * (mu * volts) ** 2 / inside, rel=0.1)
    assert after["voltage_q"] > 0.98 * before["voltage_q"]  # a magnet that lost so much would not


@pytest.mark.parametrize("faults", CASES.values(), ids=CASES)
def test_what_the_terminals_take_is_lost_stored_or_done_as_work(faults):
    actuator = ACTUATOR.changed({"drive.dead_time": 0.0, "drive.device_drop": 0.0})
    command, load = motion()
    values = healthy(actuator, **faults)
    found = reference(actuator, values, command, load, substeps=STEPS)
    motor = actuator.motor
    # magnetic energy at the end, from the currents of the coils: main flux and leakages
    mu = {x: 0.3 * math.sqrt(values[f"short_{x}"]) for x in "abc"}
    drawn = {x: found[f"loop_{x}"][-1] for x in "abc"}
    turned = [found[f"terminal_{x}"][-1] - drawn[x] for x in "abc"]
    angle = motor.pole_pairs * (
        found["motor_position"][-1] - math.radians(20.0) * (values["resolver_offset"] - 0.5)
        / motor.pole_pairs
    )  # fmt: skip
    vector = (
        2.0 / 3.0 * sum(i * np.exp(2j * np.pi * n / 3.0 - 1j * angle) for n, i in enumerate(turned))
    )
    stored = 0.75 * (
        (motor.inductance_d - motor.leakage) * vector.real**2
        + (motor.inductance_q - motor.leakage) * vector.imag**2
    )
    for n, x in enumerate("abc"):
        terminal = found[f"terminal_{x}"][-1]
        loop = terminal - (drawn[x] / mu[x] if mu[x] else 0.0)
        stored += 0.5 * motor.leakage * ((1.0 - mu[x]) * terminal**2 + mu[x] * loop**2)
        assert math.isfinite(turned[n])
    taken, lost, done = (found[f"e_{kind}"][-1] for kind in ("electrical", "copper", "mechanical"))
    assert taken == pytest.approx(lost + done + stored, abs=0.002 * (lost + abs(done) + stored))
    assert lost > 0.0


def test_shorter_steps_of_both_models_converge():
    command, load = motion()
    values = healthy(short_a=0.4, friction=0.3, connector_b=0.5)

    def gaps(answer, finest, *steps):
        fine, *others = (answer(step)["current_q"] for step in (finest, *steps))
        return [np.sqrt(np.mean((one - fine) ** 2) / np.mean(fine**2)) for one in others]

    found = gaps(lambda n: reference(ACTUATOR, values, command, load, substeps=n), 320, 5, 20, 80)
    assert found[0] > found[1] > found[2]
    assert found[1] < 0.003  # the shipped step of 5 us
    found = gaps(
        lambda step: monitor(values, command, load, step=step), 1.25e-6, 50e-6, 25e-6, 12.5e-6
    )
    assert found[0] < 0.005
    assert found[2] < 0.6 * found[1] < 0.6 * found[0]  # at least linearly


def test_a_limit_of_the_link_keeps_the_voltage_in_its_circle_and_does_not_wind_up():
    weak = ACTUATOR.changed({"drive.supply_voltage": 60.0})
    command = np.concatenate([smooth_move(ACTUATOR, 0.06, 14.0), np.full(4000, 14.0)])
    found = reference(weak, healthy(weak), command, np.zeros(command.size))
    size = np.hypot(found["voltage_d"], found["voltage_q"])
    assert size.max() == pytest.approx(60.0 / math.sqrt(3.0), rel=1e-6)
    assert found["output_position"][-1] == pytest.approx(14.0, abs=0.1)


def test_the_output_rests_on_its_end_stop():
    near = ACTUATOR.changed({"transmission.travel_high": 0.1})
    command = smooth_move(near, 0.15, 8.0)
    found = reference(near, healthy(near), command, np.zeros(command.size))
    assert found["output_position"].max() == pytest.approx(0.1 * near.transmission.ratio, rel=1e-6)


def test_the_wear_of_the_gap_is_what_motor_and_output_are_apart():
    actuator = ACTUATOR
    out = smooth_move(actuator, 0.2, 6.0)
    command = np.concatenate([out, out[::-1]])
    for k in (0.0, 0.5):
        found = reference(actuator, healthy(backlash=k), command, 0.0 * command)
        apart = np.abs(found["motor_position"] - found["output_position"]).max()
        half_gap = 0.5 * actuator.transmission.backlash * (1.0 + 9.0 * k)
        # on top of it the spring bends under inertia and friction
        assert half_gap < apart < half_gap + 0.5 / actuator.transmission.stiffness
