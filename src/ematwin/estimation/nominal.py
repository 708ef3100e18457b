"""Nominal parameters of an actuator from recordings of it while it is healthy.

Robust least squares (soft L1) over all recordings together. Parameters are fitted as logarithms
around the template, whose values count as a weak prior; nuisances, such as the load, are fitted for
each recording. Where the recordings narrow a parameter by less than half, they have not determined
it: it keeps the template's value, and the rest is fitted again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ematwin.estimation.constants import DETERMINED
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison, correlation_time
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown

_EVALUATIONS = 60  # of the residuals, without those of the Jacobians
_DIFFERENCE = 1e-4  # of a coordinate
_SMALLEST = float(np.sqrt(np.finfo(float).eps))  # where a coordinate is zero
_ROUNDS = 3  # of fit and noise level in turn, where the noise level is not known
_COARSE = 1e-2  # of a coordinate: impacts make such residuals rough


@dataclass(frozen=True)
class NominalParameter:
    """One fitted parameter.

    Attributes
    ----------
    place : e.g. "screw.friction_force"
    value, template : SI units
    standard_error : SI units; of the fit to these recordings, which says nothing of other runs
    determined : whether the recordings say more of it than the template does
    """

    place: str
    value: float
    template: float
    standard_error: float
    determined: bool


def fit_nominal(
    model: Model, template: ParameterSet, comparisons: Sequence[Comparison]
) -> tuple[ParameterSet, list[NominalParameter]]:
    """The actuator that answers as the healthy one did, and the fitted parameters.

    Parameters
    ----------
    model : gives the places that are fitted (`Model.nominal`) and the nuisances
    template : actuator of this kind
    comparisons : healthy recordings, or means of several, beside the template
    """
    places = [place for place in model.nominal if template.value(place) > 0.0]
    fit = _Fit(model, template, comparisons)
    values, errors = fit.run(places)
    vague = [p for p in places if errors[p] >= DETERMINED * np.log(model.nominal[p])]
    if vague:
        values, again = fit.run([place for place in places if place not in vague])
        errors |= again
    parameters = []
    for place in model.nominal:
        start = template.value(place)
        value = values.get(place, start)
        error = errors.get(place, 0.0) * value
        parameters.append(NominalParameter(place, value, start, error, place in values))
    return template.changed(values), parameters


class _Fit:
    """Least squares over comparisons; nuisances of each are fitted with the parameters."""

    def __init__(
        self, model: Model, template: ParameterSet, comparisons: Sequence[Comparison]
    ) -> None:
        self._model, self._template, self._comparisons = model, template, comparisons
        self._own = [
            replace(one, spread=None)
            for one in model.unknowns(template)
            if one.role == "nuisance" and not one.marginal
        ]
        # the scale of a nuisance: a share of what its prior lets it be
        self._scale = np.array([
            0.5 * one.spread if one.spread is not None else 0.1 * one.width
            for one in model.unknowns(template)
            if one.role == "nuisance" and not one.marginal
        ])  # fmt: skip
        self._first = np.zeros((len(comparisons), 0))
        if self._own:
            self._first = np.stack([self._start_of(one) for one in comparisons]) / self._scale

    def _start_of(self, comparison: Comparison) -> np.ndarray:
        """Nuisances of a recording with which the common fit starts."""
        starts = self._model.starts(self._template, comparison.recording)
        problem = Problem([comparison], searched(self._model, self._template), starts=starts)
        found = LocalDescent().run(problem, budget=None, seed=1, report=lambda *_: None)
        values = problem.values(found.point)
        return np.array([values[one.name] for one in self._own])

    def run(self, places: list[str]) -> tuple[dict[str, float], dict[str, float]]:
        """Values of these parameters, and standard errors of their logarithms."""
        if not places:
            return {}, {}
        shared = [self._model.unknown(self._template, place) for place in places]
        problem = Problem(
            self._comparisons, [*shared, *self._own], own=[one.name for one in self._own]
        )
        whitened = all(one.whitened for one in self._comparisons)
        first = np.r_[np.zeros(len(places)), self._first.ravel()]
        noise = 1.0
        for _ in range(1 if whitened else _ROUNDS):
            if not whitened:
                noise = self._noise_of(problem, self._points(shared, first[None]))
                noise *= self._model.model_error
            first, information = self._fitted(problem, shared, first, noise, whitened)
        errors = np.sqrt(np.diag(np.linalg.inv(information))[: len(places)])
        values = self._points(shared, first[None])[0, : len(places)]
        return (
            dict(zip(places, values.tolist(), strict=True)),
            dict(zip(places, errors.tolist(), strict=True)),
        )

    def _fitted(
        self, problem: Problem, shared: list[Unknown], first: np.ndarray, noise: float,
        whitened: bool,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """The best coordinates, and their information."""
        from scipy.optimize import least_squares

        count = len(shared)

        def residuals(x: np.ndarray) -> np.ndarray:
            """(B, K), priors last, of coordinates (B, d)."""
            found = problem.residuals(self._points(shared, x))
            if not whitened:
                found[:, :-count] /= noise
                found[:, -count:] /= self._comparisons[0].noise  # priors come in that unit
            return found

        def jacobian(x: np.ndarray) -> np.ndarray:
            sign = np.where(x >= 0.0, 1.0, -1.0)
            steps = _DIFFERENCE * np.abs(x) * sign
            if whitened:
                steps = np.where(x + steps == x, _SMALLEST * sign, steps)
            else:
                steps = np.where(np.abs(steps) < _COARSE, _COARSE * sign, steps)
            steps = np.where(x + steps > high, -steps, steps)
            rows = np.vstack([x, x + np.diag(steps)])
            beside = residuals(rows)
            found: np.ndarray = ((beside[1:] - beside[0]) / (rows[1:] - x).diagonal()[:, None]).T
            return found

        limits = [self._template.limits(one.name)[1] for one in shared]
        upper = np.log(np.array(limits) / [one.healthy for one in shared])
        high = np.r_[upper, np.full(first.size - count, np.inf)]
        first = np.minimum(first, high - 1e-9)
        found = least_squares(
            lambda x: residuals(x[None])[0], first, jacobian, bounds=(-np.inf, high),
            loss="soft_l1", max_nfev=_EVALUATIONS,
        )  # fmt: skip
        samples = found.fun.size - count
        # neighbouring samples miss alike: what the twin misses counts as noise of the data
        inflation = max(1.0, 2.0 * found.cost / max(1, samples - found.x.size))
        of_data = found.jac[:-count]
        information = of_data.T @ of_data / inflation
        spread = np.array([one.spread for one in shared])
        information[np.arange(count), np.arange(count)] += 1.0 / spread**2
        return found.x, information

    def _points(self, shared: list[Unknown], x: np.ndarray) -> np.ndarray:
        """Values (B, d) of coordinates (B, d): logarithms over the template, scaled nuisances."""
        count = len(shared)
        start = np.array([one.healthy for one in shared])
        scale = np.tile(self._scale, len(self._comparisons))
        return np.hstack([start * np.exp(x[:, :count]), x[:, count:] * scale])

    @staticmethod
    def _noise_of(problem: Problem, point: np.ndarray) -> float:
        """The size of a residual that is noise, alike neighbours counted once."""
        sizes = []
        for n, comparison in enumerate(problem.comparisons):
            left = comparison.residuals(problem.candidates(point, n), 1)[0]
            sizes.append(float(np.mean(left**2)) * correlation_time(left - left.mean()))
        return float(np.sqrt(np.mean(sizes))) or 1.0


def searched(model: Model, actuator: ParameterSet) -> list[Unknown]:
    """Unknowns of a search: faults, with their slack, and nuisances."""
    return [
        replace(one, lower=one.lower - one.slack) if one.slack else one
        for one in model.unknowns(actuator)
        if one.role in ("fault", "nuisance") and not one.marginal
    ]
