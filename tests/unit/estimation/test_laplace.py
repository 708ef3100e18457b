"""Laplace's approximation, where it is exact: linear answers and normal priors."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import Laplace, laplace
from ematwin.estimation.prior import Prior
from ematwin.estimation.problem import Problem
from ematwin.models.unknown import Alias, Unknown
from ematwin.numerics.linear_algebra import inverse
from naive.toy import OneChannel

NOISE = 0.4
ROUGH = 1e-4  # of the answer, where it is not smooth


class Linear(OneChannel):
    """y = sum of a basis times x; of a logarithmic unknown times its logarithm."""

    def __init__(self, unknowns, basis, y, rough=0.0):
        super().__init__(y, NOISE)
        self.unknowns, self.basis, self.y, self.rough = unknowns, basis, y, rough

    def responses(self, candidates, count):
        x = np.column_stack([
            np.log(candidates[one.name]) if one.logarithmic
            else np.broadcast_to(candidates[one.name], count)
            for one in self.unknowns
        ])  # fmt: skip
        ripple = self.rough * np.sin(1e5 * x.sum(axis=1))[:, None] * np.arange(self.y.size)
        return {"y": x @ self.basis + ripple}


def fault(name, **more):
    return Unknown(name, "", "", 0.0, -4.0, 6.0, **more)


def parameter(name):
    return Unknown(name, "kg", "", 1.0, 0.05, 20.0, role="nominal", logarithmic=True)


def basis_of(rows, seed=4):
    return np.random.default_rng(seed).standard_normal((rows, 60))


def coordinates(problem, x):
    """Values of the bases: logarithms where an unknown is logarithmic."""
    return np.array([
        np.log(v) if one.logarithmic else v for one, v in zip(problem.unknowns, x, strict=True)
    ])  # fmt: skip


def in_values(peak: Laplace, covariance: np.ndarray) -> np.ndarray:
    widths = peak.problem.chart.widths
    return covariance * np.outer(widths, widths)


def mean_of(peak: Laplace) -> np.ndarray:
    chart = peak.problem.chart
    return coordinates(peak.problem, chart.to_values(peak.mean[None])[0])


def regression(basis, y, prior, names, noise):
    """Posterior mean and covariance of Bayesian linear regression, by the textbook's formula."""
    precision, pull = np.zeros((len(names),) * 2), np.zeros(len(names))
    at = [names.index(name) for name in prior.names]
    precision[np.ix_(at, at)] = np.linalg.inv(prior.covariance)
    pull[at] = np.linalg.solve(prior.covariance, prior.mean)
    covariance = np.linalg.inv(basis @ basis.T / noise**2 + precision)
    return covariance @ (basis @ y / noise**2 + pull), covariance


@pytest.fixture(scope="module")
def regressed():
    """Three unknowns, one of them logarithmic, of which two have a correlated prior."""
    unknowns = [fault("a"), parameter("m"), fault("b")]
    prior = Prior(("m", "b"), np.array([0.3, -0.2]), np.array([[0.04, 0.02], [0.02, 0.09]]))
    basis = 0.3 * basis_of(3)
    rng = np.random.default_rng(8)
    y = np.array([0.7, 0.1, 0.4]) @ basis + 0.3 * NOISE * rng.standard_normal(60)
    problem = Problem([Linear(unknowns, basis, y)], unknowns, prior=prior)
    # more than is left over: then the noise is what it is said to be
    peak = laplace(problem, problem.start, Descent(least_noise=NOISE))
    return problem, basis, y, prior, peak


def test_a_linear_answer_has_the_posterior_of_bayesian_regression(regressed) -> None:
    problem, basis, y, prior, peak = regressed
    mean, covariance = regression(basis, y, prior, problem.names, NOISE)
    assert peak.problem.noise == NOISE
    assert np.allclose(mean_of(peak), mean, atol=1e-7)
    assert np.allclose(in_values(peak, peak.covariance), covariance, rtol=1e-6)
    # the descent itself ends within a hundredth of a standard error
    away = coordinates(problem, peak.point) - mean
    assert (np.abs(away) < 0.01 * np.sqrt(np.diag(covariance))).all()


def test_the_noise_is_what_is_left_for_each_independent_residual(regressed) -> None:
    problem, *_ = regressed
    peak = laplace(problem, problem.start)
    left = problem.split(problem.residuals(peak.point[None])[0]).data
    assert peak.cost == pytest.approx(left @ left, rel=1e-9)
    # but for what the last steps, of less than 3 % of the noise, have changed
    assert peak.problem.noise == pytest.approx(np.sqrt(peak.cost / 60), rel=0.03)


@pytest.mark.parametrize("settled", [0.0, np.inf])
def test_a_descent_goes_on_until_noise_and_prior_agree(settled) -> None:
    """What a prior that data contradict leaves over looks like noise, and the prior counts more."""
    unknowns = [parameter("m")]
    prior = Prior(("m",), np.array([0.0]), np.array([[0.03**2]]))
    basis = 30.0 * basis_of(1)
    y = 0.3 * basis[0] + NOISE * np.random.default_rng(8).standard_normal(60)
    problem = Problem([Linear(unknowns, basis, y)], unknowns, prior=prior)
    peak = laplace(problem, problem.start, Descent(settled=settled))
    mean, covariance = regression(basis, y, prior, ("m",), peak.problem.noise)
    assert np.log(peak.point[0]) == pytest.approx(mean[0], abs=np.sqrt(covariance[0, 0]))
    assert mean[0] == pytest.approx(0.3, abs=0.01)


class Dented(Linear):
    """With ripple as large as one noise deviation, which changes within a hundredth of a width."""

    def responses(self, candidates, count):
        rng = np.random.default_rng(5)
        x = np.column_stack([candidates[one.name] for one in self.unknowns])
        phases = x @ rng.normal(0.0, 1e3, (len(self.unknowns), 40))
        ripple = np.sin(phases) @ rng.normal(0.0, NOISE / np.sqrt(20.0 * 60.0), (40, 60))
        return {"y": super().responses(candidates, count)["y"] + ripple}


def test_dents_of_a_rough_misfit_do_not_hold_the_peak() -> None:
    unknowns = [fault(name) for name in "abcdefgh"]
    basis = basis_of(len(unknowns))
    problem = Problem([Dented(unknowns, basis, np.full(8, 0.5) @ basis)], unknowns)
    errors = NOISE * np.sqrt(np.diag(np.linalg.inv(basis @ basis.T)))
    rng = np.random.default_rng(6)
    for _ in range(5):
        start = 0.5 + 3.0 * errors * rng.standard_normal(len(unknowns))
        peak = laplace(problem, start, Descent(settled=np.inf, least_noise=NOISE))
        # from one dent to the next a descent errs by 0.5 to 1.1
        assert np.sqrt(np.mean(((peak.point - 0.5) / errors) ** 2)) < 0.2
        stated = np.sqrt(np.diag(in_values(peak, peak.covariance)))
        assert 0.7 < np.median(stated / errors) < 1.1


def test_a_held_unknown_stays_and_still_widens_the_others(regressed) -> None:
    problem, basis, y, prior, free = regressed
    start = np.array([0.0, 1.6, 0.0])
    peak = laplace(problem, start, Descent(held=["m"], least_noise=NOISE))
    assert peak.point[1] == pytest.approx(1.6)
    assert np.allclose(peak.covariance, free.covariance)
    # the middle of the distribution is where it would go
    mean, _ = regression(basis, y, prior, problem.names, NOISE)
    assert np.allclose(mean_of(peak), mean, atol=1e-7)


def aliased(rough: float, prior: Prior, **more):
    """Two faults and a pivot that does what 0.8 of the first and -0.3 of the second do."""
    unknowns = [fault("a"), fault("b"), parameter("m")]
    two = 0.3 * basis_of(2)
    same = {"a": 0.8, "b": -0.3}
    basis = np.vstack([two, 0.8 * two[0] - 0.3 * two[1]])
    y = np.array([0.5, 0.2]) @ two
    problem = Problem([Linear(unknowns, basis, y, rough)], unknowns, prior=prior)

    def aliases(values):
        assert set(values) == {"a", "b", "m"}
        return [Alias("m", same, **more)]

    return problem, two, y, aliases


M_PRIOR = Prior(("m",), np.array([0.1]), np.array([[0.05]]))


@pytest.mark.parametrize("rough", [0.0, ROUGH])
def test_a_pivot_has_the_variance_of_its_prior_and_its_faults_get_it_added(rough: float) -> None:
    problem, two, _, aliases = aliased(rough, M_PRIOR)
    start = np.array([0.0, 0.0, np.exp(0.1)])
    peak = laplace(problem, start, Descent(aliases, least_noise=NOISE))
    found = in_values(peak, peak.covariance)
    known = NOISE**2 * np.linalg.inv(two @ two.T)  # of the faults, were the pivot known
    added = 0.05 * np.outer([0.8, -0.3], [0.8, -0.3])
    # differences see a rough answer as well; that leaves some per cent of the faults alone
    close = {"rtol": 1e-5} if rough == 0.0 else {"rtol": 0.05, "atol": 0.05 * known.max()}
    assert found[2, 2] == pytest.approx(0.05, rel=1e-6)
    assert np.allclose(found[:2, :2], known + added, **close)
    assert np.allclose(found[2, :2], [-0.05 * 0.8, 0.05 * 0.3], **close)
    assert np.allclose(
        coordinates(problem, peak.point)[:2] + 0.1 * np.array([0.8, -0.3]), [0.5, 0.2], atol=0.01
    )


def test_free_pivots_that_share_unknowns_go_where_the_priors_have_them_together() -> None:
    """One after the other they would take hundreds of rounds: both directions are nearly one."""
    unknowns = [fault("a"), fault("b"), parameter("m"), parameter("n")]
    two = 0.3 * basis_of(2)
    same = [{"a": 0.8, "b": -0.3}, {"a": 0.7, "b": -0.35}]
    basis = np.vstack([two, *(one["a"] * two[0] + one["b"] * two[1] for one in same)])
    spreads = np.diag([0.3, 0.1, 0.2, 0.5]) ** 2
    prior = Prior(("a", "b", "m", "n"), np.array([0.9, 0.2, 0.1, -0.3]), spreads)
    y = basis.T @ [0.4, 0.3, 0.1, 0.2] + NOISE * np.random.default_rng(5).standard_normal(60)
    problem = Problem([Linear(unknowns, basis, y)], unknowns, prior=prior)
    aliases = [Alias(name, one, held=False) for name, one in zip("mn", same, strict=True)]
    mean, covariance = regression(basis, y, prior, problem.names, NOISE)
    # where data have it, but for both directions
    off = [0.4, -0.5]
    shared = [-sum(f * one[name] for f, one in zip(off, same, strict=True)) for name in "ab"]
    start = mean + np.array([*shared, *off])
    start[2:] = np.exp(start[2:])
    peak = laplace(
        problem,
        start,
        Descent(lambda values: aliases, least_noise=NOISE, settled=np.inf, iterations=0),
    )
    away = coordinates(problem, peak.point) - mean
    assert (np.abs(away) < 1e-3 * np.sqrt(np.diag(covariance))).all()


def test_a_bound_lets_data_tell_a_pivot() -> None:
    """Turns are missing, never added: what looks like added ones is the pivot's."""
    a = Unknown("a", "", "", 0.0, 0.0, 6.0)
    unknowns = [a, fault("b"), parameter("m")]
    two = 0.3 * basis_of(2)
    two[1] += 0.8 * two[0]  # which b would make up for
    basis = np.vstack([two, -0.8 * two[0]])
    prior = Prior(("m",), np.array([0.1]), np.array([[0.5]]))
    problem = Problem([Linear(unknowns, basis, 1.5 * basis[2])], unknowns, prior=prior)
    alias = Alias("m", {"a": -0.8})
    start = np.array([0.0, 0.0, np.exp(0.1)])
    peak = laplace(problem, start, Descent(lambda values: [alias], least_noise=NOISE))
    weight = NOISE / np.sqrt(0.5)
    rows = np.vstack([basis.T, [0.0, 0.0, weight]])
    target = np.append(1.5 * basis[2], 0.1 * weight)
    expected = lsq_linear(rows, target, ([0.0, -4.0, -np.inf], [6.0, 6.0, np.inf])).x
    assert expected[0] == pytest.approx(0.0, abs=1e-6)
    assert expected[2] > 1.0
    assert np.allclose(coordinates(problem, peak.point), expected, atol=1e-3)


def test_a_direction_without_information_is_wide_and_the_others_are_exact() -> None:
    found = inverse(np.diag([4.0, 0.0]))
    assert found[0, 0] == pytest.approx(0.25)
    assert found[1, 1] > 1e6
    known = np.array([[3.0, 1.0], [1.0, 2.0]])
    assert np.allclose(inverse(known), np.linalg.inv(known))


def test_a_sound_matrix_on_which_divide_and_conquer_fails_is_inverted(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    def fails(matrix: np.ndarray) -> None:
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    matrix = np.diag([4.0, 1.0]) + 0.5
    expected = np.linalg.inv(matrix)
    monkeypatch.setattr(np.linalg, "eigh", fails)
    assert inverse(matrix) == pytest.approx(expected)


class Curved(Linear):
    """y = the sum of two unknowns, cubed as well, and a little of their difference."""

    def responses(self, candidates, count):
        a, b = (np.broadcast_to(candidates[one.name], count) for one in self.unknowns)
        both, apart = a + b, a - b
        return {"y": np.column_stack([both, 0.01 * apart, both**3]) @ self.basis}


@pytest.mark.parametrize("is_known", [False, True])
def test_a_weak_direction_is_differenced_along_itself(is_known) -> None:
    """Over steps of each unknown the strong direction bends by more than the weak one changes.

    One lies at its bound, from which both go on together.
    """
    wide = Unknown("b", "", "", 0.0, -10.0, 10.0)  # of which the steps are longer
    unknowns, basis = [fault("a"), wide], basis_of(3)
    y = NOISE * np.random.default_rng(5).standard_normal(basis.shape[1])
    problem = Problem([Curved(unknowns, basis, y)], unknowns)
    peak = laplace(problem, np.zeros(2), Descent(settled=np.inf))
    if is_known:
        information = peak.information
        peak = laplace(problem, np.zeros(2), Descent(settled=np.inf), information=information)
    apart = in_values(peak, peak.covariance) @ [1.0, -1.0] @ [1.0, -1.0]
    slopes = np.linalg.qr(basis[:2].T)[1][1, 1]  # of what the strong direction does not explain
    assert apart == pytest.approx((peak.problem.noise / (0.01 * slopes)) ** 2, rel=0.1)
