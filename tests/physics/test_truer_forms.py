"""The truer forms: energy, limits, convergence, a simulator not ours, and what is identified."""

import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ematwin
from bldc_inputs import HALF, equivalent, misfit
from ematwin.errors import ParameterError
from ematwin.models.bldc import batch
from ematwin.models.bldc.channels import phase_currents, signed_current
from ematwin.models.bldc.constants import TruerState, fault_state, kernel_constants, truer_constants
from ematwin.models.bldc.faults import FAULTS, Faults, error_percent
from ematwin.models.bldc.motor import gap_factors, loop_answer, torque_of_cogging, truer_shapes
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.simulate import reference_answer
from ematwin.models.registry import load_actuator
from ematwin.models.scenario import Scenario, Step
from ematwin.models.simulating import simulate
from ematwin.numerics.compile import plain
from ematwin.recordings.noise import Noise
from naive import another_actuator

PLAIN = BldcActuator.load()
LOOP = PLAIN.changed({"shorted_turns.resistance": 0.1})
FIXED = PLAIN.changed({"eccentricity.turning_share": 0.0})
COGGING = {"cogging.torque": 0.002, "cogging.cycles": 12, "cogging.phase": 0.7}
COGGED = PLAIN.changed(COGGING)
ROUNDED = PLAIN.changed({"emf.rounding": 0.5})
PRESLIDING = {
    "presliding.motor_stiffness": 100.0, "presliding.output_stiffness": 100.0,
    "presliding.damping": 0.01, "presliding.stribeck_speed": 2.0,
}  # fmt: skip
HEAT = {"winding_heat.thermal_resistance": 0.2, "winding_heat.time_constant": 0.05}
SUPPLY = {"supply.resistance": 0.3, "supply.capacitance": 0.001}
RIPPLE = {"torque_ripple.share": 0.05, "torque_ripple.cycles": 6, "torque_ripple.phase": 0.4}
SOFT = PLAIN.changed({"compliance.stiffness": 1.0, "compliance.damping": 0.005})
SAMPLED = PLAIN.changed(
    {"speed_loop.integral_gain": 0.5, "speed_loop.sample_time": 5e-5, "speed_loop.delay": 0.0}
)
REGULATED = PLAIN.changed(
    {
        "controller.speed_gain": 0.005, "current_loop.proportional_gain": 4.32,
        "current_loop.integral_gain": 12780.0, "current_loop.sample_time": 5e-5,
        "current_loop.delay": 5e-5, "current_loop.lost_voltage": 1.0,
    }
)  # fmt: skip
BOTH = LOOP.changed({"eccentricity.turning_share": 0.0})
EVERYTHING = BOTH.changed(
    {
        "emf.rounding": 0.5, "emf.harmonic_5": 0.03, "emf.harmonic_7": -0.02, **COGGING,
        **PRESLIDING, **HEAT, **SUPPLY, **RIPPLE,
    }
)  # fmt: skip
RATE = 20_000.0
SHORT = {"short_a": 0.15}
OFFSET = {"eccentricity": 0.2, "eccentricity_phase": 0.3}


def answer(model, faults, actuator, step=None):
    return equivalent(simulate(model, faults=faults, actuator=actuator, step=step))


@pytest.mark.parametrize(
    ("actuator", "faults"),
    [
        pytest.param(LOOP, SHORT, id="loop"),
        pytest.param(LOOP, {"short_a": 0.5, "short_b": 0.2}, id="two loops"),
        pytest.param(FIXED, OFFSET, id="fixed offset"),
        pytest.param(BOTH, {**SHORT, **OFFSET, "backlash": 0.1}, id="both"),
    ],
)
def test_both_models_agree_within_one_per_cent_on_the_forms_that_both_have(actuator, faults):
    gap = misfit(answer("monitor", faults, actuator), answer("reference", faults, actuator))
    print(f"{faults}: {100.0 * gap:.2f} %")
    assert gap < 0.01


@pytest.mark.parametrize("faults", [{}, SHORT, {"short_a": 0.6, "short_c": 0.2, **OFFSET}], ids=str)
def test_electrical_input_is_copper_loss_and_mechanical_work_and_stored_energy(faults):
    actuator = LOOP.changed(HEAT | SUPPLY | RIPPLE)
    dt, gear = 1e-6, actuator.transmission
    time = np.arange(round(0.25 / dt) + 1) * dt
    command, load = Scenario.load_file("default").histories(time)
    state, more = np.zeros(13), np.array(TruerState())
    state[7] = 1.0
    k, c = Faults(**faults).vector, kernel_constants(actuator)
    truer = truer_constants(actuator)
    trace = batch.reference_trace(
        k, command * gear.ratio, load / gear.ratio, state, c, dt, 1, 1, truer, more
    )
    taken, lost, work = trace[-1, 7:10]
    turns = (1.0 - c.leakage) * c.inductance
    flux_current = state[:3] - k[2:5] * more[:3]  # that magnetises all turns of a phase
    stored = 0.5 * np.sum(c.leakage * c.inductance * state[:3] ** 2 + turns * flux_current**2)
    error = (taken - lost - work - stored) / taken
    print(f"{faults}: in {taken:.4g} J, copper {lost:.4g}, work {work:.4g}, error {error:.2e}")
    assert abs(error) < 0.002
    if faults:
        healthy = simulate("reference", faults={}, actuator=LOOP, sample_rate=RATE)
        assert lost > 1.05 * c.resistance * np.sum(phase_currents(healthy)[:5000] ** 2) / RATE


def test_a_loop_brakes_by_the_power_that_its_resistances_take():
    """At a constant EMF the loop current is mu e/(R_f + mu R), and T w = mu e i_f."""
    r, turns, contact, mu, e, dt = 1.065, 3.4e-4, 0.1, 0.15, 10.0, 1e-5
    loop = 0.0
    for _ in range(1000):
        loop, _ = plain(loop_answer)(mu, loop, 0.0, e, r, turns, contact, dt)
    assert loop == pytest.approx(mu * e / (contact + mu * r), rel=1e-9)
    assert mu * e * loop == pytest.approx((contact + mu * r) * loop**2, rel=1e-9)
    # and it gets there with the time constant of an R-L circuit
    tau = mu**2 * turns / (contact + mu * r)
    start, _ = plain(loop_answer)(mu, 0.0, 0.0, e, r, turns, contact, 1e-3 * tau)
    assert start == pytest.approx(1e-3 * loop, rel=2e-3)


def test_no_contact_between_the_turns_is_a_healthy_motor():
    open_loop = PLAIN.changed({"shorted_turns.resistance": 1e9})
    for model in ("reference", "monitor"):
        healthy = answer(model, {}, open_loop)
        assert misfit(answer(model, {"short_a": 0.3}, open_loop), healthy) < 1e-6
        assert misfit(answer(model, {}, LOOP), healthy) < 1e-9  # without shorted turns, no loop
        assert misfit(healthy, answer(model, {}, PLAIN)) < 2e-3


def test_an_offset_that_turns_is_the_paper_s_and_one_that_is_fixed_is_another():
    turning = PLAIN.changed({"eccentricity.turning_share": 1.0})
    paper = answer("monitor", OFFSET, PLAIN)
    np.testing.assert_array_equal(answer("monitor", OFFSET, turning), paper)
    assert misfit(answer("monitor", OFFSET, FIXED), paper) > 0.03


def test_a_fixed_offset_gives_each_phase_a_constant_of_its_own():
    """With coils on one side of the stator each, h_k k_e (1 + zeta cos(phi - 2 pi k/3))."""
    k = Faults(**OFFSET).vector
    phi = 2.0 * math.pi * (OFFSET["eccentricity_phase"] - 0.5)
    gaps = [1.0 + 0.2 * math.cos(phi - 2.0 * math.pi * n / 3.0) for n in range(3)]
    fault = plain(fault_state)(k, 1.0)
    for theta in np.linspace(0.0, 6.0, 7):
        found = plain(gap_factors)(theta, fault.zeta_cos, fault.zeta_sin, 0.0)
        np.testing.assert_allclose(found, gaps, rtol=1e-12)


def test_a_rounded_shape_makes_the_mean_torque_of_the_trapezoid_in_six_steps():
    theta = math.pi / 6.0 + (np.arange(6000) + 0.5) * math.pi / 3.0 / 6000  # the pair (a, b)
    for form in ((1.0, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1), (0.3, -0.1, 0.05)):
        shapes = np.array([plain(truer_shapes)(x, *form) for x in theta])
        assert np.mean(shapes[:, 0] - shapes[:, 1]) == pytest.approx(2.0, rel=1e-6)
        assert np.ptp(shapes[:, 0] - shapes[:, 1]) > 0.05
    flat = np.array([plain(truer_shapes)(x, 0.0, 0.0, 0.0) for x in theta])
    np.testing.assert_allclose(flat[:, 0] - flat[:, 1], 2.0, rtol=1e-12)


def test_cogging_does_no_work_over_a_turn():
    truer = truer_constants(COGGED)
    theta = np.linspace(0.0, 2.0 * math.pi, 1201)[:-1]
    torque = np.array([plain(torque_of_cogging)(x, truer) for x in theta])
    assert np.abs(torque).max() == pytest.approx(0.002, rel=1e-3)
    assert abs(torque.mean()) < 1e-12


@pytest.mark.parametrize(
    ("structure", "actuator", "faults"),
    [
        pytest.param({"emf_rounding": 0.5}, ROUNDED, {"short_b": 0.2}, id="rounded"),
        pytest.param(
            {"cogging": 0.002, "cogging_cycles": 12.0, "cogging_phase": 0.7}, COGGED,
            {"friction": 0.25}, id="cogging",
        ),
        pytest.param(
            {"control_interval": 5e-5}, SAMPLED.changed({"speed_loop.integral_gain": 0.0}),
            {"friction": 0.25}, id="sampled",
        ),
        pytest.param(
            {"gear_stiffness": 1.0, "gear_damping": 0.005}, SOFT, {"backlash": 0.05}, id="compliant"
        ),
        pytest.param(
            {"current_interval": 5e-5, "current_bandwidth": 6000.0, "lost_voltage": 0.5}, REGULATED,
            {"short_b": 0.2}, id="regulated",
        ),
        pytest.param(
            {"bristle_stiffness": 100.0, "bristle_damping": 0.01, "stribeck_speed": 2.0},
            PLAIN.changed(PRESLIDING), {"friction": 0.25}, id="presliding",
        ),
    ],
)  # fmt: skip
def test_the_reference_model_is_the_independent_actuator_with_the_same_form(
    structure, actuator, faults
):
    time = np.linspace(0.0, 0.5, 50_001)
    command, load = Scenario.load_file("default").histories(time)
    other = another_actuator.simulate(
        another_actuator.parameters_of(actuator), time, command, load, faults,
        another_actuator.Structure(**structure), noise=0.0, bits=None,
    )  # fmt: skip
    gap = misfit(answer("reference", faults, actuator), equivalent(other))
    bare = PLAIN.changed({"controller.speed_gain": actuator.controller.speed_gain})
    without = misfit(answer("reference", faults, bare), equivalent(other))
    print(f"{structure}: {100.0 * gap:.3f} %, without the form {100.0 * without:.2f} %")
    assert gap < 0.003
    assert without > 2.0 * gap


def test_friction_that_is_stiff_before_it_slides_sticks():
    stiff = {**PRESLIDING, "presliding.motor_stiffness": 3e4, "presliding.output_stiffness": 3e4}
    stiff |= {"presliding.damping": 0.3, "presliding.stribeck_speed": 0.01}
    faults = {"friction": 0.3}
    sticks = answer("reference", faults, PLAIN, 1e-6)
    assert misfit(answer("reference", faults, PLAIN.changed(stiff), 1e-6), sticks) < 0.01


def test_a_warming_winding_and_a_sagging_supply_are_those_of_an_integrator():
    """With a locked rotor a pair is an R-L circuit at the link, and all copper loss warms it."""
    locked = PLAIN.changed(
        HEAT | SUPPLY | {"motor.friction_torque": 1e3, "drive.current_limit": 1e3}
    )
    scenario = Scenario(duration=0.1, command=[Step(value=0.2)])
    record = simulate("reference", scenario, actuator=locked, also=("bus_voltage",))
    motor, heat, supply = locked.motor, locked.winding_heat, locked.supply

    def slopes(_, x):
        i, link, warmer = x
        resistance = motor.resistance * (1.0 + 0.00393 * warmer)
        return [
            (link - resistance * i) / motor.inductance,
            ((locked.drive.supply_voltage - link) / supply.resistance - i) / supply.capacitance,
            (heat.thermal_resistance * resistance * i**2 - warmer) / heat.time_constant,
        ]

    start = [0.0, locked.drive.supply_voltage, 0.0]
    exact = solve_ivp(slopes, (0.0, 0.1), start, method="LSODA", rtol=1e-8, dense_output=True)
    middles = record.time[1:] - 0.5 / RATE  # samples are means
    i, link, warmer = exact.sol(middles)
    assert warmer[-1] > 50.0
    assert link.min() < 44.0
    seen = np.abs(np.array([record.channels[f"current_{x}"] for x in "abc"])).max(axis=0)
    np.testing.assert_allclose(seen[1:], i, atol=2e-3 * i.max())
    np.testing.assert_allclose(record.channels["bus_voltage"][1:], link, atol=0.02)


def test_a_loop_that_counts_moves_as_that_of_a_simulator_of_other_make():
    """Whose counts and impacts scatter: the speed filter alone moves the current by far more."""
    drive = load_actuator("servo48-drive")
    encoder, speed, current = drive.encoder, drive.speed_loop, drive.current_loop
    structure = another_actuator.Structure(
        control_interval=speed.sample_time, speed_integral=speed.integral_gain,
        current_interval=current.sample_time, lost_voltage=0.5 * current.lost_voltage,
        current_bandwidth=current.proportional_gain / drive.motor.inductance,
        cogging=drive.cogging.torque, cogging_cycles=drive.cogging.cycles,
        encoder_lines=encoder.motor_steps, speed_lag=encoder.filter_time, encoder_phase=0.5,
        output_lines=encoder.output_steps / drive.transmission.ratio,
    )  # fmt: skip
    command = [{"type": "sine", "amplitude": 0.01, "frequency": 10.0}]
    scenario = Scenario(name="sine", duration=0.1, command=command)
    time = np.linspace(0.0, 0.1, 10_001)
    other = another_actuator.simulate(
        another_actuator.parameters_of(drive), time, *scenario.histories(time), {}, structure,
        noise=0.0, bits=None,
    )  # fmt: skip
    unfiltered = drive.changed({"encoder.filter_time": 0.0})
    own, without = (
        simulate("reference", scenario, actuator=one) for one in (drive, unfiltered)
    )  # fmt: skip
    gap, far = (misfit(equivalent(one), equivalent(other)) for one in (own, without))
    print(f"counts: {100.0 * gap:.2f} %, without a filter {100.0 * far:.2f} %")
    assert gap < 0.01
    assert far > 2.0 * gap
    steps = (own.motor_position - other.motor_position) / encoder.motor_step
    assert np.abs(steps - np.round(steps)).max() < 1e-6  # counts alike


def test_loops_that_sample_later_answer_as_those_of_a_simulator_of_other_make():
    """A modulated current differs from one instant of sampling to the next by far more."""
    drive = PLAIN.changed({
        "controller.position_gain": 60.0, "controller.speed_gain": 0.004,
        "speed_loop.integral_gain": 0.1, "speed_loop.sample_time": 1e-4, "speed_loop.delay": 0.0,
        "current_loop.proportional_gain": 2.9, "current_loop.integral_gain": 8520.0,
        "current_loop.sample_time": 7.5e-5, "current_loop.delay": 7.5e-5,
        "current_loop.lost_voltage": 1.0,
    })  # fmt: skip
    structure = another_actuator.Structure(
        control_interval=1e-4, speed_integral=0.1, current_interval=7.5e-5, lost_voltage=0.5,
        current_bandwidth=2.9 / drive.motor.inductance, sampling_phase=0.44,
    )  # fmt: skip
    time = np.linspace(0.0, 0.1, 2001)
    other = another_actuator.simulate(
        another_actuator.parameters_of(drive), time, 0.02 * np.sin(10.0 * np.pi * time),
        np.zeros(time.size), {}, structure, noise=0.0, bits=None,
    )  # fmt: skip
    start = np.zeros(5)
    late, at_once = (
        reference_answer(one, drive, {}, start) for one in (other.with_first_sample(4.4e-5), other)
    )
    gap, far = (misfit(equivalent(one), equivalent(other)) for one in (late, at_once))
    print(f"sampled as it was: {100.0 * gap:.2f} %, with the start {100.0 * far:.2f} %")
    assert gap < 0.001
    assert far > 5.0 * gap


def test_a_gear_that_gives_as_its_contact_does_is_the_rigid_one():
    gear = PLAIN.transmission
    same = PLAIN.changed(
        {"compliance.stiffness": gear.contact_stiffness, "compliance.damping": gear.contact_damping}
    )
    faults = {"friction": 0.3}
    np.testing.assert_array_equal(
        answer("reference", faults, same), answer("reference", faults, PLAIN)
    )


def test_a_loop_that_is_sampled_at_each_step_is_the_continuous_one():
    fast = PLAIN.changed(
        {
            "speed_loop.integral_gain": 0.0, "speed_loop.sample_time": 2e-6,
            "speed_loop.delay": 0.0,
        }
    )  # fmt: skip
    faults = {"friction": 0.3}
    rippling = answer("reference", faults, PLAIN, 1e-6)
    assert misfit(answer("reference", faults, fast, 1e-6), rippling) < 0.004


def test_a_stiff_gear_is_refused_at_a_long_step_of_the_reference_alone():
    long_steps = r"reference model must lie between 1e-09 and 8\.45e-07"
    with pytest.raises(ParameterError, match=long_steps):
        PLAIN.changed({"compliance.stiffness": 1e6, "compliance.damping": 0.001})
    stiff = PLAIN.changed({"compliance.stiffness": 1000.0, "compliance.damping": 0.04})
    assert stiff.largest_stable_step("monitor") == PLAIN.largest_stable_step("monitor")


@pytest.mark.parametrize("model", ["reference", "monitor"])
def test_shorter_steps_bring_less_and_less(model):
    faults = {**SHORT, **OFFSET}
    steps = (2e-6, 1e-6, 0.25e-6) if model == "reference" else (25e-6, 12.5e-6, 2.5e-6)
    actuator = EVERYTHING if model == "reference" else BOTH
    coarse, fine, finest = (answer(model, faults, actuator, step) for step in steps)
    errors = misfit(coarse, finest), misfit(fine, finest)
    print(f"{model}: {100 * errors[0]:.3f} and {100 * errors[1]:.3f} %")
    assert errors[1] < errors[0]
    assert errors[1] < 0.0015


NOISE = Noise(white=0.02, bits=12)


def test_a_short_of_fifteen_per_cent_with_a_loop_is_identified():
    record = simulate("reference", HALF, faults=SHORT, actuator=LOOP, noise=NOISE)
    found = ematwin.identify(record, actuator=LOOP)
    low, high = found.intervals["short_a"]
    assert found.estimate["short_a"] == pytest.approx(0.15, abs=0.02)
    assert low <= 0.15 <= high
    assert found.verdict.faults == ("short_a",)


def test_a_fixed_offset_of_a_fifth_is_identified():
    record = simulate("reference", HALF, faults=OFFSET, actuator=FIXED, noise=NOISE)
    found = ematwin.identify(record, actuator=FIXED)
    low, high = found.intervals["eccentricity"]
    assert found.estimate["eccentricity"] == pytest.approx(0.2, abs=0.02)
    assert low <= 0.2 <= high
    assert found.estimate["eccentricity_phase"] == pytest.approx(0.3, abs=0.02)


def test_commutation_under_a_current_loop_takes_half_of_the_current():
    """The flux of a pair begins with that of the leg which it shares with the last one."""
    record = simulate("reference", actuator=REGULATED, sample_rate=200e3)
    current = signed_current(record, PLAIN.motor.pole_pairs)
    sector = np.floor(PLAIN.motor.pole_pairs * record.motor_position / (math.pi / 3.0) - 0.5)
    left = np.abs(np.array([record.channels[f"current_{phase}"] for phase in "abc"])).min(axis=0)
    shares = []
    for n in np.flatnonzero(np.diff(sector)):
        after = np.flatnonzero(left[n + 2 :] < 1e-6)  # the third leg has run out
        if abs(current[n]) > 0.3 and after.size and after[0] < 8:
            shares.append(current[n + 2 + after[0]] / current[n])
    print(f"{len(shares)} commutations: {np.median(shares):.3f}")
    assert len(shares) > 5
    assert np.median(shares) == pytest.approx(0.5, abs=0.08)


@pytest.mark.parametrize(
    ("actuator", "faults"),
    [
        pytest.param(SAMPLED, {"friction": 0.3, "gain": 0.6}, id="sampled"),
        pytest.param(SOFT, {"backlash": 0.1, "friction": 0.2}, id="compliant"),
    ],
)
def test_the_monitor_corrected_by_the_reference_finds_faults_beside_a_form_that_it_lacks(
    actuator, faults
):
    record = simulate("reference", faults=faults, actuator=actuator, noise=NOISE)
    found = ematwin.identify(record, actuator=actuator, exact=True)
    values = Faults(**{name: found.estimate[name] for name in FAULTS})
    error = error_percent(values.vector, Faults(**faults).vector)
    print(f"{faults}: Err {error:.2f} %, {100.0 * found.relative_misfit:.2f} % left")
    assert error < 0.5
    assert found.relative_misfit < 0.005
    assert set(found.verdict.faults) == set(faults)


def test_faults_beside_every_form_are_identified():
    faults = {"short_b": 0.15, "friction": 0.3, "backlash": 0.1, "gain": 0.6}
    record = simulate("reference", HALF, faults=faults, actuator=EVERYTHING, noise=NOISE)
    found = ematwin.identify(record, actuator=EVERYTHING, exact=True)
    for name, value in faults.items():
        assert found.estimate[name] == pytest.approx(value, abs=0.02)


def test_an_offset_fixed_in_space_is_not_called_a_short_where_the_file_has_no_section_for_it():
    record = simulate("reference", faults=OFFSET, actuator=FIXED, noise=NOISE)
    found = ematwin.identify(record, actuator=PLAIN)
    print(found.verdict)
    assert found.verdict.grade == "none"
    assert "[eccentricity] with turning_share = 0" in found.verdict.reason
    assert re.search(r"\(eccentricity 0\.(19|2)", found.verdict.reason)


def test_a_loop_of_shorted_turns_is_told_where_the_file_has_no_section_for_it():
    loop = PLAIN.changed({"shorted_turns.resistance": 0.1})
    record = simulate("reference", HALF, faults=SHORT, actuator=loop, noise=NOISE)
    found = ematwin.identify(record, actuator=PLAIN)
    said = " ".join(found.warnings)
    print(found.verdict, said)
    assert not set(found.verdict.faults) - {"short_a"}
    assert "[shorted_turns]" in said
    assert "short a" in said
