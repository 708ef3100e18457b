"""What equations along a recorded motion say of faults, beside the truth of a simulation."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from bldc_inputs import HALF, with_one_current
from ematwin import Calibration, Noise, identify, simulate
from ematwin.errors import ParameterError
from ematwin.estimation.along_motion import informed
from ematwin.estimation.assess import unassessed
from ematwin.estimation.baseline import Baseline, with_all_free
from ematwin.estimation.closed_loop import closed_loop
from ematwin.estimation.descent import TooFarError
from ematwin.estimation.findings import obstacles_to
from ematwin.estimation.followed_motion import Regression
from ematwin.estimation.motion_fit import Along, MotionFit
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found
from ematwin.models.bldc.channels import PHASES
from ematwin.models.optional import Equation
from ematwin.models.registry import load_actuator, model_of

DRIVE = load_actuator("servo48").changed({
    "controller.position_gain": 60.0, "controller.speed_gain": 0.004,
    "speed_loop.integral_gain": 0.1, "speed_loop.sample_time": 1e-4, "speed_loop.delay": 1e-4,
    "current_loop.proportional_gain": 7.0, "current_loop.integral_gain": 12_000.0,
    "current_loop.sample_time": 5e-5, "current_loop.delay": 5e-5, "current_loop.lost_voltage": 1.0,
})  # fmt: skip
MODEL = model_of(DRIVE)
FAULTS = {"friction": 0.3, "backlash": 0.1, "short_b": 0.25, "eccentricity": 0.2, "gain": 0.3}


COGGING = {"cogging.torque": 0.002, "cogging.cycles": 12, "cogging.phase": 0.3}


def covariance_of(known, point):
    """(d, d), of coordinates by priors and equations."""
    chart, step = known.chart, 1e-4 * np.eye(len(point))
    z = chart.from_values(point[None])
    rows = known.prior_distances(chart.to_values(z + step)) - known.prior_distances(point[None])
    return np.linalg.inv(rows @ rows.T / (1e-4 * known.noise) ** 2)


def everything_free(recording, actuator=DRIVE):
    problem = Problem.of(recording, actuator)
    return with_all_free(MODEL, actuator, problem, Baseline.of_template(MODEL, actuator))


@pytest.fixture(scope="module")
def recording():
    return simulate("reference", HALF, FAULTS, DRIVE, noise=Noise(white=0.02), seed=3)


@pytest.fixture(scope="module")
def found(recording):
    """The problem without and with what equations tell, and their estimate."""
    problem = everything_free(recording)
    return problem, *informed(MODEL, DRIVE, problem, problem.healthy)


def away_from(faults, found):
    """Distances of the faults (7,) from an estimate, and its standard errors."""
    problem, known, point = found
    truth = np.array([faults.get(one.name, one.healthy) for one in problem.unknowns])
    away = (problem.chart.from_values(point[None]) - problem.chart.from_values(truth[None]))[0]
    own = [n for n, one in enumerate(problem.unknowns) if one.role == "fault"]
    return np.abs(away[own]), np.sqrt(np.diag(covariance_of(known, point)))[own]


def test_equations_lead_from_healthy_to_the_faults_within_standard_errors(found):
    away, errors = away_from(FAULTS, found)
    assert (away < 4.0 * errors + 1e-3).all()
    assert (errors[:-1] < 0.1).all()


def test_the_fault_of_a_gain_is_known_no_better_than_the_gain_by_the_sheet(found):
    """The controller shows their product alone, and differences of its answer hold ripple."""
    problem, *_ = found
    [spread] = np.sqrt(problem.prior.of(["controller.position_gain"]).covariance.ravel())
    away, errors = away_from(FAULTS, found)
    assert errors[-1] == pytest.approx((0.5 + FAULTS["gain"]) * spread, rel=0.05)
    assert away[-1] < 0.01


def test_what_an_integral_term_holds_as_a_recording_begins_in_motion_is_found(recording):
    later = {name: x[round(0.05 * recording.sample_rate) :] for name, x in recording.columns()}
    problem = everything_free(recording.changed(**later))
    known, point = informed(MODEL, DRIVE, problem, problem.healthy)
    away, errors = away_from(FAULTS, (problem, known, point))
    assert (away < 4.0 * errors + 1e-3).all()
    held = float(known.candidates(point[None], 0)["integral"][0])
    assert held > 0.2  # A
    # closed from there on, the loops move as recorded
    [compared] = known.comparisons
    target = compared.measured()["current"]
    found, without = (
        np.linalg.norm(compared.exact({**FAULTS, "integral": one})["current"] - target)
        for one in (held, 0.0)
    )
    assert found < 0.01 * np.linalg.norm(target)
    assert without > 5.0 * found


def test_a_fit_does_not_end_where_a_whole_step_is_too_long():
    faults = {"backlash": 0.28, "short_a": 0.17, "short_c": 0.35, "gain": 0.76}
    twin = DRIVE.changed(COGGING)
    truth = twin.changed({
        "motor.resistance": 2.1, "motor.emf_constant": 0.0728, "motor.inertia": 2.5e-6,
        "motor.friction_torque": 0.015, "transmission.friction_torque": 0.0156,
        "drive.supply_voltage": 49.1,
    })  # fmt: skip
    noise = Noise(white=0.02)
    recording = simulate("reference", HALF, faults, truth, noise=noise, seed=7)
    problem = everything_free(recording, twin)
    away, errors = away_from(faults, (problem, *informed(MODEL, twin, problem, problem.healthy)))
    assert (away < 4.0 * errors + 1e-3).all()


def test_a_fit_follows_a_narrow_curved_minimum(recording):
    """Both frictions are known by their sum, and the sheet alone tells them apart."""
    places = ("motor.friction_torque", "transmission.friction_torque")
    noise, shape = np.random.default_rng(1).standard_normal((2, 200))
    size = 1e4 * np.linalg.norm(shape)

    def left(actuator, values):
        return 1e4 * (sum(actuator.value(place) for place in places) / 0.03 - 1.0) * shape + noise

    equation = Equation("balance", left, size, lambda _: np.linalg.norm(noise) / size, places, ())
    problem = everything_free(recording)
    own = [problem.names.index(place) for place in places]
    start = problem.healthy.copy()
    start[own] = 0.009, 0.021
    z = problem.chart.from_values(start[None])
    end = MotionFit(
        DRIVE, problem, z, [Along(0, equation)], {}, partial(MODEL.aliases, DRIVE)
    ).descended(z)
    found = problem.chart.to_values(end)[0, own]
    assert found.sum() == pytest.approx(0.03, rel=1e-5)
    assert found == pytest.approx([0.015, 0.015], rel=0.01)


def test_a_step_beyond_a_minimum_is_made_shorter(recording):
    places = ("controller.speed_gain",)
    noise, shape = np.random.default_rng(1).standard_normal((2, 200))
    size = 1e3 * np.linalg.norm(shape)
    gain = DRIVE.controller.speed_gain

    def left(actuator, values):
        # far from the gain it is flat: the tangent leads beyond
        return 1e3 * np.tanh(3.0 * np.log(actuator.controller.speed_gain / gain)) * shape + noise

    equation = Equation(
        "controller", left, size, lambda _: np.linalg.norm(noise) / size, places, ()
    )
    problem = everything_free(recording)
    [own] = (problem.names.index(place) for place in places)
    start = problem.healthy.copy()
    start[own] = 0.6 * gain
    z = problem.chart.from_values(start[None])
    end = MotionFit(
        DRIVE, problem, z, [Along(0, equation)], {}, partial(MODEL.aliases, DRIVE)
    ).descended(z)
    assert problem.chart.to_values(end)[0, own] == pytest.approx(gain, rel=0.001)


def test_a_step_promises_what_the_last_one_kept(recording):
    places = ("controller.speed_gain",)
    noise, shape = np.random.default_rng(1).standard_normal((2, 200))
    gain, size = 1.02 * DRIVE.controller.speed_gain, 100.0 * np.linalg.norm(shape)

    def left(actuator, values):
        return 100.0 * (actuator.controller.speed_gain / gain - 1.0) * shape + noise

    equation = Equation(
        "controller", left, size, lambda _: np.linalg.norm(noise) / size, places, (), step=0.0
    )
    problem = everything_free(recording)
    z, width = problem.chart.from_values(problem.healthy[None]), 1e4 * np.eye(len(problem.names))
    given = DRIVE, problem, z, [Along(0, equation)], {}, partial(MODEL.aliases, DRIVE), (), width
    first = Regression(*given)
    first.regressed(z)
    before, promised = first.promise
    most = 0.5 * (before + promised)
    assert promised < 0.5 * before
    Regression(*given).regressed(z, most)  # which may be reached
    with pytest.raises(TooFarError):  # the same was promised before, and nothing gained
        Regression(*given).regressed(z, most, first.promise)


def test_what_equations_leave_tells_a_recording_that_they_do_not_explain(recording, found):
    assert found[1].information.unexplained < 0.01
    stuck = recording.channels["current_a"].copy()
    stuck[stuck.size // 2 :] = 0.0
    problem = everything_free(recording.changed(current_a=stuck))
    known, _ = informed(MODEL, DRIVE, problem, problem.healthy)
    assert known.information.unexplained > 0.1


def test_a_start_at_which_loops_are_unstable_gives_way_to_what_is_known(recording):
    problem = everything_free(recording)
    start = problem.start.copy()
    start[problem.names.index("current_loop.proportional_gain")] = 20.0
    with pytest.raises(ParameterError, match="the current loop is unstable"):
        DRIVE.changed({"current_loop.proportional_gain": 20.0})
    away, errors = away_from(FAULTS, (problem, *informed(MODEL, DRIVE, problem, start)))
    assert (away < 4.0 * errors + 1e-3).all()


def test_evidence_is_told_where_the_loops_would_be_unstable(recording):
    """The controller along a recorded motion does not depend on inertias, by which loops settle."""
    problem = everything_free(recording)
    chart = problem.chart
    every = [Along(0, one) for one in MODEL.equations(recording, DRIVE, {})]
    z = chart.from_values(problem.healthy[None])
    fit = MotionFit(DRIVE, problem, z, every, {}, partial(MODEL.aliases, DRIVE))
    point = chart.to_values(fit.descended(z))
    each = {
        "motor.inertia": 0.3 * DRIVE.motor.inertia,
        "controller.speed_gain": 3.0 * DRIVE.controller.speed_gain,
    }
    for place, value in each.items():
        DRIVE.changed({place: value})
        point[0, problem.names.index(place)] = value
    with pytest.raises(ParameterError, match="unstable"):
        DRIVE.changed(each)
    assert fit.evidence(chart.from_values(point)).unexplained < 0.1


def test_ripple_of_a_comparator_is_no_evidence_of_shorts():
    """All shorts alike and a weaker torque constant make the same torque."""
    actuator = load_actuator("servo48").changed(COGGING)
    recording = simulate("reference", HALF, actuator=actuator, noise=Noise(white=0.02), seed=4)
    problem = everything_free(recording, actuator)
    known, point = informed(MODEL, actuator, problem, problem.healthy)
    alike = np.array([one.name.startswith("short") for one in problem.unknowns]) / 3.0
    error = np.sqrt(alike @ covariance_of(known, point) @ alike)
    constant = problem.prior.of(["motor.emf_constant"])
    assert error > 0.5 * np.sqrt(constant.covariance[0, 0])


@pytest.mark.parametrize(
    ("left", "whole", "healthy", "scatter", "said"),
    [
        (0.02, True, 0.5, 0.0, []),  # near instability healthy recordings leave as much
        (0.02, True, 0.3, 0.0, []),
        (0.02, True, 0.03, 0.3, []),  # answers within the width differ by as much
        (0.02, True, 0.03, 0.2, ["leaves 50 % of this recording"]),
        (0.02, True, 0.2, 0.0, ["leaves 50 % of this recording"]),
        (0.4, True, 0.5, 0.5, ["leaves 40 % of this recording"]),
        (0.02, False, 0.5, 0.0, ["leaves 50 % of this recording"]),
        (0.02, True, 0.03, 0.0, ["leaves 50 % of this recording"]),
    ],
)
def test_equations_that_show_every_fault_check_beside_the_closed_loop(
    recording, found, left, whole, healthy, scatter, said
):
    problem, known, point = found
    known = known.informed(known.information._replace(unexplained=left, whole=whole))
    baseline = replace(Baseline.of_template(MODEL, DRIVE), misfit=healthy, recordings=3)
    end = Found(point, 1.0, 1, np.empty((0, 2)), "good fit", "by hand", 1)
    assessed = replace(
        unassessed(MODEL, DRIVE, problem, end, baseline),
        joint=SimpleNamespace(peaks=[SimpleNamespace(problem=known)]),
        scatter=scatter,
    )
    told = obstacles_to("load", recording, problem, end, 0.5, assessed, baseline)
    if whole and left < 0.1:  # a tenth at least, and half at most, however much answers differ
        assert obstacles_to("load", recording, problem, end, 0.51, assessed, baseline)
        assert not obstacles_to("load", recording, problem, end, 0.07, assessed, baseline)
    only = [text for text in told if "what it lacks may pass for a fault" in text]
    assert len(only) == (not whole)  # a closed loop that leaves half of healthy ones judges nothing
    told = [text for text in told if text not in only]
    assert [text[: text.index(" unexplained")].removeprefix("The twin ") for text in told] == said
    by_scatter = [text for text in told if "within the intervals differ by 20 %" in text]
    assert len(by_scatter) == (scatter == 0.2)
    for text in told:  # whose share it is, where the table states another one
        assert ("along its motion (in closed loop" in text) == (left == 0.4)


@pytest.mark.parametrize("turning", [0.0, 1.0])
def test_a_form_that_explains_what_equations_leave_is_told(turning):
    """What the twin cannot explain is no noise where a form explains it."""
    truth = DRIVE.changed({"eccentricity.turning_share": turning})
    faults = {"friction": 0.2, "backlash": 0.1, "short_a": 0.2, "eccentricity": 0.1}
    values = {**faults, "eccentricity_phase": 0.8}  # no shorts alone are such an offset
    noise = Noise(white=0.02)
    recording = simulate("reference", HALF, values, truth, noise=noise, seed=3)
    found = identify(recording, DRIVE, exact=True)
    if turning:
        assert set(found.verdict.faults) == faults.keys()
    else:
        assert "An eccentricity that is fixed in space explains it better" in found.verdict.sentence


@pytest.mark.parametrize(
    ("single", "lacks", "most"),
    [
        (True, "", 0.007), (True, "motor", 0.012), (True, "motor output", 0.012),
        (False, "output", 0.005), (False, "motor", 0.007), (False, "output motor", 0.012),
    ],
)  # fmt: skip
def test_currents_show_every_fault_without_positions(recording, single, lacks, most):
    """Of the phases, or one current, which dips where the drive commutates."""
    names = [f"{side}_{what}" for side in lacks.split() for what in ("position", "speed")]
    seen = with_one_current(recording) if single else recording
    found = identify(seen.changed(**dict.fromkeys(names)), DRIVE, exact=True)
    assert set(found.verdict.faults) == FAULTS.keys()
    for name, value in FAULTS.items():
        assert found.values[name] == pytest.approx(value, abs=most)
        low, high = found.intervals[name]
        assert low - 0.001 < value < high + 0.001


def test_less_than_equations_need_is_judged_by_a_healthy_closed_loop(recording):
    """The magnitude of a current shows no motion."""
    healthy = simulate("reference", HALF, actuator=DRIVE, noise=Noise(white=0.02), seed=5)
    sheet = Baseline.of_template(MODEL, DRIVE)
    baseline = replace(sheet, recordings=1)
    loop = closed_loop(MODEL, DRIVE, baseline, MODEL.compare(healthy, DRIVE))
    assert loop is not None
    assert 0.001 < loop.misfit < 0.02  # white noise of 2 %, smoothed
    assert max(loop.scatter.values()) < 0.02
    baseline = replace(sheet, misfit=0.5, recordings=3, closed_loop=loop)
    names = [f"{side}_{what}" for side in ("motor", "output") for what in ("position", "speed")]
    magnitude = np.abs(with_one_current(recording).channels["current"])
    without = recording.changed(**dict.fromkeys((*names, *PHASES)), current=magnitude)
    found = identify(without, Calibration(DRIVE, baseline))
    # by the template's tolerances friction and gain may be anything of their size
    assert {"short_b", "eccentricity"} <= set(found.verdict.faults) <= FAULTS.keys()


def test_a_comparator_shows_no_commutations_in_one_current():
    """Its ripple resembles a few."""
    plain = load_actuator("servo48")
    seen = simulate("reference", actuator=plain, noise=Noise(white=0.02), seed=4)
    without = with_one_current(seen).changed(motor_position=None, motor_speed=None)
    assert not MODEL.equations(without, plain)


@pytest.mark.parametrize(("left", "judged"), [(0.01, True), (0.03, False)])
def test_what_healthy_recordings_leave_of_no_known_form_may_pass_for_a_fault(left, judged):
    plain = load_actuator("servo48")
    seen = simulate("reference", faults={"short_b": 0.2}, noise=Noise(white=0.02), seed=4)
    baseline = Baseline.of_template(MODEL, plain)
    baseline = replace(baseline, misfit=left, expected_misfit=0.003, recordings=3)
    found = identify(seen, Calibration(plain, baseline))
    assert ("short_b" in found.verdict.faults) == judged
    lacking = "In closed loop the twin leaves 3 % of the healthy recordings"
    assert (lacking in found.verdict.sentence) == (not judged)
