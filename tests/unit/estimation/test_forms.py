"""Forms that a file leaves out, found along recorded motions of a simulator of other make."""

import math

import numpy as np
import pytest

from bldc_inputs import with_one_current
from ematwin import Noise, Scenario, simulate
from ematwin.estimation.baseline import uncertain
from ematwin.estimation.forms import FoundForms, find_forms
from ematwin.estimation.healthy_fit import HealthyFit
from ematwin.estimation.learn import learn
from ematwin.estimation.likely_forms import with_likely_form
from ematwin.models.bldc.model import MODEL
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.optional import Form, Likelihood
from naive import another_actuator as other

SHEET = BldcActuator.load().changed(
    {"controller.position_gain": 60.0, "controller.speed_gain": 0.004}
)
# a few per cent off the sheet
BUILT = SHEET.changed({
    "controller.position_gain": 62.0, "motor.resistance": 2.2, "motor.inertia": 2.6e-6,
    "motor.emf_constant": 0.0741, "motor.friction_torque": 0.016,
})  # fmt: skip
# and cogging, none of which the sheet states
BOTH_LOOPS = other.Structure(
    control_interval=1e-4, speed_integral=0.1, current_interval=5e-5, current_bandwidth=6000.0,
    lost_voltage=0.5, cogging=0.0015, cogging_phase=0.4,
)  # fmt: skip


def compared(structure, without=(), duration=0.4, recordings=2, built=BUILT):
    """Healthy recordings with 2 % noise beside the sheet."""
    time = np.arange(0.0, duration, 5e-5)
    load = np.where(time > 0.2, 10.0, 0.0)
    found = []
    for n, f in enumerate((5.0 + 12.0 * time, 4.0 + 0.0 * time, 8.0 + 4.0 * time)[:recordings]):
        record = other.simulate(
            other.parameters_of(built), time, 0.005 * np.sin(2.0 * np.pi * f * time), load, {},
            structure, seed=n,
        )  # fmt: skip
        some = {name: x for name, x in record.channels.items() if name not in without}
        record = type(record)(record.time, some, units=record.units)
        found.append(MODEL.compare(record, SHEET))
    return found


@pytest.fixture(scope="module")
def of_drive():
    """Recordings of a drive with both loops and cogging, none of which its file states."""
    return compared(BOTH_LOOPS)


@pytest.fixture(scope="module")
def drive(of_drive):
    """The forms that they show."""
    return find_forms(MODEL, SHEET, of_drive)


def test_loops_and_cogging_are_found_with_their_values(drive):
    found = drive.actuator
    assert found.speed_loop.integral_gain == pytest.approx(0.1, rel=0.1)
    assert found.current_loop.sample_time == 5e-5
    bandwidth = found.current_loop.proportional_gain / SHEET.motor.inductance
    assert bandwidth == pytest.approx(6000.0, rel=0.15)
    assert (found.cogging.cycles, found.emf) == (12, None)
    assert found.cogging.torque == pytest.approx(0.0015, rel=0.05)


def test_times_of_both_loops_are_found_wherever_the_recordings_begin_among_the_samples():
    structure = other.Structure(
        control_interval=1.25e-4, speed_integral=0.1, current_interval=7.5e-5,
        current_bandwidth=4500.0, lost_voltage=0.5, sampling_phase=0.37,
    )  # fmt: skip
    found = find_forms(MODEL, SHEET, compared(structure, {"load"}, recordings=1))
    actuator, first = found.actuator, found.first_samples[0]
    assert actuator.speed_loop.sample_time == pytest.approx(1.25e-4)
    assert (actuator.speed_loop.delay, actuator.current_loop.delay) == pytest.approx((0.0, 7.5e-5))
    assert actuator.current_loop.sample_time == pytest.approx(7.5e-5)
    late = (first - 0.37 * 1.25e-4) / 7.5e-5  # sample times of the current loop
    assert abs(late - round(late)) < 0.05
    assert found.values["motor.resistance"] == pytest.approx(2.2, rel=0.05)


def test_what_was_found_is_said_as_an_engineer_would(drive):
    assert "urrent loop of 50 us, about" in drive.said
    assert "ntegral term in the speed loop (40" in drive.said
    assert "ogging of 1.5 mN m, 12 a turn" in drive.said
    assert "Together these explain 9" in drive.said


def test_the_lag_of_an_encoders_speed_is_not_taken_for_that_of_the_current_loop():
    structure = other.Structure(
        control_interval=1.25e-4, speed_integral=0.1, current_interval=1.25e-4,
        current_bandwidth=2600.0, encoder_lines=10_000.0, output_lines=80_000.0,
        sampling_phase=0.3,
    )  # fmt: skip
    beside = compared(structure, {"load"}, duration=0.3)
    forms = find_forms(MODEL, SHEET, beside)
    assert sum(one.forms for one in forms.explained) == len(forms.found)
    assert {one.equation for one in forms.explained} == {"controller"}
    assert sum(one.share for one in forms.explained) > 0.95
    found = forms.actuator
    assert found.encoder.motor_steps == 10_000
    assert found.speed_loop.integral_gain == pytest.approx(0.1, rel=0.05)
    bandwidth = found.current_loop.proportional_gain / SHEET.motor.inductance
    assert bandwidth == pytest.approx(2600.0, rel=0.25)


def test_equations_together_say_where_the_parameters_are_and_how_surely(of_drive, drive):
    true = {place: BUILT.value(place) for place in drive.values if BUILT.parameter(place)}
    true |= {"speed_loop.integral_gain": 0.1, "cogging.torque": 0.0015}
    nominals = uncertain(MODEL, drive.actuator)
    beside = [MODEL.compare(one.recording, drive.actuator) for one in of_drive]
    fit = HealthyFit(MODEL, drive.actuator, nominals, 0.0, drive.values).run(beside)
    assert fit.scatter < 0.03
    problem = fit.end.peak.problem
    found = {name: math.log(fit.values[name] / value) for name, value in true.items()}
    own = [problem.names.index(name) for name in true]
    widths = problem.chart.widths[own]
    covariance = fit.end.covariance[np.ix_(own, own)] * np.outer(widths, widths)
    away = np.array(list(found.values()))
    assert away @ np.linalg.solve(covariance, away) < 3.0 * len(away)
    errors = dict(zip(true, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    assert errors["motor.emf_constant"] < 0.02  # the sheet has 3 %; efficiencies leave the rest
    assert errors["transmission.backlash"] < 0.02  # and 26 %
    # together both sides hold but sums; each shows alone while the output crosses the gap
    for place in ("motor.friction_torque", "transmission.friction_torque", "motor.inertia"):
        assert errors[place] < 0.0205  # what the integral term held at first is unknown
    assert fit.misfit < 0.02  # the closed loop, which is only checked, agrees


def test_gains_beside_a_sample_time_from_a_list_are_hardly_known(of_drive):
    """At another sample time others explain the recordings as well."""
    prior = learn(MODEL, SHEET, of_drive).baseline.prior
    spreads = dict(zip(prior.names, np.sqrt(np.diag(prior.covariance)), strict=True))
    assert min(x for name, x in spreads.items() if name.startswith("current_loop.")) >= 0.2
    assert spreads["controller.position_gain"] < 0.02


def test_what_a_file_states_of_its_loops_is_told_along_the_motion_as_well():
    stated = SHEET.changed({
        "speed_loop.integral_gain": 0.12, "speed_loop.sample_time": 0.0, "speed_loop.delay": 0.0
    })  # fmt: skip
    beside = compared(other.Structure(speed_integral=0.1, control_interval=1e-4))
    found = find_forms(MODEL, stated, beside)
    assert found.values["speed_loop.integral_gain"] == pytest.approx(0.1, rel=0.08)


def test_an_actuator_of_the_simple_structure_has_no_form():
    found = find_forms(MODEL, SHEET, compared(other.Structure()))
    assert (found.found, found.actuator) == ((), SHEET)


def test_the_ripple_of_a_comparator_is_not_taken_for_a_loop_at_its_border():
    off = {
        "motor.resistance": 0.05, "motor.inertia": 0.04, "motor.emf_constant": 0.02,
        "motor.viscous_damping": 0.1, "motor.friction_torque": 0.1,
        "transmission.friction_torque": 0.1, "transmission.backlash": 0.15,
        "drive.supply_voltage": 0.02,
    }  # fmt: skip
    rng = np.random.default_rng([751000, 41])  # whose ripple resembles one
    built = SHEET.changed({
        place: SHEET.value(place) * math.exp(rng.normal(0.0, x)) for place, x in off.items()
    })  # fmt: skip
    slow = Scenario(
        name="reversals", duration=0.6,
        command=[{"type": "sine", "amplitude": 0.004, "frequency": 4.0}],
    )  # fmt: skip
    healthy = [
        simulate(
            "reference", one, actuator=built, noise=Noise(white=0.02, bits=12), seed=751000 + n
        )
        for n, one in enumerate(("default", slow, "ramp"))
    ]
    assert find_forms(MODEL, SHEET, [MODEL.compare(one, SHEET) for one in healthy]).found == ()


def test_loops_and_cogging_are_found_by_the_motor_alone(drive):
    found = find_forms(MODEL, SHEET, compared(BOTH_LOOPS, ("output_position",), recordings=1))
    assert len(found.found) == len(drive.found)
    for place in ("speed_loop.integral_gain", "current_loop.lost_voltage", "cogging.torque"):
        assert found.actuator.value(place) == pytest.approx(drive.actuator.value(place), rel=0.05)


def test_cogging_without_a_phase_is_found():
    beside = compared(other.Structure(cogging=0.0015), recordings=1)
    found = find_forms(MODEL, SHEET, beside).actuator
    assert found.cogging.cycles == 12
    assert (found.speed_loop, found.current_loop, found.emf) == (None, None, None)


@pytest.mark.parametrize(("stiffness", "friction"), [(100.0, 1.0), (10.0, 1.08)])
def test_a_gear_that_gives_is_found_and_not_taken_for_a_wider_gap(stiffness, friction):
    """By torques as they are: those of the sheet would give the soft gear 3 % more gap."""
    structure = other.Structure(gear_stiffness=stiffness, gear_damping=1e-4 * stiffness)
    place = "transmission.friction_torque"
    built = BUILT.changed({place: friction * BUILT.value(place)})
    found = find_forms(MODEL, SHEET, compared(structure, built=built))
    assert found.actuator.compliance.stiffness == pytest.approx(stiffness, rel=0.3)
    assert "ear that gives by 1 rad for" in found.said
    gap = BUILT.transmission.backlash
    assert found.values["transmission.backlash"] == pytest.approx(gap, rel=0.015)


def test_friction_that_falls_with_speed_is_found():
    structure = other.Structure(bristle_stiffness=150.0, stribeck_speed=4.0)
    found = find_forms(MODEL, SHEET, compared(structure))
    assert found.actuator.presliding.stribeck_speed == pytest.approx(4.0, rel=0.15)
    assert found.values["transmission.static_ratio"] == pytest.approx(
        BUILT.transmission.static_ratio, rel=0.1
    )


BRISTLES = other.Structure(bristle_stiffness=150.0, stribeck_speed=1.2)


def likely(structure, recordings=2, one_current=False):
    """Forms with those that the likelihood of the motion shows."""
    beside = compared(structure, recordings=recordings)
    if one_current:
        beside = [MODEL.compare(with_one_current(one.recording), SHEET) for one in beside]
    found = find_forms(MODEL, SHEET, beside)
    return found, with_likely_form(MODEL, SHEET, [one.recording for one in beside], found)


@pytest.mark.parametrize("one_current", [False, True])
def test_bristles_show_in_the_motion_where_sliding_friction_does_not_show_them(one_current):
    before, found = likely(BRISTLES, 3, one_current)
    assert before.actuator.presliding is None
    own = found.actuator.presliding
    assert own.stribeck_speed == pytest.approx(1.2, rel=0.5)
    assert 75.0 < own.motor_stiffness < 300.0
    assert found.said.startswith("Friction that falls with speed (Stribeck, 1")
    assert found.explained[-1].equation == "motion"
    assert 0.0 < found.explained[-1].share < 1.0
    assert "friction that falls with speed" not in found.absent


def test_dry_friction_is_not_taken_for_bristles(of_drive, drive):
    found = with_likely_form(MODEL, SHEET, [one.recording for one in of_drive], drive)
    assert found.actuator == drive.actuator
    assert "friction that falls with speed" in found.absent


def test_one_recording_does_not_show_bristles():
    _, found = likely(BRISTLES, recordings=1)
    assert found.actuator.presliding is None


def test_bristles_that_equations_have_found_are_as_stiff_as_the_motion_says():
    structure = other.Structure(bristle_stiffness=150.0, stribeck_speed=4.0)
    before, found = likely(structure)
    assert before.actuator.presliding is not None
    assert found.actuator.presliding.motor_stiffness == pytest.approx(150.0, rel=0.5)
    assert len(found.found) == len(before.found)


def test_forms_that_a_file_states_stay_as_stated(of_drive):
    stated = SHEET.changed({
        "presliding.motor_stiffness": 80.0, "presliding.output_stiffness": 80.0,
        "presliding.damping": 0.01, "presliding.stribeck_speed": 2.0,
    })  # fmt: skip
    known = FoundForms(stated)
    recordings = [one.recording for one in of_drive]
    assert with_likely_form(MODEL, stated, recordings, known) is known


def test_cogging_and_a_rounded_emf_are_found_where_neither_explains_the_torques_alone():
    structure = other.Structure(cogging=0.0013, cogging_phase=1.47, emf_rounding=0.27)
    found = find_forms(MODEL, SHEET, compared(structure, recordings=3)).actuator
    assert found.cogging.torque == pytest.approx(0.0013, rel=0.1)
    assert found.emf.rounding == pytest.approx(0.27, rel=0.1)


@pytest.mark.parametrize(
    ("gains", "shown"),
    [
        ((100.0, -20.0, 500.0), True),
        ((-100.0, -50.0, 4000.0), False),  # of one recording alone, late in a long one
        ((50.0, -20.0), False),
        ((5.0, 3.0), False),  # no more than noise
        ((5000.0,), False),
    ],
)
def test_most_recordings_have_to_be_likelier(gains, shown):
    form = Form(
        "bristles", lambda a: a.presliding is not None, ("presliding.stribeck_speed",),
        lambda a: [
            {
                "presliding.motor_stiffness": stiffness, "presliding.output_stiffness": 100.0,
                "presliding.damping": 0.01, "presliding.stribeck_speed": 2.0,
            }
            for stiffness in (50.0, 100.0, -1.0)
        ],
        lambda a: "bristles", ("presliding.motor_stiffness",),
    )  # fmt: skip
    stiffest = 100.0

    class Told:
        def likelihood(self, recording, actuator):
            def log_densities(actuators):
                own = [one.presliding and one.presliding.motor_stiffness for one in actuators]
                return [gains[recording] if one == stiffest else 0.0 for one in own]

            return Likelihood(form, log_densities, 200)

    found = with_likely_form(Told(), SHEET, range(len(gains)), FoundForms(SHEET))
    assert (found.found == ("bristles",)) == shown
    assert (found.absent == ("bristles",)) != shown
    if shown:
        assert found.actuator.presliding.motor_stiffness == stiffest
