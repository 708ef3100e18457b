"""Commands for a kind of one's own: a sled that a force pushes, and that friction may hold."""

import math

import numpy as np
import pytest

import ematwin
from ematwin.errors import RecordError
from ematwin.experiments.command_errors import identified_errors
from ematwin.experiments.experiment import Experiment
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet, Section, quantity
from ematwin.models.scenario import Chirp, Scenario
from ematwin.models.unknown import Unknown
from ematwin.recordings.channel import Channel
from ematwin.report.experiments import design_page
from own_model import forgotten

FORCE = 4.0  # N; friction of 1 N holds from 4 times on


class Body(Section):
    mass: float = quantity("kg", "all that moves", tolerance=0.02, gt=0)
    friction: float = quantity("N", "dry friction", gt=0)


class Sled(ParameterSet):
    """A sled on a plane."""

    kind = "sled"
    default = "sled"
    body: Body


class SledModel(Model):
    kind = "sled"
    title = "sled that a force pushes"
    parameters = Sled
    command = "force"
    channels = (Channel("force", "N", "force", ("f",)), Channel("speed", "m/s", "speed", ("v",)))
    needs = ("speed",)
    sample_rate = 200.0

    def load_scenario(self, given=None):
        push = Chirp(amplitude=FORCE, f_start=4.0, f_end=8.0)
        return given or Scenario(name="push", duration=0.25, command=[push])

    def unknowns(self, actuator):
        return (
            Unknown("friction", "", "dry friction", 1.0, 0.2, 12.0, physical_unit="N",
                    physical=lambda a, k: k * a.body.friction),
            Unknown("ballast", "", "mass", 1.0, 0.5, 3.0),
        )  # fmt: skip

    def noise(self, actuator, recording):
        return {"speed": 1e-3}

    def respond(self, actuator, inputs, candidates, count):
        values = {**self.healthy(actuator), **candidates}
        body, h = actuator.varied(candidates).body, inputs.interval
        mass, dry = body.mass * values["ballast"], body.friction * values["friction"]
        speed = np.zeros((count, len(inputs.time)))
        for n, force in enumerate(inputs.force[:-1], start=1):
            free = speed[:, n - 1] + h * force / mass
            speed[:, n] = np.sign(free) * np.maximum(np.abs(free) - h * dry / mass, 0.0)
        return {"speed": speed}


@pytest.fixture(scope="module")
def sled(tmp_path_factory):
    """Path of its file, while the kind is registered."""
    path = tmp_path_factory.mktemp("sled") / "sled.toml"
    path.write_text(
        'kind = "sled"\nname = "sled"\ndescription = "made up"\n[body]\n'
        'mass = { value = 2, unit = "kg", source = "made up" }\n'
        'friction = { value = 1, unit = "N", source = "made up" }\n'
    )
    with forgotten():
        ematwin.register_model(SledModel())
        yield path


def test_vectors_at_which_nothing_moves_are_left_out_and_said(sled):
    found = ematwin.design(sled, budget=4, trials=1, threads=1)
    assert found.left_out > 0
    assert found.draws + found.left_out == 16
    assert all(math.isfinite(x) for x in found.default.errors.values())
    assert f"{found.left_out} of 16 drawn fault vectors" in found.left_out_sentence
    assert found.left_out_sentence in design_page(found)
    assert list(found.limits) == ["force"]


def test_trials_leave_out_a_sled_that_friction_holds(sled):
    setting = Experiment.of(sled, threads=1)
    errors = identified_errors(setting, [setting.model.load_scenario(None)], 8, seed=3)
    assert errors.shape == (8, 1, 2)
    answered = np.isfinite(errors).all(axis=(1, 2))
    assert 0 < answered.sum() < 8
    assert np.abs(errors[answered][..., 0]).max() < 0.1


def test_a_recording_in_which_nothing_moves_is_refused_in_a_sentence(sled):
    still = ematwin.simulate(actuator=sled, faults={"friction": 6.0})
    with pytest.raises(RecordError, match=r"nothing but zeros in speed: nothing moves\. Give"):
        ematwin.identify(still, sled)
