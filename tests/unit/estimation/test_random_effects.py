"""Parameters that differ between recordings, against what is known of linear, normal problems."""

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from ematwin.estimation.mixed_effects import assessed_sets
from ematwin.estimation.random_effects import effects_of, errors_of_mean, fit, learn_effects
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet, Section, quantity
from ematwin.models.unknown import Unknown
from ematwin.recordings.channel import Channel
from ematwin.recordings.recording import Recording

TIME = np.arange(200) * 0.01


class Line(Section):
    """A line."""

    height: float = quantity("m", "at the start", tolerance=0.5, drift=0.2, gt=0)
    slope: float = quantity("m/s", "of the line", tolerance=0.5, drift=0.2, gt=0)


class Lines(ParameterSet):
    """Something whose answer is a line in time, bent by a fault."""

    kind: ClassVar[str] = "lines"
    default: ClassVar[str] = "lines"
    line: Line


class LinesModel(Model):
    """exp(log height) + slope t + (bend - 1) t^2, compared with unit noise of its own."""

    kind: ClassVar[str] = "lines"
    title: ClassVar[str] = "lines"
    parameters: ClassVar[type[ParameterSet]] = Lines
    command: ClassVar[str] = "command"
    channels: ClassVar[tuple[Channel, ...]] = (
        Channel("command", "m", "unused"),
        Channel("place", "m", "of the point"),
    )
    recordings_differ: ClassVar[bool] = True
    noise_level: ClassVar[float] = 0.02

    def unknowns(self, actuator):
        return (
            Unknown("bend", "", "curvature", 1.0, 0.3, 3.0, logarithmic=True),
            Unknown("other", "", "has no effect", 1.0, 0.3, 3.0, logarithmic=True),
        )

    def noise(self, actuator, recording):
        return {"place": self.noise_level}

    def respond(self, actuator, inputs, candidates, count):
        one = np.ones(count)
        height = candidates.get("line.height", one * actuator.line.height)
        slope = candidates.get("line.slope", one * actuator.line.slope)
        bend = candidates.get("bend", one)
        time = inputs.time[None]
        place = height[:, None] + slope[:, None] * time + (bend - 1.0)[:, None] * time**2
        return {"place": place}


MODEL = LinesModel()
TEMPLATE = Lines.model_validate({
    "name": "lines", "description": "made up", "line": {"height": 1.0, "slope": 1.0},
})  # fmt: skip


def recorded(rng, height=1.0, slope=1.0, bend=1.0):
    place = height + slope * TIME + (bend - 1.0) * TIME**2
    place += 0.02 * rng.standard_normal(TIME.size)
    return MODEL.compare(Recording(TIME, {"command": 0.0 * TIME, "place": place}), TEMPLATE)


def nominals(spread):
    """Height and slope of a recording, by how they differ from the mean."""
    return [
        replace(MODEL.unknown(TEMPLATE, place), spread=spread)
        for place in ("line.height", "line.slope")
    ]


def healthy(rng, count, spread=0.1, mean=1.2):
    return [recorded(rng, *(mean * np.exp(spread * rng.standard_normal(2)))) for _ in range(count)]


def test_mean_and_spread_of_many_recordings_are_found():
    rng = np.random.default_rng(1)
    each = np.log(1.2) + 0.1 * rng.standard_normal((60, 2))
    _, baseline, _ = learn_effects(MODEL, TEMPLATE, [recorded(rng, *np.exp(one)) for one in each])
    assert baseline.prior.mean == pytest.approx(each.mean(axis=0), abs=0.02)
    spread = np.sqrt(np.diag(baseline.prior.covariance))
    assert spread == pytest.approx(each.std(axis=0), rel=0.2)
    assert baseline.recordings == 60


def test_recordings_that_are_alike_have_no_more_spread_than_is_stated():
    _, alike, _ = learn_effects(MODEL, TEMPLATE, healthy(np.random.default_rng(2), 40, spread=1e-4))
    assert np.all(np.sqrt(np.diag(alike.prior.covariance)) < 0.04)


def test_peak_and_width_are_those_of_generalised_least_squares():
    """With the recordings' own parameters integrated out, what is shared is a weighted mean."""
    rng = np.random.default_rng(3)
    own = nominals(0.01)
    shared = [replace(MODEL.unknown(TEMPLATE, "bend"), spread=10.0)]
    comparisons = [
        recorded(rng, *np.exp(0.01 * rng.standard_normal(2)), bend=1.1) for _ in range(5)
    ]
    peak = fit(comparisons, shared, own)
    # near the answer all is linear: heights and slopes have unit values, the bend its own
    design = np.c_[np.ones_like(TIME), TIME]
    square = (TIME**2)[:, None]
    cov = 0.02**2 * np.eye(TIME.size) + 0.01**2 * design @ design.T
    weight = np.linalg.solve(cov, square)
    information = 5.0 * float((square.T @ weight)[0, 0])
    places = np.array([c.measured()["place"] for c in comparisons])
    left = (places - 1.0 - TIME).sum(axis=0)
    exact = float((left @ weight)[0]) / information
    assert peak.point[0] - 1.0 == pytest.approx(exact, abs=2e-4)
    error = math.sqrt(peak.approximated()[1][0, 0]) * peak.point[0]
    assert error == pytest.approx(information**-0.5, rel=0.03)


@pytest.mark.parametrize(("bend", "named"), [(1.0, False), (1.1, True)])
def test_a_fault_is_probable_where_it_is_and_not_where_it_is_not(bend, named):
    rng = np.random.default_rng(4)
    effects = nominals(0.02)
    found, *_ = assessed_sets([recorded(rng, bend=bend)], MODEL.faults(TEMPLATE), effects, {})
    assert (found.probabilities["bend"] > 0.95) == named
    assert found.probabilities["other"] < 0.35  # no more than beforehand
    low, high = interval(found)
    assert low < bend < high


class FoldedModel(LinesModel):
    """The same with x (1.2 - x) t^2, x = log bend: two bends give the same answer."""

    kind: ClassVar[str] = "folded lines"

    def respond(self, actuator, inputs, candidates, count):
        x = np.log(candidates.get("bend", np.ones(count)))
        return super().respond(actuator, inputs, {**candidates, "bend": 1.0 + x * (1.2 - x)}, count)


def test_a_fault_with_two_minima_has_an_interval_over_both():
    """A scan with all else healthy finds the further one, a descent from healthy the other."""
    model, rng = FoldedModel(), np.random.default_rng(7)
    place = 1.0 + TIME + 0.4 * 0.8 * TIME**2 + 0.02 * rng.standard_normal(TIME.size)
    given = model.compare(Recording(TIME, {"command": 0.0 * TIME, "place": place}), TEMPLATE)
    effects = nominals(0.02)
    low, high = interval(assessed_sets([given], model.faults(TEMPLATE)[:1], effects, {})[0])
    assert math.log(low) < 0.4 < 0.8 < math.log(high)


def interval(found):
    """95 % of a bend, if it is there."""
    one = MODEL.unknown(TEMPLATE, "bend")
    return found.given("bend").interval("bend", one.lower, one.upper)


def test_intervals_of_a_fault_hold_as_often_as_they_say():
    rng = np.random.default_rng(5)
    actuator, baseline, _ = learn_effects(MODEL, TEMPLATE, healthy(rng, 30))
    effects = effects_of(MODEL, actuator, baseline)
    inside = 0
    for one in healthy(rng, 60):
        low, high = interval(assessed_sets([one], MODEL.faults(TEMPLATE)[:1], effects, {})[0])
        inside += low <= 1.0 <= high
    assert 53 <= inside <= 60


def test_recordings_that_tell_a_combination_leave_its_parts_unknown():
    variance, prior = np.array([0.01, 0.02]), np.array([0.3, 0.3])
    along, noise, count = np.array([1.0, 1.0]) / np.sqrt(2.0), 1e-4, 50
    one = np.linalg.inv(np.outer(along, along) / noise + np.diag(1.0 / variance))
    found = errors_of_mean(np.tile(one, (count, 1, 1)), variance, prior)
    # each recording gives the mean of the combination, with its own noise and spread
    told = count * np.outer(along, along) / (noise + along @ (variance * along))
    expected = np.linalg.inv(told + np.diag(prior**-2.0))
    assert found == pytest.approx(np.sqrt(np.diag(expected)))
    assert np.sqrt(along @ expected @ along) < 0.02 < 0.2 < found.min()
