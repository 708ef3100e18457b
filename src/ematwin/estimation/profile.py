"""Profile likelihood of each fault: how much worse it explains a recording at other values.

From the best point on a fault is moved to both sides, in steps of about equal rise, and everything
else follows to its peak there. Like all peaks these come from residuals that are regressed over
their width (`ematwin.estimation.laplace`), so that impacts do not make the rise rough. The 95 %
interval ends where the rise passes 3.84 (Wilks 1938; Venzon and Moolgavkar 1988, J. R. Stat. Soc. C
37, 87-94); its shape shows which unknowns a recording cannot determine (Raue et al. 2009,
Bioinformatics 25, 1923-1929).
"""

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import COVERAGE, DECIDES, PARTNERS, TRADED, WORTH
from ematwin.estimation.interrupt import until_interrupted
from ematwin.estimation.laplace import Laplace, peak_near
from ematwin.estimation.uncertainty import (
    Question,
    Report,
    Uncertainty,
    by_sets,
    strained,
    tells_nothing,
)
from ematwin.models.chart import Chart
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side

LIMIT = COVERAGE**2  # of the rise: chi-squared distribution of one degree
_STRIDE, _LONGEST = 0.7, 0.25  # of a step: standard errors, and at most a share of the range
_STEPS = 16  # to each side at most
_AT_BOUND = 2e-3  # share of the range
_MOVED = 0.7  # standard errors by which others move to each side that are named


@dataclass(frozen=True)
class Profile:
    """Profile of one fault.

    Attributes
    ----------
    name : of the fault
    values : (n,) array, ascending
    rise : (n,) array, of the deviance over the least one
    points : (n, d) array, values of everything that is free, in the order of the problem
    interval : ends of 95 %
    shape : "bounded", "one-sided", "flat", or "at its bound"
    partners : unknowns that it is traded off against, the strongest first
    """

    name: str
    values: np.ndarray
    rise: np.ndarray
    points: np.ndarray
    interval: tuple[float, float]
    shape: str
    partners: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The shape, in words."""
        if self.partners:
            return f"{self.shape}, traded off against {' and '.join(self.partners)}"
        return self.shape

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "values": self.values.tolist(),
            "rise": self.rise.tolist(),
            "interval": list(self.interval),
            "shape": self.shape,
            "partners": list(self.partners),
        }


@dataclass(frozen=True)
class ProfileUncertainty(Uncertainty):
    """Profiles of the faults.

    Attributes
    ----------
    walks : profiles by fault
    evaluations : int
    """

    walks: dict[str, Profile] = field(default_factory=dict)
    evaluations: int = 0

    @property
    def headings(self) -> tuple[str, ...]:
        """Of `rows`."""
        return (*super().headings, "profile")

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """A row for each fault, with the shape of its profile."""
        return [
            (*row, one.sentence) for row, one in zip(super().rows, self.walks.values(), strict=True)
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        walks = {name: one.as_dict() for name, one in self.walks.items()}
        return {**super().as_dict(), "walks": walks, "evaluations": self.evaluations}


@dataclass(frozen=True)
class Profiles:
    """Profile of each fault that was searched; of directions only the magnitudes."""

    name: str = "profile"

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """Trace the profiles; Ctrl-C ends them where they are.

        Raises
        ------
        InputError
            If no fault was searched.
        """
        if not question.faults:
            raise InputError(
                f"Profiles are of faults, and only {', '.join(question.problem.names)} was "
                "searched; search a fault, or use laplace or posterior."
            )
        tracer = _Tracer(question)
        finished = tracer.run(report)
        values = question.assessed.values
        profiles = {one.name: tracer.profile(one, values[one.name]) for one in question.faults}
        doubts = strained(question)
        flat = [name for name, one in profiles.items() if one.shape == "flat"]
        if flat:
            doubts.append(tells_nothing(flat))
        if tracer.fall > WORTH:
            doubts.append(
                "Profiles found a better answer than the one that they began at (by "
                f"{tracer.fall:.1f} in the deviance). Use the posterior."
            )
        if len(question.joint.peaks) > 1:
            doubts.append(
                "The search found other answers apart from this one, and profiles belong to this "
                "one only; use the posterior, which weighs them all."
            )
        if not finished:
            doubts.append("The profiles were interrupted; intervals end where they had come to.")
        return ProfileUncertainty(
            self.name, {name: one.interval for name, one in profiles.items()},
            **by_sets(question, question.sets, question.sets.drawn), doubts=tuple(doubts),
            walks=profiles, evaluations=tracer.evaluations,
        )  # fmt: skip


class _Side:
    """Peaks with a fault held, from the best point on down, or from there to the other side.

    A magnitude with a direction is held in its own chart: in the components of its vector it is no
    coordinate. The others are held in the problem's, where a magnitude of zero may grow to every
    side.
    """

    def __init__(self, question: Question, fault: Unknown) -> None:
        joint = question.joint
        problem, z = joint.problem.with_noise(joint.factor * joint.problem.noise), joint.peaks[0].z
        self.place, self.sign, self.aliases = problem.names.index(fault.name), -1, joint.aliases
        information: np.ndarray | None = joint.normals[0].precision
        if any(self.place == magnitude for magnitude, _ in problem.chart.pairs):
            polar = Chart([replace(one, direction_of=None) for one in problem.unknowns])
            z = polar.from_values(problem.chart.to_values(z[None]))[0]
            for _, direction in problem.chart.pairs:  # half a turn to both sides
                polar.lower[direction], polar.upper[direction] = z[direction] + (-0.5, 0.5)
            problem, information = copy.copy(problem), None
            problem.chart = polar
        self.problem, self.fault = problem, fault
        self.path = [self._peak(z, information)]

    def other(self) -> "_Side":
        """The side above, from the same peak."""
        up = copy.copy(self)
        up.sign, up.path = 1, self.path[:1]
        return up

    def _peak(self, z: np.ndarray, information: np.ndarray | None) -> Laplace:
        return peak_near(self.problem, z, information, self.aliases, {self.fault.name})

    def height(self, peak: Laplace) -> float:
        """Squared standard deviations from the recording and the priors."""
        return float(peak.residuals @ peak.residuals) / self.problem.noise**2

    @property
    def ended(self) -> bool:
        """Whether the fault has come to the end of its range, or the rise is large enough."""
        last = self.path[-1]
        at_bound = last.z[self.place] <= 0.0 if self.sign < 0 else last.z[self.place] >= 1.0
        heights = [self.height(one) for one in self.path]
        return bool(at_bound or heights[-1] - min(heights) >= DECIDES or len(self.path) > _STEPS)

    def advance(self) -> None:
        """The next peak: everything else follows as the last one says."""
        last, n = self.path[-1], self.place
        variance = last.covariance[n, n]
        stride = min(_STRIDE * math.sqrt(variance), _LONGEST)
        moved = np.clip(last.z[n] + self.sign * stride, 0.0, 1.0) - last.z[n]
        z = self.problem.chart.project((last.z + moved * last.covariance[n] / variance)[None])[0]
        z[n] = last.z[n] + moved
        self.path.append(self._peak(z, last.information))


class _Tracer:
    """Two sides of each fault, all of them together.

    Attributes
    ----------
    sides : by fault, down and up
    """

    def __init__(self, question: Question) -> None:
        self._joint = question.joint
        begun = side_by_side(lambda fault: _Side(question, fault), question.faults)
        self.sides = {side.fault.name: (side, side.other()) for side in begun}
        self._every = [side for pair in self.sides.values() for side in pair]

    @property
    def evaluations(self) -> int:
        """Simulations so far."""
        first = sum(down.path[0].evaluations for down, _ in self.sides.values())
        return first + sum(peak.evaluations for one in self._every for peak in one.path[1:])

    @property
    def fall(self) -> float:
        """How far below the best point a profile went."""
        return max(
            side.height(side.path[0]) - side.height(peak)
            for side in self._every
            for peak in side.path
        )

    def run(self, report: Report) -> bool:
        """Trace until all rises are large enough; False if Ctrl-C ended it."""
        with until_interrupted() as interrupts:
            for step in range(1, _STEPS + 1):
                side_by_side(_Side.advance, [one for one in self._every if not one.ended])
                interrupts.check()
                report(self.evaluations, self.evaluations * _STEPS // step)
        return not interrupts.ended

    def profile(self, one: Unknown, value: float) -> Profile:
        """The profile of a fault from both sides; its interval holds the value of the answer."""
        down, up = self.sides[one.name]
        n, chart = up.place, up.problem.chart
        path = [*down.path[:0:-1], *up.path]
        u, heights = np.array([peak.z for peak in path]), np.array([up.height(p) for p in path])
        rise, points = heights - heights.min(), chart.to_values(u)
        best, root = int(np.argmin(rise)), np.sqrt(rise)
        ends = [
            _crossing(u[best::-1, n], root[best::-1]),
            _crossing(u[best:, n], root[best:]),
        ]
        low, high = (0.0 if ends[0] is None else ends[0]), (1.0 if ends[1] is None else ends[1])
        normal = self._joint.normals[0]
        sharpness = math.sqrt(max(normal.precision[n, n], 1e-12))
        wide = high - low > TRADED * 2.0 * COVERAGE / sharpness
        near = u[rise < DECIDES] if wide and chart is self._joint.problem.chart else u[:0]
        partners = _partners(chart, n, near, np.sqrt(np.diag(normal.covariance)))
        values = points[:, n]
        lower, upper = chart.from_unit(np.tile([[low], [high]], u.shape[1]))[:, n]
        reach = COVERAGE * self._joint.scatter.get(one.name, 0.0)
        below = float(values[best] - math.hypot(values[best] - lower, reach))
        above = float(values[best] + math.hypot(upper - values[best], reach))
        interval = (max(min(below, value), one.lower), min(max(above, value), one.upper))
        shape = _shape([end is not None for end in ends], float(values[best]), one)
        return Profile(one.name, values, rise, points, interval, shape, partners)


def _partners(chart: Chart, n: int, near: np.ndarray, errors: np.ndarray) -> tuple[str, ...]:
    """Names of unknowns that move along at points (M, d), those other than faults first.

    ``errors`` (d,) are standard errors.
    """
    if not len(near) or np.ptp(near[:, n]) == 0.0:
        return ()
    # in standard errors while the fault moves by one
    moved = np.abs(np.polyfit(near[:, n], near, 1)[0]) * errors[n] / errors
    along = [k for k in range(len(moved)) if k != n and moved[k] > _MOVED]
    along.sort(key=lambda k: (chart.unknowns[k].role == "fault", -moved[k]))
    return tuple(chart.names[k] for k in along[:PARTNERS])


def _crossing(u: np.ndarray, root: np.ndarray) -> float | None:
    """Where the root (n,) of the rise passes the root of the limit, from the best point on."""
    limit = math.sqrt(LIMIT)
    beyond = np.flatnonzero(root[1:] >= limit)
    if not len(beyond):
        return None
    b = int(beyond[0]) + 1
    return float(u[b - 1] + (limit - root[b - 1]) / (root[b] - root[b - 1]) * (u[b] - u[b - 1]))


def _shape(crossed: Sequence[bool], best: float, one: Unknown) -> str:
    """The shape in a word, from where the limit was crossed (below, above) and the best value."""
    if all(crossed):
        return "bounded"
    if not any(crossed):
        return "flat"
    bound = one.lower if crossed[1] else one.upper
    return "at its bound" if abs(best - bound) < _AT_BOUND * one.width else "one-sided"
