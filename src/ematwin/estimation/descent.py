"""All unknowns of a problem down together, those with priors included, from where a search ended.

By stages of Levenberg-Marquardt: first on the smoothed misfit, unless the start lies in its basin
already; then at full bandwidth for as long as a stage gains. Unknowns held by aliases stay; where
the data have no effect at all, evidence and priors decide.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.aliases import Aliases, directions, held_pivots
from ematwin.estimation.constants import WORTH
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.noise import with_shown_noise
from ematwin.estimation.problem import Problem
from ematwin.models.chart import Chart
from ematwin.numerics.linear_algebra import bounded_squares

STEP = 5e-3  # along directions that data do not see, share of a range
_STAGES, _LEAST_STAGES, _ITERATIONS = 8, 1, 5
SAME = 0.97  # ratio of noises with which priors count alike


class TooFarError(Exception):
    """A smooth descent ended too far from the recordings; caught by who asked for a limit."""


@dataclass(frozen=True)
class Descent:
    """Settings of a descent: unknowns held, start, and end.

    Attributes
    ----------
    aliases : values by name -> directions in which the answer does not change
    held : unknowns that stay where they are
    least_noise : float, the noise is taken to be no less, in the unit of `Problem.noise`
    settled : float, relative misfit at which a start lies in its basin already; infinite where it
        lies next to its minimum, to which the slopes of its width lead
    iterations : int, at most, of the first stage from such a start
    within : float, relative misfit of the smoothed data beyond which it is not worth going on
    least : float, squared standard deviations: an iteration that gains less ends a stage
    """

    aliases: Aliases | None = None
    held: Collection[str] = ()
    least_noise: float = 0.0
    settled: float = 0.0
    iterations: int = _ITERATIONS
    within: float = np.inf
    least: float = 0.0

    def afresh(self, settled: float = 0.0, least_noise: float | None = None) -> "Descent":
        """One without limits that holds the same.

        ``settled`` is infinite where it begins next to its minimum; ``least_noise`` stays as it
        is where none is given.
        """
        noise = self.least_noise if least_noise is None else least_noise
        return Descent(self.aliases, self.held, noise, settled=settled)

    def end(self, problem: Problem, start: np.ndarray) -> tuple[np.ndarray, int]:
        """The best point (d,) next to a start (d,), and the simulations that it took.

        The start itself where it lies next to its minimum.

        Raises
        ------
        TooFarError
            If the smooth stage ends beyond ``within``.
        """
        if np.isinf(self.settled):
            return start, 0
        known = [
            one
            for one in directions(problem, start, self.aliases)
            if not {problem.names[n] for n in np.flatnonzero(one.same)} & set(self.held)
        ]
        still = held_pivots(problem, known) | set(self.held)
        values = dict(zip(problem.names, start.tolist(), strict=True))
        fixed = {name: value for name, value in values.items() if name in still}
        small = problem.holding(fixed) if fixed else problem
        own = [problem.names.index(name) for name in small.names]
        z, spent = self._stages(small, start[own])
        values = small.values(small.chart.to_values(z)[0])
        return np.array([values[name] for name in problem.names]), spent

    def _stages(self, small: Problem, start: np.ndarray) -> tuple[np.ndarray, int]:
        """The best ``z`` (1, d), and simulations."""
        chart, spent = small.chart, 1
        # each stage looks with long differences again: rough stretches stop a single descent
        first = z = chart.project(chart.from_values(start[None]))
        before = small.residuals(chart.to_values(z))[0]
        near = small.relative_misfit(small.data_cost(before)) < self.settled
        # wide minima first
        wide, last, here = small.smoothed(), small, before
        for stage in range(_LEAST_STAGES if near else 0, _STAGES):
            seen = wide if stage == 0 else small
            if seen is not last:
                last, here = seen, seen.residuals(chart.to_values(z))[0]
                spent += 1
            weighed = with_shown_noise(seen, here, self.least_noise)

            def residuals(points: np.ndarray, weighed: Problem = weighed) -> np.ndarray:
                nonlocal spent
                spent += len(points)
                return weighed.residuals(chart.to_values(points))

            least = self.least * weighed.noise**2
            known = weighed.weighed_anew(here, seen)[None]
            descent = LevenbergMarquardt.start(z, residuals, least=least, known=known)
            first_cost = float(descent.costs[0])
            first_data = weighed.data_cost(here)
            for _ in range(self.iterations if near and stage == _LEAST_STAGES else _ITERATIONS):
                descent.iterate(residuals, chart.lower, chart.upper, chart.project)
            end = descent.best(1)
            z, here = chart.project(end.points), seen.weighed_anew(end.residuals[0], weighed)
            last_data = weighed.data_cost(here)
            if stage == 0 and weighed.relative_misfit(last_data) > self.within:
                raise TooFarError
            # where data fit better the noise is less, and priors count less
            gained = max(first_cost - float(end.costs[0]), first_data - last_data)
            # no rough stretches stopped it, and no other noise would lead on
            shown = with_shown_noise(seen, here, self.least_noise).noise
            ended = wide is small and end.finished.all() and shown > SAME * weighed.noise
            if ended or (stage >= _LEAST_STAGES and gained < WORTH * weighed.noise**2):
                break
        # the smooth misfit may have led astray
        if _cost_of(weighed, chart.to_values(first), before) < _cost_of(
            weighed, chart.to_values(z), here
        ):
            z = first
        return z, spent


def bounded_step(
    jacobian: np.ndarray, here: np.ndarray, z: np.ndarray, chart: Chart, still: Collection[str]
) -> np.ndarray:
    """The step (d,) to the least squares of the linearised residuals within the bounds.

    ``jacobian`` (d, K) of residuals that are ``here`` (K,) at coordinates (d,); unknowns in
    ``still`` stay, and the directions of magnitudes among them.
    """
    free = [
        n
        for n, one in enumerate(chart.unknowns)
        if one.name not in still and one.direction_of not in still
    ]
    low = np.minimum(chart.lower - z, 0.0)[free]
    high = np.maximum(chart.upper - z, 0.0)[free]
    step = np.zeros(len(z))
    step[free] = bounded_squares(jacobian[free].T, -here, low, high)
    return np.asarray(chart.project((z + step)[None])[0] - z)


def _cost_of(weighed: Problem, point: np.ndarray, residuals: np.ndarray) -> float:
    """The cost at a point (1, d) whose residuals (K,) are known, though not by this noise."""
    if weighed.has_evidence:
        return float(weighed.costs(point)[0])
    return weighed.data_cost(residuals) + float((weighed.prior_distances(point) ** 2).sum())
