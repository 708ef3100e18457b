"""Designed commands: expected errors, those of `identify`, and bad input."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import ematwin
from ematwin.errors import InputError
from ematwin.estimation.corrected_problem import corrected_at
from ematwin.estimation.noise import with_shown_noise
from ematwin.experiments.candidates import candidates
from ematwin.experiments.command_errors import expected_errors, fault_vectors, identified_errors
from ematwin.experiments.experiment import BEYOND, Experiment
from ematwin.monitoring.identify import identify
from ematwin.quantities import use_units
from ematwin.report.experiments import price_table

NOISE = ematwin.Noise(white=0.02, bits=12)
quick = partial(
    ematwin.design, exact=True, draws=1, fresh=1, budget=6, trials=1, noise=NOISE, threads=1
)


@pytest.fixture(scope="module")
def found():
    return quick("rm1605", noise=None)


def experiment(threads=1):
    return Experiment.of(None, exact=True, noise=NOISE, threads=threads)


def screw(threads=1):
    """Of a kind that is identified in a tenth of a second."""
    return Experiment.of("rm1605", exact=True, threads=threads)


def vectors(count, **given):
    return fault_vectors(experiment(), count, np.random.default_rng(1), given, even=True)


GIVEN, STROKE = (one.model.load_scenario(None) for one in (experiment(), screw()))


def test_expected_errors_are_those_of_a_linear_fit():
    """Written out for one vector: slopes at the truth, and the noise that is left there."""
    setting, (values,) = experiment(), vectors(1)
    found = expected_errors(setting, GIVEN, [values], {}).errors
    record = setting.model.simulate(
        setting.actuator, GIVEN, values, fidelity="reference", noise=NOISE, seed=1
    )
    plain = ematwin.Problem.of(record, setting.actuator, threads=1)
    point = np.array([values[name] for name in plain.names])
    problem = corrected_at(plain, point)
    here = problem.residuals(point[None])[0]
    problem = with_shown_noise(problem, here, problem.noise)
    chart, step = problem.chart, 2e-3
    z = chart.from_values(point[None])
    up, down = (problem.residuals(chart.to_values(z + h * np.eye(8))) for h in (step, -step))
    slopes = (up - down) / (2.0 * step)
    errors = problem.noise * np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    expected = dict(zip(problem.names, errors, strict=True))
    # a vector counts by its larger component
    expected["eccentricity"] = max(expected["eccentricity"], expected["eccentricity_phase"])
    for one in setting.magnitudes:
        assert found[one.name] == pytest.approx(expected[one.name] * one.width, rel=0.2)


@pytest.mark.parametrize("actuator", ["servo48", "rm1605", "emps", "servo400"])
def test_candidates_differ_and_ask_for_no_more_than_travel_and_load(actuator):
    setting = Experiment.of(actuator, threads=1)
    given = setting.model.load_scenario(None)
    limits = {**setting.demanded(given), "load": 8.0}
    made = list(candidates(setting.model, given, limits))
    assert len({one.description for one in made}) == len(made) > 30
    for one in made:
        command, load = one.histories(np.linspace(0.0, one.duration, 2001))
        assert 0.0 < np.abs(command).max() <= limits["travel"]
        assert np.abs(load).max() <= 8.0
        assert one.duration == given.duration


def test_the_design_is_never_worse_and_keeps_the_limits(found):
    assert found.gain >= 1.0
    assert found.observed_gain is None or found.observed_gain >= 1.0
    assert found.promised.weakest in found.promised.errors
    for name, limit in found.limits.items():
        assert found.promised.demands[name] <= limit * (1.0 + 1e-3)
    assert found.limits == found.default.demands
    assert found.evaluations == 6
    json.dumps(found.as_dict(), allow_nan=False)


def test_the_price_is_in_the_units_of_the_user(found):
    in_si = price_table(found).rows[1].cells
    use_units("length=mm")
    try:
        in_mm = price_table(found).rows[1].cells
    finally:
        use_units("")
    assert in_si[0] == in_mm[0] == "travel"
    assert (in_si[3][-2:], in_mm[3][-3:]) == (" m", " mm")
    assert float(in_mm[3][:-3]) == pytest.approx(1e3 * float(in_si[3][:-2]), rel=1e-3)


def test_nothing_is_said_to_be_lowered_that_was_not_observed(found):
    designed = replace(found.promised, scenario=found.scenario.lasting(0.4))
    seen = {name: 2.0 * error for name, error in designed.errors.items()}
    one = replace(
        found,
        promised=replace(designed, observed=seen, checks=8),
        default=replace(found.default, observed={n: 3.0 * e for n, e in seen.items()}, checks=8),
    )
    assert f"about {min(one.gain, 3.0):.1f} times" in one.sentence
    assert "3.0 on 8 simulated recordings" in one.sentence
    assert "3.0 on 8 other simulated" in replace(one, checked=True).sentence
    assert (
        "no recording was identified"
        in replace(one, promised=replace(designed, observed={})).sentence
    )
    worse = {name: 2.0 * error for name, error in found.default.errors.items()}
    beyond = replace(found.default, obstacle=BEYOND)
    over = replace(one, default=replace(one.default, obstacle=BEYOND))
    assert over.sentence.startswith("The given command is beyond the limits. This one lowers")
    less = replace(found, promised=replace(designed, errors=worse), default=beyond)
    assert "given command is beyond the limits" in less.sentence
    assert "(share of the range) is 2.0 times that with the given" in less.sentence
    same = replace(found, promised=found.default)
    assert "the given one stays" in same.sentence


def test_one_seed_gives_one_command():
    first, again, other = (quick("rm1605", noise=None, seed=seed) for seed in (1, 1, 2))
    assert first.scenario == again.scenario
    assert first.promised.errors != other.promised.errors


def test_an_interrupted_search_keeps_its_best():
    def stop(count, best, budget):
        raise KeyboardInterrupt

    kept = quick("rm1605", noise=None, budget=200, progress=stop)
    assert kept.stopped == "interrupted"
    assert kept.evaluations < 200
    assert kept.gain >= 1.0


def test_trials_that_share_the_cores_err_as_one_after_another():
    shares: list[float] = []
    alone = identified_errors(screw(), [STROKE], 3, seed=3, progress=shares.append)
    assert shares == pytest.approx([1 / 3, 2 / 3, 1.0])
    assert alone.shape == (3, 1, 3)
    np.testing.assert_array_equal(alone, identified_errors(screw(3), [STROKE], 3, seed=3))


def test_interrupted_trials_keep_the_actuators_that_answered_every_command():
    def stop(share):
        if share == 0.5:
            raise KeyboardInterrupt

    errors = identified_errors(screw(), [STROKE, STROKE], 4, seed=3, progress=stop)
    assert errors.shape == (2, 2, 3)
    assert np.isfinite(errors).all()


def test_what_is_observed_stands_beside_what_was_promised(found):
    checked = found.check(1, seed=3)
    assert checked.promised.checks == checked.default.checks == 1
    for one in (checked.promised, checked.default):
        assert set(one.observed) == set(one.errors)
        assert 0.0 < max(one.observed.values()) < 0.05
    assert checked.observed_gain > 0.0
    assert checked.checked


def test_another_kind_and_a_data_sheet_are_designed_for_alike():
    other = ematwin.design("rm1605", draws=1, fresh=1, trials=1, budget=6, threads=1)
    assert set(other.promised.errors) == {"friction", "backlash", "gain"}
    assert other.gain >= 1.0
    assert all(place not in other.promised.errors for place in other.held)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"fault": "wear"}, "Unknown fault 'wear'"),
        ({"fault": "eccentricity_phase"}, "direction of eccentricity"),
        ({"duration": -1.0}, "duration must be a positive number"),
        ({"torque": 1.0}, "no limit 'torque'.*travel, speed, current, load"),
        ({"travel": 0.0}, "limit of travel must be a positive number"),
        ({"current": 0.01}, "No command of servo48 keeps the limits"),
        ({"travel": 1e-5}, "No command of servo48 keeps the limits"),
        ({"scenario": "out-and-back"}, "no scenario 'out-and-back'"),
        ({"draws": 0}, "draws must be a whole number of at least 1"),
        ({"draws": 2.5}, "draws must be a whole number of at least 1, received 2.5"),
        ({"seed": -1}, "seed must be a whole number of at least 0"),
    ],
)
def test_wrong_input_gets_one_sentence(options, said):
    with pytest.raises(InputError, match=said):
        quick("servo48", **{"budget": 5, **options})


def test_trials_err_as_identify_does():
    setting = screw()
    (errors,) = identified_errors(setting, [STROKE], 1, seed=3)
    rng = np.random.default_rng(3)
    (faults,) = fault_vectors(setting, 1, rng, {}, even=False)
    real = setting.drawn_actuator(rng)
    record = setting.model.simulate(real, STROKE, faults, seed=30_000)
    answer = identify(record, setting.actuator, exact=True, threads=1)
    expected = [answer.values[one.name] - faults[one.name] for one in setting.magnitudes]
    np.testing.assert_allclose(errors[0], expected, rtol=0.0, atol=1e-12)
