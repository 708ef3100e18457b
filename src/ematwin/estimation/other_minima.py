"""Other local minima along an unknown that its prior alone holds, such as an unrecorded load.

A descent of everything together begins at the means of the priors. Where an unknown makes the
twin stick at other places of the motion, as an unrecorded load does, that start may lie next to
another minimum than the true one, and other parameters take up the effect of stiction. So the
unknown is held at values all over its prior while everything else descends from the same place, all
starts as one batch of the lanes; then once more near the best of them; then it is free. A start
that is soon far behind is given up.

``anew`` is for where that did not help: parameters then begin at the means of their priors, for
their values belong to the wrong minimum, and none is held.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ematwin.estimation.aliases import held_by
from ematwin.estimation.constants import SEARCHED
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import Laplace, laplace
from ematwin.estimation.levenberg_marquardt import NOTHING, LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.models.unknown import Unknown

_FAR = 4.0  # times the least cost: a start so far behind does not win, 1.7 times did


def other_minima(peak: Laplace, descent: Descent, anew: bool = False) -> list[Laplace]:
    """Other local minima of the same problem, one for each unknown that has several.

    Parameters
    ----------
    peak : from which descents set out
    descent : that went there; unknowns that it holds stay, and each end searches its basin anew
    anew : bool, parameters start at the means of their priors, and all are free
    """
    problem, found, held = peak.problem, [], set(descent.held)
    loose = {one.name for one in problem.unknowns if anew and one.role == "nominal"} - held
    start = np.array([
        one.healthy if one.name in loose else value
        for one, value in zip(problem.unknowns, peak.point, strict=True)
    ])  # fmt: skip
    for one in problem.unknowns:
        if one.spread is None or one.valleys == 1 or one.name in held:
            continue
        point, middle, reach, spent = start, one.healthy, SEARCHED * one.spread, 0
        for wide in (True, False):
            still = (held_by(problem, point, descent.aliases) | held) - loose
            point, more = _across(problem, point, one, middle, reach, still, wide)
            middle = float(point[problem.names.index(one.name)])
            reach, spent = 2.0 * reach / (one.valleys - 1), spent + more
        end = laplace(problem, point, descent.afresh())
        found.append(replace(end, evaluations=end.evaluations + spent))
    return found


def _across(
    problem: Problem,
    start: np.ndarray,
    along: Unknown,
    middle: float,
    reach: float,
    still: Collection[str],
    wide: bool,
) -> tuple[np.ndarray, int]:
    """The lowest of descents from ``start`` (d,) with an unknown held all over a range.

    And the simulations that they took. Unknowns in ``still`` stay; ``wide`` ones descend on the
    smoothed misfit first.
    """
    names = list(problem.names)
    known = dict(zip(names, start.tolist(), strict=True))
    small = problem.holding({name: known[name] for name in still}) if still else problem
    chart, place = small.chart, small.names.index(along.name)
    points = np.tile([known[name] for name in small.names], (along.valleys, 1))
    points[:, place] = np.clip(
        middle + np.linspace(-reach, reach, along.valleys), along.lower, along.upper
    )
    z, spent = chart.project(chart.from_values(points)), 0
    least = NOTHING * small.noise**2
    low, high = (np.tile(end, (along.valleys, 1)) for end in (chart.lower, chart.upper))
    low[:, place] = high[:, place] = z[:, place]
    stages = [(small.smoothed(), 5)] if wide else []  # problem and iterations
    for seen, iterations in (*stages, (small.coarse(), 8)):

        def residuals(at: np.ndarray, seen: Problem = seen) -> np.ndarray:
            nonlocal spent
            spent += len(at)
            return seen.residuals(chart.to_values(at))

        descent = LevenbergMarquardt.start(z, residuals, least=least)
        for _ in range(iterations):
            descent.iterate(residuals, low, high, chart.project)
            costs = descent.costs
            near = costs <= _FAR * costs.min()
            descent.finished |= ~near
        z, low, high = (x[near] for x in (descent.points, low, high))
    best = chart.project(descent.best(1).points)
    values = small.values(chart.to_values(best)[0])
    return np.array([values[name] for name in names]), spent
