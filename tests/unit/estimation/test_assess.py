"""Values with intervals, on an actuator so simple that the answers can be worked out by hand.

It answers with ``size (1 + wear)`` on one basis, so that a worn small one is a healthy large one;
with ``(gap - 0.5)**2`` on another, so that two gaps explain a recording alike; and with a slope of
its sensor on a third. The bases are orthogonal.
"""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ematwin.estimation.assess import Assessment, _evident, assess
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.constants import CERTAIN
from ematwin.estimation.intervals import Interval, contrasts_of
from ematwin.estimation.prior import Prior
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found
from ematwin.estimation.spike_and_slab import FaultSet, FaultSets
from ematwin.models.unknown import Alias, Contrast, Unknown
from naive.toy import OneChannel

NOISE, SAMPLES = 0.01, 200
SPREAD = 0.05  # of the logarithm of the size
MODEL_ERROR = 1.5
TWO_SIDED = 1.96
SIZE, WEAR, GAP, SLOPE = 1.1, 0.3, 0.2, 0.5  # of the recording

_T = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
BASES = np.sqrt(2.0) * np.array([np.sin(_T), np.sin(2.0 * _T), np.sin(3.0 * _T)])  # RMS of 1
WORSE = 0.005 * np.sqrt(2.0) * np.sin(4.0 * _T)  # what one of two gaps does not explain


class Answer(OneChannel):
    """A recording of the made-up actuator; ``worse`` makes gaps above a half explain it less."""

    model_error = MODEL_ERROR

    def __init__(self, worse: float = 0.0) -> None:
        self.worse = worse
        noise = NOISE * np.random.default_rng(2).standard_normal(SAMPLES)
        super().__init__(self._y(SIZE, WEAR, GAP, SLOPE) + noise, NOISE)

    def _y(self, size, wear, gap, slope):
        parts = np.stack([size * (1.0 + wear), 10.0 * (gap - 0.5) ** 2, slope], axis=-1)
        return parts @ BASES + self.worse * np.multiply.outer(np.asarray(gap) > 0.5, WORSE)

    def responses(self, candidates, count):
        default = {"part.size": SIZE, "wear": 0.0, "gap": 0.0, "slope": 0.0}
        values = [
            np.broadcast_to(candidates.get(name, value), count) for name, value in default.items()
        ]
        return {"y": self._y(*values)}


class Actuator:
    """What an assessment asks of a parameter set."""

    def __init__(self, size: float = SIZE, drift: float | None = None) -> None:
        self.size, self._drift = size, drift

    def with_arrays(self, values):
        return Actuator(values.get("part.size", self.size))

    def drift(self, place):
        return self._drift


class Kind:
    """What an assessment asks of a kind."""

    default_search, model_error = "multistart", MODEL_ERROR
    monitoring = None

    def unknowns(self, actuator):
        return (
            Unknown("wear", "", "", 0.0, 0.0, 2.0, physical_unit="m",
                    physical=lambda actuator, k: actuator.size * (1.0 + k)),
            Unknown("gap", "", "", 0.0, 0.0, 1.0),
            Unknown("slope", "", "", 0.0, -2.0, 2.0, "nuisance", spread=0.4, marginal=True),
        )  # fmt: skip

    def marginal(self, actuator):
        return [one for one in self.unknowns(actuator) if one.marginal]

    def unknown(self, actuator, name):
        if name == "part.size":
            return Unknown(name, "m", "", actuator.size, 0.2, 5.0, "nominal", logarithmic=True)
        return next(one for one in self.unknowns(actuator) if one.name == name)

    def aliases(self, actuator, values):
        return [Alias("part.size", {"wear": 1.0 + values["wear"]})]

    def contrasts(self, actuator):
        return (
            Contrast("both", {"wear": 0.5, "gap": 0.5}, "mean of both"),
            Contrast("elsewhere", {"wear": 1.0, "unheard of": 1.0}, "of another kind"),
        )


KNOWN = Baseline(
    Prior(("part.size",), np.array([math.log(SIZE)]), np.array([[SPREAD**2]])), recordings=3
)


def assessed(baseline=KNOWN, actuator=None, *, point=(0.4, 0.25), others=(), worse=0.0):
    kind, actuator = Kind(), actuator or Actuator()
    faults = [one for one in kind.unknowns(actuator) if not one.marginal]
    problem = Problem([Answer(worse)], faults)
    start = np.array(point)
    found = Found(
        start, float(problem.costs(start[None])[0]), 10, np.zeros((1, 2)), "enough", "none", 1,
        others=tuple(np.array(one) for one in others),
    )  # fmt: skip
    return assess(kind, actuator, problem, found, baseline)  # type: ignore[arg-type]


def half_width(interval) -> float:
    return 0.5 * (interval.high - interval.low)


# What follows from one basis alone: the size that is worn, less the noise.
SHARP = MODEL_ERROR * NOISE / math.sqrt(SAMPLES)


@pytest.fixture(scope="module")
def calibrated() -> Assessment:
    return assessed()


def test_values_are_those_of_the_recording_with_all_that_is_free(calibrated) -> None:
    values = calibrated.values
    assert set(values) == {"wear", "gap", "slope", "part.size"}
    assert values["wear"] == pytest.approx(WEAR, abs=5e-3)
    assert values["gap"] == pytest.approx(GAP, abs=2e-3)
    assert values["slope"] == pytest.approx(SLOPE, abs=5e-3)
    assert calibrated.cost == pytest.approx(SAMPLES * NOISE**2, rel=0.3)
    assert calibrated.evaluations > 0


def test_an_interval_holds_what_the_uncertain_parameter_leaves_open(calibrated) -> None:
    interval = calibrated.intervals["wear"]
    # wear and size give the same answer: their product is known, the size as far as it was before
    expected = TWO_SIDED * (1.0 + WEAR) * SPREAD
    assert half_width(interval) == pytest.approx(expected, rel=0.05)
    assert interval.low < WEAR < interval.high
    variance = ((1.0 + WEAR) * SPREAD) ** 2
    assert calibrated.covariance[0, 0] == pytest.approx(variance, rel=0.05)


def test_a_product_is_known_in_its_physical_unit_where_its_factors_are_not(calibrated) -> None:
    value, interval = calibrated.physical["wear"]
    assert value == pytest.approx(SIZE * (1.0 + WEAR), abs=3.0 * SHARP)
    assert interval.low < SIZE * (1.0 + WEAR) < interval.high
    apart = TWO_SIDED * SIZE * (1.0 + WEAR) * SPREAD
    assert half_width(interval) < 0.1 * apart


def test_a_product_holds_its_healthy_value_where_the_fault_may_be_absent() -> None:
    template = Actuator(0.93 * SIZE * (1.0 + WEAR))  # the product is 7 % off what is healthy
    found = assessed(
        replace(KNOWN, prior=replace(KNOWN.prior, mean=np.log([template.size]))), template
    )
    assert found.intervals["wear"].low == 0.0
    low, high = found.physical["wear"][1]
    assert low <= template.size < SIZE * (1.0 + WEAR) < high


def test_what_noise_alone_leaves_open_is_sharp(calibrated) -> None:
    assert calibrated.sharp_errors["wear"] == pytest.approx(SHARP / SIZE, rel=0.15)
    slope = 20.0 * (0.5 - GAP)
    assert calibrated.sharp_errors["gap"] == pytest.approx(SHARP / slope, rel=0.15)
    error = half_width(calibrated.intervals["gap"]) / TWO_SIDED
    assert error == pytest.approx(calibrated.sharp_errors["gap"], rel=0.15)
    _, same = calibrated.physical["gap"]  # it has no other unit
    assert same == calibrated.intervals["gap"]


def test_differences_between_healthy_recordings_widen_their_fault() -> None:
    scatter = 0.04  # with more of it the fault may be absent, and the interval begins at healthy
    found = assessed(replace(KNOWN, scatter={"wear": scatter}))
    # of one more recording beside the mean of three
    variance = ((1.0 + WEAR) * SPREAD) ** 2 + scatter**2 * (1.0 + 1.0 / 3.0)
    assert half_width(found.intervals["wear"]) == pytest.approx(
        TWO_SIDED * math.sqrt(variance), rel=0.05
    )


def test_drift_since_the_calibration_widens_what_it_moves() -> None:
    found = assessed(actuator=Actuator(drift=0.1))
    variance = (1.0 + WEAR) ** 2 * (SPREAD**2 + (0.5 * math.log(1.1)) ** 2)
    assert half_width(found.intervals["wear"]) == pytest.approx(
        TWO_SIDED * math.sqrt(variance), rel=0.05
    )


def test_a_contrast_has_an_interval_of_its_own(calibrated) -> None:
    assert set(calibrated.contrasts) == {"both"}
    value, interval = calibrated.contrasts["both"]
    assert value == pytest.approx(0.5 * (WEAR + GAP), abs=5e-3)
    assert half_width(interval) == pytest.approx(0.5 * TWO_SIDED * (1.0 + WEAR) * SPREAD, rel=0.05)


def test_a_contrast_of_what_is_hardly_there_reaches_as_far_as_its_faults() -> None:
    absent = FaultSet(frozenset(), 0.99, np.zeros((100, 3)))
    there = FaultSet(frozenset({"wear"}), 0.01, np.linspace(0.0, 0.1, 101)[:, None] * np.eye(3)[0])
    sets = FaultSets(Kind().unknowns(None), (absent, there))
    values = dict.fromkeys(("wear", "gap", "slope"), 0.0)
    _, (low, high) = contrasts_of(Kind(), Actuator(), values, sets)["both"]
    assert low == 0.0
    assert high == pytest.approx(0.05, rel=0.1)


def test_a_sensor_that_is_clearly_off_is_told(calibrated) -> None:
    value, interval = calibrated.nuisances["slope"]
    assert value == pytest.approx(SLOPE, abs=5e-3)
    assert interval.low < SLOPE < interval.high
    assert "part.size" not in calibrated.nuisances  # a parameter is no sensor


def test_a_sensor_whose_interval_holds_its_usual_value_is_not_told() -> None:
    one = replace(Kind().unknowns(Actuator())[2], spread=0.1)
    for interval, told in ((Interval(-0.1, 0.1), {}), (Interval(0.2, 0.3), {"slope"})):
        found = _evident(SimpleNamespace(unknowns=[one]), np.array([0.5]), {"slope": interval}, 0)
        assert found.keys() == set(told)
        assert all(low <= value <= high for value, (low, high) in found.values())


def test_another_answer_that_explains_the_recording_as_well_is_told(calibrated) -> None:
    assert calibrated.others == ()
    found = assessed(others=((0.4, 1.0 - GAP), (0.4, 0.26)))
    assert len(found.others) == 1
    assert {round(found.values["gap"], 1), round(found.others[0]["gap"], 1)} == {0.2, 0.8}
    assert set(found.others[0]) == {"wear", "gap"}
    # both say that the fault is there, and the interval is over both
    assert found.sets.minima == pytest.approx((0.5, 0.5), abs=0.1)
    assert found.sets.probabilities["gap"] > CERTAIN
    assert found.intervals["gap"].low < 0.2 < 0.8 < found.intervals["gap"].high


def test_the_better_of_two_valleys_is_the_answer_wherever_the_search_ended() -> None:
    found = assessed(point=(0.4, 1.0 - GAP), others=((0.4, GAP),), worse=2.0)
    assert found.values["gap"] == pytest.approx(GAP, abs=2e-3)
    assert found.others == ()  # the other one is far worse


def test_a_valley_that_is_far_worse_is_not_gone_into() -> None:
    beside = assessed(others=((1.9, 0.9),))
    assert beside.others == ()
    assert beside.evaluations == assessed().evaluations
