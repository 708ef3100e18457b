"""Profiles: how much worse the best answer becomes when a fault is held somewhere else.

Each fault is walked to both sides in steps of about equal rise, from where the search ended. After
each step everything else descends again (Levenberg-Marquardt), from where the tangent puts it. All
walks go together, as one batch of the lanes. What they tell is for `ematwin.estimation.walk`; Raue
et al. (2009, Bioinformatics 25, 1923-1929) read from the shape what a recording cannot tell.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ematwin.estimation.constants import COVERAGE, DECIDES, PARTNERS, SMALLEST, TRADED
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.joint import Joint
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.presence import odds
from ematwin.estimation.uncertainty import (
    Question,
    Report,
    Uncertainty,
    strained,
    tells_nothing,
)
from ematwin.estimation.walk import NEAR, Walk, crossing, shape_of, smoothed, value_at
from ematwin.models.chart import Chart
from ematwin.models.unknown import Unknown
from ematwin.showing.words import listed

_STRIDE = 0.9  # of the root of the rise
_STEPS, _DESCENTS = 16, 4  # at most
_TOO_STEEP = 2.5  # strides that one may climb; else it is taken anew, half as long
_TO_THE_BOTTOM = 10  # iterations, before the first stride
_TIMES = 3  # that all set out anew, where a walk found a lower point
_SHORTEST = 1e-6  # share of a range
_DAMPING = 1e-2
_MOVED = 0.7  # standard errors by which others move to each side that are named
_LONGER = 1.25  # times that an interval is longer than its walk, which is said then
_BETTER = 1.0  # fall of the deviance that says that the search had not reached the bottom


@dataclass(frozen=True)
class ProfileUncertainty(Uncertainty):
    """Profiles of the faults.

    Attributes
    ----------
    walks : by fault
    evaluations : int
    """

    walks: dict[str, Walk] = field(default_factory=dict)
    evaluations: int = 0

    @property
    def headings(self) -> tuple[str, ...]:
        """Of `rows`."""
        return (*super().headings, "profile")

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """A row for each fault, with the shape of its profile."""
        return [
            (*row, walk.sentence)
            for row, walk in zip(super().rows, self.walks.values(), strict=True)
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        walks = {name: one.as_dict() for name, one in self.walks.items()}
        return {**super().as_dict(), "walks": walks, "evaluations": self.evaluations}


@dataclass(frozen=True)
class Profiles:
    """A profile of each fault that was searched; of directions only the magnitudes."""

    name: str = "profile"

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """Walk; Ctrl-C ends the walks where they are."""
        joint, faults = question.joint, question.faults
        walkers = _Walkers(joint, faults, question.assessed.sharp_errors)
        finished = walkers.run(report)
        walks = {}
        for n, one in enumerate(faults):
            answer = question.assessed.values[one.name]
            walks[one.name] = walkers.walk(n).reaching(answer, answer)
        doubts = strained(question)
        longer = []
        if any(walk.rough for walk in walks.values()):
            for name, walk in walks.items():
                least = question.assessed.intervals[name]
                walks[name] = walk.reaching(least.low, least.high)
                if walks[name].length > _LONGER * walk.length:
                    longer.append(name)
        if longer:
            doubts.append(
                f"Impacts make the misfit rough along {listed(longer)}, where walks end too soon; "
                "the interval is that of laplace. Use the posterior."
            )
        flat = [name for name, one in walks.items() if one.shape == "flat"]
        if flat:
            doubts.append(tells_nothing(flat))
        if walkers.fall > _BETTER:
            doubts.append(
                f"The misfit is rough: walks still found better answers than the one they set out "
                f"from (by {walkers.fall:.1f} in the deviance). Use the posterior."
            )
        if len(joint.valleys) > 1:
            doubts.append(
                "The search found other answers apart from this one, and profiles walk through "
                "this one only; use the posterior, which weighs them all."
            )
        if not finished:
            doubts.append("The walks were interrupted; intervals end where these had come to.")
        present, exceeds = {}, {}
        for one in faults:
            ends, reach = (one.lower, one.upper), SMALLEST * one.width
            walk = walks[one.name]
            share = walk.share_beyond(one.healthy - reach, one.healthy + reach, ends)
            present[one.name] = odds(share, one)
            if one.name in question.thresholds:
                limit = question.thresholds[one.name]
                at = limit.along(question.actuator, joint.problem.names, walk.points, walk.values)
                inside = (-math.inf, at) if limit.above else (at, math.inf)
                beyond = walk.share_beyond(*inside, ends)
                exceeds[one.name] = odds(share, one, beyond)
        return ProfileUncertainty(
            self.name, {name: one.interval for name, one in walks.items()}, present, None, exceeds,
            {name: one.text for name, one in question.thresholds.items()}, tuple(doubts), None,
            walks=walks, evaluations=walkers.spent,
        )  # fmt: skip


class _Walkers:
    """Two walks for each fault, down and up, all of them together.

    A magnitude with a direction is walked in both as they are (`plain`): in the components of its
    vector it is no coordinate. The others are walked in those, where a magnitude of zero may grow
    to every side.
    """

    def __init__(self, joint: Joint, faults: Sequence[Unknown], sharp: dict[str, float]) -> None:
        self.joint, self.faults, self.spent = joint, faults, 0
        self.chart = joint.problem.chart
        self.plain = Chart([replace(one, direction_of=None) for one in self.chart.unknowns])
        self.best = joint.valleys[0].z
        self.places = [joint.problem.names.index(one.name) for one in faults]
        polar = {radius for radius, _ in self.chart.pairs}
        self.polar = [n in polar for n in self.places]
        covariance = joint.valleys[0].covariance
        self.errors = np.sqrt(np.diag(covariance))
        self.sharp = [sharp[one.name] / self.chart.widths[n] for one, n in
                      zip(faults, self.places, strict=True)]  # fmt: skip
        self.trails: dict[tuple[int, int], list[tuple[np.ndarray, float]]] = {}
        self.strides: dict[tuple[int, int], float] = {}

    def _set_out(self, z: np.ndarray, deviance: float) -> None:
        """All walks stand at z (d,)."""
        self.best = z
        for n, polar in enumerate(self.polar):
            stride = self.sharp[n] if polar else self.errors[self.places[n]]
            for sign in (-1, 1):
                self.trails[n, sign] = [(self._own(z, polar), deviance)]
                self.strides[n, sign] = _STRIDE * min(stride, 1.0)

    def _bottom(self, starts: np.ndarray) -> tuple[np.ndarray, float]:
        """The lowest point (d,) below starts (M, d), and its deviance.

        The search minimises the misfit; with the model's own error priors count for more.
        """
        chart = self.chart

        def residuals(z: np.ndarray) -> np.ndarray:
            self.spent += len(z)
            return self.joint.residuals(z)

        descent = LevenbergMarquardt.start(chart.project(starts), residuals, damping=_DAMPING)
        for _ in range(_TO_THE_BOTTOM):
            descent.iterate(residuals, chart.lower, chart.upper, chart.project)
        found = self.joint.deviance_of(*self.joint.rises_of(descent.residuals))
        best = int(np.argmin(found))
        return chart.project(descent.points[best][None])[0], float(found[best])

    @property
    def least(self) -> float:
        """The least deviance so far."""
        return min(deviance for trail in self.trails.values() for _, deviance in trail)

    @property
    def fall(self) -> float:
        """By how much a walk went below where all set out."""
        return next(iter(self.trails.values()))[0][1] - self.least

    def run(self, report: Report) -> bool:
        """Walk until all rises are far enough; False if Ctrl-C ended it."""
        valley = self.joint.valleys[0]
        starts = np.stack([valley.z, valley.mean])
        with noting_interrupts() as interrupts:
            try:
                for _ in range(_TIMES):
                    self._set_out(*self._bottom(starts))
                    for step in range(_STEPS):
                        for polar in (False, True):
                            going = [key for key in self.trails if self.polar[key[0]] == polar
                                     and self._goes_on(key)]  # fmt: skip
                            if going:
                                self._step(going, polar)
                            interrupts.check()
                        report(self.spent, self.spent * _STEPS // (step + 1))
                    if self.fall < _BETTER:
                        break
                    starts = self._lowest()[None]
            except KeyboardInterrupt:
                if not self.trails:
                    raise
                return False
        return True

    def _lowest(self) -> np.ndarray:
        """The point (d,) of least deviance so far."""
        ends = [(deviance, key, u) for key, trail in self.trails.items() for u, deviance in trail]
        _, (fault, _), u = min(ends, key=lambda end: end[0])
        return self._z(u[None], self.polar[fault])[0]

    def _goes_on(self, key: tuple[int, int]) -> bool:
        fault, sign = key
        u, deviance = self.trails[key][-1]
        n = self.places[fault]
        ended = u[n] <= 0.0 if sign < 0 else u[n] >= 1.0
        return not ended and deviance - self.least < DECIDES

    def _step(self, going: list[tuple[int, int]], polar: bool) -> None:
        """One stride of some walks, and a descent of everything else."""
        lower, upper = self._bounds(polar)
        points = self._better(
            np.array([self._ahead(key) for key in going]),
            np.array([self._expected(key) for key in going]), polar,
        )  # fmt: skip
        low, high = np.tile(lower, (len(going), 1)), np.tile(upper, (len(going), 1))
        for m, (fault, _) in enumerate(going):
            n = self.places[fault]
            low[m, n] = high[m, n] = points[m, n]

        def residuals(u: np.ndarray) -> np.ndarray:
            self.spent += len(u)
            return self.joint.residuals(self._z(u, polar))

        def project(u: np.ndarray) -> np.ndarray:
            return self._own_all(self.chart.project(self._z(u, polar)), polar)

        descent = LevenbergMarquardt.start(points, residuals, damping=_DAMPING)
        for _ in range(_DESCENTS):
            descent.iterate(residuals, low, high, project)
        found = self.joint.deviance_of(*self.joint.rises_of(descent.residuals))
        for key, u, deviance in zip(going, descent.points, found, strict=True):
            self.trails[key].append((u, float(deviance)))
            self._adapt(key)

    def _target(self, key: tuple[int, int]) -> float:
        """Where a walk sets its next foot."""
        fault, sign = key
        here = self.trails[key][-1][0][self.places[fault]]
        return float(np.clip(here + sign * self.strides[key], 0.0, 1.0))

    def _ahead(self, key: tuple[int, int]) -> np.ndarray:
        """The point (d,) there that lies along the last stride."""
        trail, n, target = self.trails[key], self.places[key[0]], self._target(key)
        u = trail[-1][0].copy()
        if len(trail) > 1 and u[n] != trail[-2][0][n]:
            gone = u - trail[-2][0]
            u += gone * (target - u[n]) / gone[n]
        polar = self.polar[key[0]]
        u = np.clip(u, *self._bounds(polar))
        if not polar:
            u = self.chart.project(u[None])[0]
        u[n] = target
        return u

    def _expected(self, key: tuple[int, int]) -> np.ndarray:
        """The point (d,) there at which the valley's normal approximation is lowest."""
        from scipy.optimize import lsq_linear

        n, target = self.places[key[0]], self._target(key)
        if self.polar[key[0]]:
            return self._ahead(key)
        valley = self.joint.valleys[0]
        sizes, vectors = np.linalg.eigh(valley.precision)
        root = np.sqrt(np.maximum(sizes, 0.0))[:, None] * vectors.T
        rest = np.arange(len(valley.z)) != n
        left = root @ valley.mean - root[:, n] * target
        bounds = self.chart.lower[rest], self.chart.upper[rest]
        u = np.full(len(rest), target)
        u[rest] = lsq_linear(root[:, rest], left, bounds, method="bvls").x
        u = self.chart.project(u[None])[0]
        u[n] = target
        return u

    def _better(self, some: np.ndarray, others: np.ndarray, polar: bool) -> np.ndarray:
        """Of each pair of points (M, d) the lower one."""
        self.spent += 2 * len(some)
        both = self.joint.deviance(self._z(np.vstack([some, others]), polar))
        first = both[: len(some)] <= both[len(some) :]
        return np.where(first[:, None], some, others)

    def _adapt(self, key: tuple[int, int]) -> None:
        """The next stride: as long as the rise of the last ones lets it be."""
        n, least, trail = self.places[key[0]], self.least, self.trails[key]
        (before, first), (after, then) = trail[-2:]
        gone = abs(after[n] - before[n])
        climbed = math.sqrt(max(then - least, 0.0)) - math.sqrt(max(first - least, 0.0))
        if climbed > _TOO_STEEP * _STRIDE and gone > _SHORTEST:
            # also where the twin diverged: nothing is known of what lies between
            trail.pop()
            self.strides[key] = 0.5 * gone
            return
        ratio = _STRIDE / max(climbed, 1e-9)
        self.strides[key] = gone * min(max(ratio, 0.5), 2.5)

    def walk(self, fault: int) -> Walk:
        """What two walks tell of a fault."""
        one, n, polar = self.faults[fault], self.places[fault], self.polar[fault]
        down, up = self.trails[fault, -1], self.trails[fault, 1]
        trail = sorted([*down[1:], *up], key=lambda point: float(point[0][n]))
        u = np.array([point for point, _ in trail])
        rise, rough = smoothed(u[:, n], np.array([deviance for _, deviance in trail]) - self.least)
        points = self.chart.to_values(self._z(u, polar))
        best = int(np.argmin(rise))
        ends, crossed = [], []
        for bound in (0, 1):
            way = list(range(best, len(rise)) if bound else range(best, -1, -1))
            end = crossing(u[:, n], rise, way)
            crossed.append(end is not None)
            ends.append(float(bound) if end is None else end)
        wide = ends[1] - ends[0] > TRADED * 2.0 * COVERAGE / self._sharpness(n)
        partners = self._partners(fault, u, rise) if wide else ()
        values = points[:, n]
        low, high = self._with_scatter(one, values[best], [value_at(one, end) for end in ends])
        shape = shape_of(crossed, float(values[best]), one)
        return Walk(one.name, values, rise, points, (low, high), shape, partners, rough)

    def _sharpness(self, n: int) -> float:
        """One over the error of an unknown if all others were known, as shares of its range."""
        return math.sqrt(max(self.joint.valleys[0].precision[n, n], 1e-12))

    def _with_scatter(self, one: Unknown, best: float, ends: list[float]) -> tuple[float, float]:
        """Ends with what healthy recordings differed by, within the bounds."""
        reach = COVERAGE * self.joint.scatter.get(one.name, 0.0)
        low = best - math.hypot(best - ends[0], reach)
        high = best + math.hypot(ends[1] - best, reach)
        return max(float(low), one.lower), min(float(high), one.upper)

    def _partners(self, fault: int, u: np.ndarray, rise: np.ndarray) -> tuple[str, ...]:
        """Names of what moves along, what is no fault first."""
        if self.polar[fault]:
            return ()
        near = u[rise < NEAR]
        n = self.places[fault]
        # what moves as far as it is uncertain while the fault does
        slopes = np.abs(np.polyfit(near[:, n], near, 1)[0]) if np.ptp(near[:, n]) > 0.0 else 0.0
        moved = slopes * self.errors[n] / self.errors
        unknowns = self.chart.unknowns
        along = [k for k in range(len(moved)) if k != n and moved[k] > _MOVED]
        along.sort(key=lambda k: (unknowns[k].role == "fault", -moved[k]))
        return tuple(self.chart.names[k] for k in along[:PARTNERS])

    def _bounds(self, polar: bool) -> tuple[np.ndarray, np.ndarray]:
        if not polar:
            return self.chart.lower, self.chart.upper
        lower, upper = self.plain.lower.copy(), self.plain.upper.copy()
        for _, direction in self.chart.pairs:  # once round and further
            lower[direction], upper[direction] = -np.inf, np.inf
        return lower, upper

    def _z(self, u: np.ndarray, polar: bool) -> np.ndarray:
        """Coordinates of the chart (B, d) of those of a walk."""
        return self.chart.from_values(self.plain.to_values(u)) if polar else u

    def _own(self, z: np.ndarray, polar: bool) -> np.ndarray:
        return self._own_all(z[None], polar)[0]

    def _own_all(self, z: np.ndarray, polar: bool) -> np.ndarray:
        """Coordinates of a walk (B, d) of those of the chart."""
        return self.plain.from_values(self.chart.to_values(z)) if polar else z
