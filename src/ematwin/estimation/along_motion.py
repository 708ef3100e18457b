"""Estimates of faults and parameters from the equations along a recorded motion.

A closed loop makes the misfit curved and rough: behind sampled loops, which the fast model lacks,
corrections by the reference lead from afar to other local minima. Along the recorded motion
(`Model.equations`) nothing is fed back. The residuals of the equations are nearly linear in
faults and parameters and have one minimum, and there they give a normal distribution

    exp(-|r + J (z - z_0)|^2/2),   r in standard deviations,

in the coordinates z of the problem's chart (`Information`), which counts beside the priors. Where
the equations show every fault it takes the place of the closed loop.
"""

import math
from collections.abc import Collection, Sequence
from functools import partial
from typing import Literal

import numpy as np

from ematwin.estimation.followed_motion import followed
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.motion_fit import Along, MotionFit, nearer, values_at
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Search, named
from ematwin.models.base import Model
from ematwin.models.optional import Values
from ematwin.models.parameter_set import ParameterSet

NO_SEARCH = "equations along the motion"
Shown = Literal["", "recorded", "followed"]  # the latter as currents drive it


def usual_search(model: Model, shown: Shown) -> Search:
    """The default search of the kind; none where equations along a recorded motion show all faults.

    They have one minimum, and the healthy point is what remains of a search. A motion that was not
    recorded follows from currents near the faults that a search finds.
    """
    if shown == "recorded":
        return LocalDescent(iterations=0, name=NO_SEARCH)
    return named(model.default_search)


def shown_along(model: Model, actuator: ParameterSet, problem: Problem) -> Shown:
    """Along which motion equations show every fault, so that no closed loop is needed; or ""."""
    if not problem.lacks_forms:
        return ""
    every = _along(model, actuator, problem, [{}] * len(problem.comparisons))
    if not _show_all(model, actuator, problem, every):
        return ""
    return "followed" if _follows(every) else "recorded"


def _along(
    model: Model, actuator: ParameterSet, problem: Problem, values: Sequence[Values]
) -> list[Along]:
    """The equations of each recording at values of its faults, load and sensors."""
    return [
        Along(n, one)
        for n, compared in enumerate(problem.comparisons)
        for one in model.equations(compared.recording, actuator, values[n])
        if one.size > 0.0
    ]


def _show_all(
    model: Model, actuator: ParameterSet, problem: Problem, every: Sequence[Along]
) -> bool:
    """Whether equations show every fault in each recording."""
    faults = {one.name for one in model.faults(actuator)}
    return all(
        faults <= {name for one in every if one.recording == n for name in one.equation.unknowns}
        for n in range(len(problem.comparisons))
    )


def _begun(problem: Problem, z: np.ndarray, every: Sequence[Along]) -> np.ndarray:
    """Coordinates (1, d) with the values from which equations ask to set out."""
    point, chart = problem.chart.to_values(z), problem.chart
    for along in every:
        places = problem.places(along.recording)
        for name, value in along.equation.begins().items():
            if name in places:
                point[0, places[name]] = value
    return chart.project(chart.from_values(point))


def _follows(every: Sequence[Along]) -> bool:
    """Whether a motion was not recorded."""
    return any(along.equation.noise is not None for along in every)


def informed(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    start: np.ndarray,
    most: float = math.inf,
    like: Problem | None = None,
) -> tuple[Problem, np.ndarray] | None:
    """A problem with the evidence of the equations along the motion, and their estimate (d,).

    Everything is free, and descends from ``start`` (d,). `TooFarError` if more than ``most``
    squared standard deviations would be left. ``like`` is a problem of the same recordings, with
    which this one is compared: its standard deviations count, and its first samples. None where
    only the fast model is needed, where no recording has equations (phase currents are lacking), or
    where loops would be unstable at the start.
    """
    if not problem.lacks_forms:
        return None
    chart = problem.chart
    z = chart.project(chart.from_values(start[None]))
    every = _along(model, actuator, problem, values_at(problem, z))
    if not every:
        return None
    fitted = followed if _follows(every) else _recorded
    if like is None:  # else they start at the values of another answer
        z = _begun(problem, z, every)
    if (found := fitted(model, actuator, problem, z, every, most, like)) is None:
        return None
    problem, fit, z = found
    whole = _show_all(model, actuator, problem, fit.every)
    return problem.informed(fit.evidence(z)._replace(whole=whole)), chart.to_values(z)[0]


def _recorded(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    z: np.ndarray,
    every: Sequence[Along],
    most: float,
    like: Problem | None,
) -> tuple[Problem, MotionFit, np.ndarray] | None:
    """As `followed`, along motions that were recorded."""
    known = None if like is None else like.information
    remainders = {} if known is None else known.remainders

    aliases = partial(model.aliases, actuator)
    rests, begun = {along.equation.rests for along in every}, z
    named = {along.equation.name for along in every}
    first = named & rests
    stages = [first] if first else []
    if any(along.equation.at for along in every if along.equation.name in first):
        # what others rest on rests on them as well: in turn, then together until all agree
        stages += [named - first, named, named]
    told: Collection[str] = ()
    width: np.ndarray | None = None
    for names in stages:
        some = [along for along in every if along.equation.name in names]
        held = () if names & first else told
        fit = MotionFit(actuator, problem, z, some, remainders, aliases, held, width)
        z = fit.descended(z, most, rough=True)
        told, width = fit.free, fit.information
        every = nearer(every, problem, z, remainders)
    every = [along for along in every if along.equation.size > 0.0]
    fit = MotionFit(actuator, problem, z, every, remainders, aliases, (), width)
    starts = z, begun, problem.chart.from_values(problem.healthy[None])
    stable = (one for one in starts if np.isfinite(fit.residuals(one)).all())
    if (here := next(stable, None)) is None:
        return None
    z = fit.descended(here, most, rough=like is None)
    if like is None:
        if fit.finds_first_samples(z):
            problem = problem.sampled_first(fit.first_samples)
        z = fit.descended(z)
    if known is not None and fit.counts_more():
        z = fit.descended(z)
    return problem, fit, z
