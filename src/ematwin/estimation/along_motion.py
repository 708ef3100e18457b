"""Estimates of faults and parameters from the equations along a recorded motion.

A closed loop makes the misfit curved and rough: behind sampled loops, which the fast model lacks,
corrections by the reference lead from afar to other local minima. Along the recorded motion
(`Model.equations`) nothing is fed back. The residuals of the equations are nearly linear in
faults and parameters and have one minimum, and there they give a normal distribution

    exp(-|r + J (z - z_0)|^2/2),   r in standard deviations,

in the coordinates z of the problem's chart (`Information`). It counts beside the priors while the
closed loop is fitted, as the equations of healthy recordings do in a calibration
(`ematwin.estimation.forms`).
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.estimation.constants import DECIDES
from ematwin.estimation.equation_fit import with_secant
from ematwin.estimation.first_sample import found_first_sample
from ematwin.estimation.levenberg_marquardt import NOTHING
from ematwin.estimation.prior import Information
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.comparison import correlation_time
from ematwin.models.optional import FIRST_SAMPLE, Equation
from ematwin.models.parameter_set import ParameterSet
from ematwin.numerics.linear_algebra import bounded_squares
from ematwin.numerics.side_by_side import side_by_side

_STEP = 1e-3  # of a coordinate: the equations are smooth


def informed(
    model: Model, actuator: ParameterSet, problem: Problem, start: np.ndarray
) -> tuple[Problem, np.ndarray] | None:
    """A problem with the evidence of the equations along the motion, and their estimate (d,).

    Parameters
    ----------
    problem : of one recording, with everything free
    start : (d,) array, values from which to descend

    None where only the fast model is needed, or where the recording has no equations: it lacks
    positions.
    """
    if not problem.lacks_forms:
        return None
    recording, chart = problem.comparisons[0].recording, problem.chart
    z = chart.project(chart.from_values(start[None]))
    values = problem.values(chart.to_values(z)[0])
    every = [one for one in model.equations(recording, actuator, values) if one.size > 0.0]
    if not every:
        return None
    rests = {one.rests for one in every}
    if first := [one for one in every if one.name in rests]:
        z, _ = _Fit(actuator, problem, first, z).run(z)
        values = problem.values(chart.to_values(z)[0])
        every = [one if one.at is None else one.at(values) for one in every]
    fit = _Fit(actuator, problem, [one for one in every if one.size > 0.0], z)
    z, known = fit.run(z)
    if not recording.first_sample and fit.finds_first_sample(z):
        z, known = fit.run(z)
        problem = problem.sampled_first(fit.first_sample)
    return problem.informed(known), chart.to_values(z)[0]


class _Fit:
    """Some equations with their priors.

    Attributes
    ----------
    first_sample : s, first sample of the loops; 0 if unknown
    """

    def __init__(
        self, actuator: ParameterSet, problem: Problem, equations: Sequence[Equation], z: np.ndarray
    ) -> None:
        self._actuator, self._problem, self._equations = actuator, problem, equations
        self.first_sample = problem.comparisons[0].recording.first_sample
        self._matters = [_matters(one, actuator, problem) for one in equations]
        values = problem.values(problem.chart.to_values(z)[0])
        left = [
            self._left(one, {name: values[name] for name in names})
            for one, names in zip(equations, self._matters, strict=True)
        ]
        self._counts = [each.size for each in left]
        # what noise and the equations' own errors leave
        self._least = [one.least(actuator) * one.size for one in equations]
        self._alike = [one.alike(actuator) * one.size for one in equations]
        self._scales = [self._scale(n, each) for n, each in enumerate(left)]
        matters = {name for some in self._matters for name in some}
        self._free = np.array([n for n, name in enumerate(problem.names) if name in matters])

    def run(self, z: np.ndarray) -> tuple[np.ndarray, Information]:
        """Coordinates (1, d) of least squares next to others, by Gauss-Newton steps within bounds.

        And the evidence of the equations there, by slopes that are fresh.
        """
        chart, free = self._problem.chart, self._free
        here = self.residuals(z)[0]
        slopes, fresh = self._slopes(z, here), True
        for _ in range(20):  # at most: mostly four, as the equations are nearly linear
            low, high = chart.lower - z[0], chart.upper - z[0]
            step = np.zeros(z.shape[1])
            step[free] = bounded_squares(slopes.T, -here, low[free], high[free])
            tried = chart.project(z + np.outer((1.0, 0.3), step))  # shares of a step
            left = self.residuals(tried)
            costs = np.einsum("bk,bk->b", left, left)
            best = int(np.argmin(costs))
            gained = float(here @ here) - costs[best]
            moved = (tried[best] - z[0])[free]
            change = left[best] - here
            if gained > 0.0:
                z, here = tried[best : best + 1], left[best]
            if gained > NOTHING:
                slopes, fresh = with_secant(slopes, moved, change), False
            elif fresh:  # slopes of so short a step would be those of ripple
                break
            else:
                slopes, fresh = self._slopes(z, here), True
        self._last = here, slopes
        weights = self._weights(here)
        here = weights * here[: weights.size]
        rotation, root = np.linalg.qr((weights * slopes[:, : weights.size]).T)
        every = np.zeros((free.size + 1, z.shape[1]))
        every[:-1, free] = root
        moved = rotation.T @ here
        rest = math.sqrt(max(0.0, float(here @ here - moved @ moved)))
        return z, Information(chart, z[0], every, np.append(moved, rest))

    def finds_first_sample(self, z: np.ndarray) -> bool:
        """Find when loops sampled first, near coordinates (1, d) at which `run` ended.

        Whether that explains more than another instant may by chance.
        """
        values = self._problem.values(self._problem.chart.to_values(z)[0])
        actuator = self._actuator.changed({name: x for name, x in values.items() if "." in name})
        here, slopes = self._last
        basis = np.linalg.qr(slopes.T)[0]

        def cost(instant: float) -> float:
            left = here.copy()
            for n, one in enumerate(self._equations):
                if one.first_samples(actuator):
                    first = sum(self._counts[:n])
                    part = slice(first, first + self._counts[n])
                    known = {name: values[name] for name in self._matters[n]}
                    left[part] = self._scales[n] * self._left(one, known, instant)
            along = left @ basis
            return float(left @ left - along @ along)

        for one in self._equations:
            if instants := one.first_samples(actuator):
                found = found_first_sample(cost, instants)
                if cost(found) < cost(self.first_sample) - DECIDES:
                    self.first_sample = found
                    return True
        return False

    def _weights(self, here: np.ndarray) -> np.ndarray:
        """Factors (K,) on residuals of the equations, by their size where that is more."""
        found, first = [], 0
        for n, (count, scale) in enumerate(zip(self._counts, self._scales, strict=True)):
            left = here[first : first + count] / scale
            new = self._scale(n, left, float(np.linalg.norm(left)))
            found.append(np.full(count, new / scale))
            first += count
        return np.concatenate(found)

    def _slopes(self, z: np.ndarray, here: np.ndarray) -> np.ndarray:
        """(f, K), of residuals (K,) at coordinates (1, d), by those that matter."""
        steps = np.where(z[0] + _STEP <= self._problem.chart.upper, _STEP, -_STEP)[self._free]
        beside = np.tile(z, (self._free.size, 1))
        beside[np.arange(self._free.size), self._free] += steps
        return np.asarray((self.residuals(beside) - here) / steps[:, None])

    def _scale(self, n: int, left: np.ndarray, noise: float = 0.0) -> float:
        """One over the standard deviation of residuals of the nth equation; independent ones count.

        ``noise`` is the norm of the noise, where it is more than an equation leaves at least.
        """
        independent = left.size / correlation_time(left)
        least = max(self._least[n], noise)
        return 1.0 / math.sqrt(least**2 / independent + self._alike[n] ** 2)

    def _left(
        self, equation: Equation, values: Mapping[str, float], instant: float | None = None
    ) -> np.ndarray:
        places = {name: value for name, value in values.items() if "." in name}
        beside = {name: value for name, value in values.items() if "." not in name}
        beside[FIRST_SAMPLE] = self.first_sample if instant is None else instant
        return equation.left(self._actuator.changed(places), beside)

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """(B, K), in standard deviations, at coordinates (B, d); the priors' come last."""
        points = self._problem.chart.to_values(z)
        priors = self._problem.prior_distances(points) / self._problem.noise
        return np.hstack([self._of_equations(points), priors])

    def _of_equations(self, points: np.ndarray) -> np.ndarray:
        """(B, K) of the equations at points (B, d); infinite where a loop is unstable."""
        asked: dict[tuple[int, tuple[float, ...]], Mapping[str, float]] = {}
        rows = []
        for point in points:  # most columns of a Jacobian leave most equations as they are
            values = self._problem.values(point)
            each = [{name: values[name] for name in names} for names in self._matters]
            rows.append([(n, tuple(one.values())) for n, one in enumerate(each)])
            asked |= dict(zip(rows[-1], each, strict=True))

        def answered(key: tuple[int, tuple[float, ...]]) -> np.ndarray | None:
            try:
                return self._scales[key[0]] * self._left(self._equations[key[0]], asked[key])
            except EmatwinError:  # a loop that is unstable
                return None

        found = dict(zip(asked, side_by_side(answered, asked), strict=True))
        known = {
            key: np.full(self._counts[key[0]], np.inf) if left is None else left
            for key, left in found.items()
        }
        return np.array([np.concatenate([known[key] for key in row]) for row in rows])


def _matters(equation: Equation, actuator: ParameterSet, problem: Problem) -> list[str]:
    """Names of the free unknowns on which an equation depends."""
    stated = (place for form in equation.forms if form.is_stated(actuator) for place in form.fitted)
    mine = {*equation.fitted, *stated, *equation.unknowns}
    return [name for name in problem.names if name in mine]
