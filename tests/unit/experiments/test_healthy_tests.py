"""Healthy tests: what they promise is what a calibration states, within limits."""

import numpy as np
import pytest

import ematwin
from ematwin.errors import InputError
from ematwin.estimation.baseline import Baseline
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet, Section, quantity
from ematwin.models.scenario import Scenario, Step
from ematwin.models.unknown import Unknown
from ematwin.monitoring.calibration import Calibration
from ematwin.recordings.channel import Channel
from ematwin.report.experiments import healthy_tests_page
from own_model import forgotten

NOISE = 1e-3  # m/s


class Drag(Section):
    linear: float = quantity("N*s/m", "drag", tolerance=0.2, gt=0)
    cubic: float = quantity("1", "further speed for each cubic newton", tolerance=0.5, gt=0)
    unseen: float = quantity("kg", "of what nothing depends on", tolerance=0.3, gt=0)


class Boat(ParameterSet):
    """A boat whose speed follows its thrust at once."""

    kind = "boat"
    default = "boat"
    drag: Drag


class BoatModel(Model):
    kind = "boat"
    title = "boat"
    parameters = Boat
    command = "thrust"
    channels = (
        Channel("thrust", "N", "thrust", ("f",)), Channel("speed", "m/s", "speed", ("v",)),
    )  # fmt: skip
    needs = ("speed",)
    sample_rate = 100.0
    model_error = 1.0

    def load_scenario(self, given=None):
        return given or Scenario(name="push", duration=1.0, command=[Step(value=0.5, time=0.2)])

    def sensors(self, actuator):
        return ()  # its sensor is exact but for noise

    def unknowns(self, actuator):
        return (Unknown("fouling", "", "drag of a dirty hull", 1.0, 0.5, 3.0),)

    def noise(self, actuator, recording):
        return {"speed": NOISE}

    def respond(self, actuator, inputs, candidates, count):
        drag = actuator.varied(candidates).drag
        slow = np.ones(count) * drag.linear * candidates.get("fouling", 1.0)
        thrust = inputs.channels["thrust"]
        cubic = np.ones(count) * drag.cubic
        return {"speed": thrust / slow[:, None] + cubic[:, None] * thrust**3}


@pytest.fixture(scope="module")
def boat():
    with forgotten():
        ematwin.register_model(BoatModel())
        yield Boat(name="boat", description="", drag=Drag(linear=2.0, cubic=0.1, unseen=1.0))


@pytest.fixture(scope="module")
def proposed(boat):
    return ematwin.healthy_tests(boat, thrust=1.0)


def test_errors_are_those_of_the_linear_regression(boat, proposed):
    spreads = np.log1p([0.2, 0.5, 0.3]) / 2.0
    precision = np.diag(1.0 / spreads**2)
    for test in proposed.tests:
        thrust = ematwin.simulate(None, test.scenario, None, boat).channels["thrust"]
        slopes = np.array([-thrust / 2.0, 0.1 * thrust**3, 0.0 * thrust])
        precision = precision + slopes @ slopes.T / NOISE**2
        expected = np.sqrt(np.diag(np.linalg.inv(precision)))
        assert list(test.errors.values()) == pytest.approx(expected, rel=0.02)


def test_a_calibration_on_the_tests_states_and_keeps_what_they_promise(boat, proposed):
    true = boat.changed({"drag.linear": 2.2, "drag.cubic": 0.08})
    rng = np.random.default_rng(1)
    recordings = []
    for scenario in proposed.scenarios:
        clean = ematwin.simulate(None, scenario, None, true)
        speed = clean.channels["speed"]
        recordings.append(clean.changed(speed=speed + NOISE * rng.standard_normal(speed.shape)))
    found = {one.place: one for one in ematwin.calibrate(recordings, boat).parameters}
    for place in ("drag.linear", "drag.cubic"):
        one, promised = found[place], proposed.after[place]
        assert one.standard_error / one.value == pytest.approx(promised, rel=0.5)
        assert abs(np.log(one.value / true.value(place))) < 3.0 * promised


def test_each_test_lowers_errors_and_keeps_the_limits(proposed):
    before = proposed.known
    for test in proposed.tests:
        assert test.demands["thrust"] <= 1.001
        assert all(test.errors[place] <= 1.001 * before[place] for place in before)
        before = test.errors
    assert proposed.after["drag.cubic"] < 0.9 * proposed.repeated["drag.cubic"]


def test_what_nothing_depends_on_stays_open(proposed):
    assert proposed.open_after(proposed.after) == ["drag.unseen"]
    assert "any test within the limits: drag.unseen." in proposed.open_sentence
    page = healthy_tests_page(proposed)
    assert proposed.tests[0].scenario.description in page
    assert proposed.plot("errors").data
    assert list(proposed.to_frame().index) == ["drag.linear", "drag.cubic", "drag.unseen"]


def test_a_calibration_counts_as_known(boat, proposed):
    recording = ematwin.simulate(None, proposed.scenarios[0], None, boat)
    twin = ematwin.calibrate([recording], boat)
    more = ematwin.healthy_tests(twin, thrust=1.0)
    errors = {one.place: one.standard_error / one.value for one in twin.parameters}
    assert more.known == pytest.approx(errors)
    assert more.open_after(more.known) == ["drag.unseen"]


def test_bad_input_is_refused(boat):
    with pytest.raises(InputError, match="tests must be a whole number of at least 1, received 0"):
        ematwin.healthy_tests(boat, tests=0)
    with pytest.raises(InputError, match="no limit 'force' for the kind boat; choose of thrust"):
        ematwin.healthy_tests(boat, force=1.0)
    with pytest.raises(InputError, match="Nothing of boat is uncertain"):
        ematwin.healthy_tests(Calibration(boat, Baseline.of_simulation()))
    with pytest.raises(InputError, match="position-servo differ by more than noise"):
        ematwin.healthy_tests("sts3215")
