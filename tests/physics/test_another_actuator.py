"""The independent actuator in ``tests/naive`` is the documented model, and more on demand."""

import math

import numpy as np
import pytest

from bldc_inputs import equivalent, misfit
from ematwin.models.bldc.channels import phase_currents
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Scenario
from ematwin.models.simulating import simulate as simulate_twin
from naive.another_actuator import (
    TERMS,
    Structure,
    emf_shape,
    lugre,
    parameters_of,
    simulate,
    tuned,
)

SERVO48 = parameters_of(BldcActuator.load())
TIME = np.linspace(0.0, 0.5, 50_001)
COMMAND, LOAD = Scenario.load_file("default").histories(TIME)
REALISTIC = Structure.realistic()
CASES = {
    "healthy": {},
    "friction and short": {"friction": 0.25, "short_b": 0.15},
    "eccentricity and backlash": {"eccentricity": 0.4, "backlash": 0.3},
    "all": {
        "friction": 0.3, "backlash": 0.1, "short_a": 0.5, "short_b": 0.1, "short_c": 0.2,
        "eccentricity": 0.3, "eccentricity_phase": 0.9, "gain": 0.8,
    },
}  # fmt: skip


def answer(structure, faults=None, parameters=SERVO48):
    """Filtered equivalent current of this actuator in the default scenario, A."""
    record = simulate(parameters, TIME, COMMAND, LOAD, faults, structure, noise=0.0, bits=None)
    return equivalent(record)


def twin(model, faults, parameters=SERVO48):
    place = "controller.speed_gain"
    actuator = BldcActuator.load().changed({place: parameters[place]})
    return equivalent(simulate_twin(model, faults=faults, actuator=actuator))


@pytest.mark.parametrize("faults", CASES.values(), ids=CASES)
def test_neutral_structure_is_the_reference_model(faults):
    """Measured: 0.000 % in each; one switching instant that rounding moves makes some 0.1 %."""
    gap = misfit(answer(Structure(), faults), twin("reference", faults))
    print(f"{faults}: {100.0 * gap:.4f} %")
    assert gap < 0.003


@pytest.mark.parametrize("term", TERMS)
def test_each_term_changes_the_answer(term):
    """`pytest -s` prints what each makes against the neutral structure and against the twin.

    What the inverter loses is regulated away by a comparator: it shows behind a PI loop.
    """
    others = ("PI current loop",) if term == "lost voltage" else ()
    structure = REALISTIC.only(term, *others)
    parameters = tuned(SERVO48, structure)
    with_term = answer(structure, parameters=parameters)
    change = misfit(with_term, answer(REALISTIC.only(*others), parameters=parameters))
    gap = misfit(with_term, twin("monitor", {}, parameters))
    print(f"{term}: changes {100.0 * change:.2f} %, misfit of the twin {100.0 * gap:.2f} %")
    assert 0.004 < change < 0.1


@pytest.mark.parametrize("faults", CASES.values(), ids=CASES)
def test_realistic_structure_is_seen_but_is_still_this_actuator(faults):
    parameters = tuned(SERVO48, REALISTIC)
    gap = misfit(answer(REALISTIC, faults, parameters), twin("monitor", faults, parameters))
    print(f"{faults}: misfit of the twin {100.0 * gap:.2f} %")
    assert 0.03 < gap < 0.4


def test_a_speed_gain_for_a_comparator_swings_behind_a_delayed_loop():
    loop = REALISTIC.only("PI current loop")
    assert misfit(answer(loop), twin("monitor", {})) > 0.5
    assert misfit(answer(loop._replace(current_delay=0)), twin("monitor", {})) < 0.1


def test_a_fast_current_loop_is_the_comparator_again():
    fast = Structure(current_interval=10e-6, current_bandwidth=40e3, current_delay=0)
    assert misfit(answer(fast), answer(Structure())) < 0.005


@pytest.mark.parametrize("load", [0.0, 5.0])
def test_dry_friction_holds_exactly_without_a_command(load):
    still = np.zeros(2)
    record = simulate(SERVO48, [0.0, 0.2], still, still + load, noise=0.0)
    assert not record.motor_position.any()
    assert not record.output_position.any()


def test_everything_at_once_comes_to_rest_without_a_command():
    record = simulate(SERVO48, [0.0, 0.5], np.zeros(2), structure=REALISTIC, noise=0.0, bits=None)
    # cogging leans on the bristles, no more
    lean = REALISTIC.cogging / REALISTIC.bristle_stiffness
    assert np.abs(record.motor_position).max() < 3.0 * lean
    assert np.ptp(record.motor_position[-1000:]) < 1e-3 * lean
    assert np.abs(phase_currents(record)).max() < 1e-2


@pytest.mark.parametrize("amplitude", [1e-5, 1e-3, 10.0])
@pytest.mark.parametrize("frequency", [1.0, 30.0])
@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_lugre_friction_never_adds_energy_over_a_cycle(amplitude, frequency, damping):
    steps = 40_000
    dt = 1.0 / (frequency * steps)
    dynamic, ratio, stiffness, stribeck = 0.015, 2.0, 100.0, 2.0
    phase = 2.0 * math.pi * (np.arange(steps) + 0.5) / steps
    speed = 2.0 * math.pi * frequency * amplitude * np.cos(phase)
    z, work = 0.0, []
    for _ in range(2):  # the first settles the bristles
        total = 0.0
        for w in speed:
            z, torque = lugre(z, w, dynamic, ratio, stiffness, damping, stribeck, dt)
            total += torque * w * dt
            # no further than the static torque bends it, and never more than that torque
            assert abs(z) <= ratio * dynamic / stiffness + dt * abs(w)
        work.append(total)
    assert work[-1] >= 0.0
    if amplitude >= 0.1 and frequency == 30.0:  # fast: a Coulomb torque on the whole way
        assert work[-1] == pytest.approx(4.0 * amplitude * dynamic, rel=0.2)


def test_lugre_friction_slides_at_the_dynamic_and_breaks_loose_near_the_static_torque():
    dt, dynamic, ratio, stribeck = 1e-6, 0.015, 2.0, 2.0
    z, torques = 0.0, []
    for w in np.linspace(0.0, 20.0 * stribeck, 200_000):
        z, torque = lugre(z, w, dynamic, ratio, 100.0, 0.0, stribeck, dt)
        torques.append(torque)
    assert torques[-1] == pytest.approx(dynamic, rel=1e-2)
    assert 0.9 * ratio * dynamic < max(torques) <= ratio * dynamic


@pytest.mark.parametrize("lost", [0.0, 0.7])
@pytest.mark.parametrize("interval", [0.0, 100e-6], ids=["comparator", "PI"])
@pytest.mark.parametrize("faults", [{}, {"short_b": 0.4, "short_c": 0.2}], ids=["healthy", "short"])
def test_current_of_a_locked_rotor_is_voltage_over_resistance(lost, interval, faults):
    locked = SERVO48 | {"motor.friction_torque": 1e3, "drive.current_limit": 1e3}
    structure = Structure(lost_voltage=lost, current_interval=interval)
    end = 0.05
    record = simulate(locked, [0.0, end], [0.1, 0.1], None, faults, structure, noise=0.0, bits=None)
    # at rest at zero the sector is that of the pair (c, b)
    turns = 2.0 - faults.get("short_b", 0.0) - faults.get("short_c", 0.0)
    limit = (48.0 - 2.0 * lost) / (turns * SERVO48["motor.resistance"] / 2.0)
    assert not record.motor_position.any()
    assert np.abs(phase_currents(record)).max() <= limit * (1.0 + 1e-9)
    assert phase_currents(record)[-1] == pytest.approx([0.0, -limit, limit], rel=1e-3, abs=1e-9)


def test_a_compliant_gear_twists_by_the_torque_over_its_stiffness_beyond_the_gap():
    load = 50.0
    easy = tuned(SERVO48, REALISTIC) | {
        "motor.friction_torque": 1e-5, "transmission.friction_torque": 1e-5,
        "transmission.static_ratio": 1.0, "transmission.efficiency_opposing": 1.0,
        "transmission.efficiency_aiding": 1.0,
    }  # fmt: skip
    gear = REALISTIC.only("compliant gear")
    record = simulate(easy, [0.0, 1.0], [0.0, 0.0], [load, load], None, gear, noise=0.0)
    ratio = easy["transmission.ratio"]
    twist = record.motor_position[-1] - ratio * record.output_position[-1]
    expected = easy["transmission.backlash"] / 2.0 + load / ratio / gear.gear_stiffness
    assert twist == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("rounding", [0.0, 0.3, 1.0])
def test_rounding_the_emf_keeps_the_mean_torque_of_a_driven_pair(rounding):
    angles = math.pi / 6.0 + math.pi / 3.0 * (np.arange(1000) + 0.5) / 1000  # pair (a, b)
    pair = [emf_shape(x, rounding) - emf_shape(x - 2.0 * math.pi / 3.0, rounding) for x in angles]
    assert np.mean(pair) == pytest.approx(2.0, rel=1e-5)
    assert np.ptp(pair) == pytest.approx(rounding * 0.2806, abs=1e-3)
