"""Two explanations of a recording: how far apart a command brings them."""

import json

import numpy as np
import pytest

import ematwin
from ematwin.errors import InputError
from ematwin.experiments.discriminate import Pair
from ematwin.experiments.experiment import Experiment
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario, Step

ACTUATOR = load_actuator(None)
MODEL = model_of(ACTUATOR)
WARM = 0.95 * ACTUATOR.value("motor.emf_constant")
SHORTS = dict.fromkeys(("short_a", "short_b", "short_c"), 0.05)


def pair(first, second):
    return Pair(Experiment.of(None, exact=True, threads=1), first, second)


def test_distance_between_points_is_that_of_their_answers():
    given = MODEL.load_scenario()
    both = pair({"friction": 0.1, "gain": 0.5}, {"friction": 0.0, "gain": 0.52})
    record = both.experiment.record(given, fast=True)
    comparison = MODEL.compare(record, ACTUATOR, threads=1)
    values = {"friction": np.array([0.1, 0.0]), "gain": np.array([0.5, 0.52])}
    first, second = comparison.residuals(values, 2)
    noise = comparison.model_error * comparison.noise
    assert both.distance(record) == pytest.approx(np.linalg.norm(first - second) / noise, rel=1e-6)


def test_what_only_one_names_is_fitted_to_the_other():
    record = pair(SHORTS, {}).experiment.record(MODEL.load_scenario(), fast=True)
    far = pair({**SHORTS, "motor.emf_constant": WARM / 0.95}, {**dict.fromkeys(SHORTS, 0.0),
               "motor.emf_constant": WARM}).distance(record)  # fmt: skip
    near = pair(SHORTS, {"motor.emf_constant": WARM}).distance(record)
    assert near <= far * (1.0 + 1e-9)


def test_a_load_tells_efficiency_from_friction():
    both = pair({"friction": 0.05}, {"transmission.efficiency_opposing": 0.8})
    record = both.experiment.record
    given = MODEL.load_scenario()
    free = Scenario(duration=0.5, command=given.command)
    loaded = Scenario(duration=0.5, command=given.command, load=[Step(value=10.0)])
    assert both.distance(record(loaded, fast=True)) > 2.0 * both.distance(record(free, fast=True))


def test_warm_magnets_and_equal_shorts_stay_one_whatever_the_command():
    found = ematwin.discriminate(SHORTS, {"motor.emf_constant": WARM}, budget=3, threads=1)
    assert not found.told
    assert found.distance < 1.0
    assert "No command within the limits" in found.sentence
    assert json.dumps(found.as_dict(), allow_nan=False)


def test_the_best_command_is_never_worse_than_the_given_one(tmp_path):
    found = ematwin.discriminate(
        {"friction": 0.05}, {"load_offset": 1.0}, exact=True, budget=6, threads=1
    )
    assert found.told
    assert found.distance >= found.default_distance * (1.0 - 1e-3)
    assert found.demands["travel"] <= found.limits["travel"] * (1.0 + 1e-3)
    found.save(tmp_path / "next.toml")
    assert Scenario.load_file(tmp_path / "next.toml").command == found.scenario.command


def test_one_explanation_twice_is_refused():
    with pytest.raises(InputError, match="one and the same"):
        ematwin.discriminate({"friction": 0.1}, {"friction": 0.1})
    with pytest.raises(InputError, match="Unknown fault 'wear'"):
        ematwin.discriminate({"wear": 0.1}, {"friction": 0.1})
