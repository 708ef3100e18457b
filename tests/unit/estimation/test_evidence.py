"""Evidence of further channels: what counts only where intervals are formed."""

import numpy as np
import pytest

from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import laplace
from ematwin.estimation.noise import with_shown_noise
from ematwin.estimation.prior import Prior, Remainder
from ematwin.estimation.problem import Problem
from ematwin.models.unknown import Alias, Unknown
from naive.toy import OneChannel

SAMPLES = 60
RNG = np.random.default_rng(3)
BASIS = RNG.standard_normal((2, SAMPLES))
TORQUES, WATTS = BASIS
TRUE = {"constant": 1.1, "short": 0.3, "load": 0.4}


class TwoSensors(OneChannel):
    """A current that only knows constant x (1 - short), and a power that knows the constant."""

    def __init__(self, noise: float = 0.02, watts_noise: float = 0.05, evidence: bool = False):
        rng = np.random.default_rng(5)
        current, watts = self.answer(TRUE["constant"], TRUE["short"], TRUE["load"])
        super().__init__(current + noise * rng.standard_normal(SAMPLES), noise=0.02)
        self.watts = watts + watts_noise * rng.standard_normal(SAMPLES)
        self.evidence = SAMPLES if evidence else 0
        self.tells = frozenset({"constant"} if evidence else ())

    @staticmethod
    def answer(constant, short, load):
        return constant * (1.0 - short) * TORQUES + load * WATTS, constant * WATTS

    def with_evidence(self):
        other = TwoSensors(evidence=True)
        other.recording, other.watts = self.recording, self.watts
        return other

    def responses(self, candidates, count):
        return {"y": np.array([self.answer(*row)[0] for row in self._rows(candidates)])}

    @staticmethod
    def _rows(candidates):
        return zip(*(candidates[name] for name in TRUE), strict=True)

    def residuals(self, candidates, count):
        rows = [self.answer(*row) for row in self._rows(candidates)]
        found = np.array([current - self.recording.y for current, _ in rows])
        if not self.evidence:
            return found
        watts = np.array([watts - self.watts for _, watts in rows]) / 0.05
        return np.concatenate([found, watts], axis=1)


UNKNOWNS = [
    Unknown("constant", "", "", 1.0, 0.5, 2.0, role="nominal", logarithmic=True),
    Unknown("short", "", "", 0.0, 0.0, 1.0),
    Unknown("load", "", "", 0.0, -2.0, 2.0),
]
PRIOR = Prior(("constant",), np.zeros(1), np.array([[0.2**2]]))


def aliases(values):
    return [Alias("constant", {"short": -(1.0 - values["short"])})]


def point_of(problem: Problem) -> np.ndarray:
    return np.array([TRUE[name] for name in problem.names])


@pytest.mark.parametrize(("watts_noise", "low", "high"), [(0.02, 1.0, 1.0), (0.5, 0.07, 0.14)])
def test_evidence_that_is_worse_than_expected_counts_less(watts_noise, low, high) -> None:
    problem = Problem([TwoSensors(0.06, watts_noise).with_evidence()], UNKNOWNS, prior=PRIOR)
    left = problem.residuals(point_of(problem)[None])[0]
    weighed = with_shown_noise(problem, left)
    assert 0.04 < weighed.noise < 0.08  # that of the current, three times what was expected
    assert low <= weighed.trust <= high
    again = weighed.split(weighed.residuals(point_of(problem)[None])[0])
    rms = np.sqrt(np.mean(again.evidence**2)) / weighed.noise
    assert rms == pytest.approx(1.0 if high < 1.0 else 0.4, rel=0.3)
    held = weighed.holding({"load": 0.4})
    assert (held.noise, held.trust) == (weighed.noise, weighed.trust)


def test_only_evidence_tells_the_two_of_an_alias_apart() -> None:
    start = np.array([1.0, 0.0, 0.0])
    blind = laplace(Problem([TwoSensors()], UNKNOWNS, prior=PRIOR), start, Descent(aliases))
    seen = laplace(
        Problem([TwoSensors().with_evidence()], UNKNOWNS, prior=PRIOR), start, Descent(aliases)
    )
    # without: the constant where the prior has it, and the short as far off as that makes it
    assert blind.point[0] == pytest.approx(1.0)
    assert blind.point[1] == pytest.approx(1.0 - 1.1 * 0.7, abs=0.02)
    assert np.sqrt(blind.covariance[1, 1]) > 0.1
    assert seen.point == pytest.approx([1.1, 0.3, 0.4], abs=0.02)
    errors = np.sqrt(np.diag(seen.covariance)) * seen.problem.chart.widths
    assert errors[1] < 0.01
    truth = seen.problem.chart.from_values(np.array([[1.1, 0.3, 0.4]]))[0]
    away = (seen.z - truth) / np.sqrt(np.diag(seen.covariance))
    assert np.abs(away).max() < 3.0


def test_the_width_is_that_of_the_linear_problem() -> None:
    """Against the inverse of the information, formed here."""
    problem = Problem([TwoSensors().with_evidence()], UNKNOWNS, prior=PRIOR)
    peak = laplace(problem, np.array([1.0, 0.0, 0.0]), Descent(aliases))
    constant, short, _ = peak.point
    # by the logarithm of the constant, the short, the load
    current = np.array([constant * (1.0 - short) * TORQUES, -constant * TORQUES, WATTS])
    watts = np.array([constant * WATTS, 0.0 * WATTS, 0.0 * WATTS]) / 0.05 * peak.problem.trust
    information = current @ current.T / peak.problem.noise**2 + watts @ watts.T
    information[0, 0] += 1.0 / 0.2**2
    widths = peak.problem.chart.widths
    expected = np.linalg.inv(information) / np.outer(widths, widths)
    np.testing.assert_allclose(peak.covariance, expected, rtol=0.03, atol=1e-8)


@pytest.mark.parametrize("independent", [1.0, 100.0])
def test_a_discrepancy_counts_between_once_and_as_often_as_noise(independent):
    """As `docs/inference.md` says: the geometric mean of one part and as many as the noise has."""
    one = Remainder(norm=0.0, least=3.0, alike=0.5, independent=independent)
    noise = one.deviation(3.0)
    assert noise**2 == pytest.approx(9.0 / independent + 0.25)
    assert one.deviation(1.0) == noise  # less than noise is no discrepancy
    assert one.deviation(5.0) ** 2 - noise**2 == pytest.approx(16.0 / independent**0.5)
