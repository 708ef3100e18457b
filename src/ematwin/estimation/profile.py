"""Profile likelihood of each fault: the least deviance with the fault held at a value.

Its points come from `ematwin.estimation.tracing`. The 95 % interval ends where the rise of the
deviance passes 3.84 (Wilks 1938; Venzon and Moolgavkar 1988, J. R. Stat. Soc. C 37, 87-94); its
shape shows which unknowns a recording cannot determine (Raue et al. 2009, Bioinformatics 25,
1923-1929).

Impacts make the deviance rough: descents stop before
everything else has made up for a wrong value, and profiles rise too early. Where the rise along any
fault scatters by more than `ROUGH` about a parabola, no interval is therefore shorter than
Laplace's, whose slopes look past that: descents along all faults go through the same misfit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import COVERAGE, PARTNERS, TRADED
from ematwin.estimation.tracing import BETTER, Tracer
from ematwin.estimation.uncertainty import (
    Question,
    Report,
    Uncertainty,
    by_sets,
    strained,
    tells_nothing,
)
from ematwin.models.unknown import Unknown
from ematwin.showing.text import listed

LIMIT = COVERAGE**2  # of the rise: chi-squared distribution of one degree
NEAR = 16.0  # rise of points to which a parabola is fitted
ROUGH = 0.5  # root mean square of the rise about it; 0.1 to 0.4 of what impacts hardly touch
_AT_BOUND = 2e-3  # share of the range
_MOVED = 0.7  # standard errors by which others move to each side that are named
_LONGER = 1.25  # ratio of Laplace's interval to that of the profile from which that is said


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
    roughness : root mean square of the rise about a parabola; 0 if there are too few points
    """

    name: str
    values: np.ndarray
    rise: np.ndarray
    points: np.ndarray
    interval: tuple[float, float]
    shape: str
    partners: tuple[str, ...]
    roughness: float = 0.0

    @property
    def rough(self) -> bool:
        """Whether impacts make the rise too rough to be relied on."""
        return self.roughness > ROUGH

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
            "roughness": self.roughness,
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
        tracer = Tracer(question)
        finished = tracer.run(report)
        profiles = {one.name: _profile(tracer, n) for n, one in enumerate(question.faults)}
        doubts = [*strained(question), *_lengthened(question, profiles)]
        flat = [name for name, one in profiles.items() if one.shape == "flat"]
        if flat:
            doubts.append(tells_nothing(flat))
        if tracer.fall > BETTER:
            doubts.append(
                "The misfit is rough: profiles still found better answers than the one that they "
                f"began at (by {tracer.fall:.1f} in the deviance). Use the posterior."
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


def _lengthened(question: Question, profiles: dict[str, Profile]) -> list[str]:
    """Lengthen intervals to hold the answer and, on rough profiles, Laplace's; in words."""
    rough = any(one.rough for one in profiles.values())
    longer = []
    for name, one in profiles.items():
        (low, high), value = one.interval, question.assessed.values[name]
        low, high = min(low, value), max(high, value)
        laplace = question.assessed.intervals[name]
        ends = (min(low, laplace.low), max(high, laplace.high)) if rough else (low, high)
        if ends[1] - ends[0] > _LONGER * (high - low):
            longer.append(name)
        profiles[name] = replace(one, interval=ends)
    if not longer:
        return []
    return [
        f"Impacts make the misfit rough along {listed(longer)}, where profiles end too soon; "
        "the interval is laplace's. Use the posterior."
    ]


def _profile(tracer: Tracer, fault: int) -> Profile:
    """The profile from two traces."""
    one, (down, up) = tracer.faults[fault], tracer.traces[2 * fault : 2 * fault + 2]
    n, chart = down.place, down.chart
    path = [*down.path[:0:-1], *up.path]
    u, deviances = np.array([u for u, _ in path]), np.array([deviance for _, deviance in path])
    rise, rough = smoothed(u[:, n], deviances - tracer.least)
    points = chart.to_values(u)
    best, root = int(np.argmin(rise)), np.sqrt(rise)
    ends = [
        _crossing(u[best::-1, n], root[best::-1]),
        _crossing(u[best:, n], root[best:]),
    ]
    low, high = (0.0 if ends[0] is None else ends[0]), (1.0 if ends[1] is None else ends[1])
    sharpness = math.sqrt(max(tracer.joint.normals[0].precision[n, n], 1e-12))
    wide = high - low > TRADED * 2.0 * COVERAGE / sharpness
    partners = _partners(tracer, n, u[rise < NEAR]) if wide and chart is tracer.chart else ()
    values = points[:, n]
    lower, upper = tracer.chart.from_unit(np.tile([[low], [high]], len(tracer.errors)))[:, n]
    reach = COVERAGE * tracer.joint.scatter.get(one.name, 0.0)
    interval = (
        max(float(values[best] - math.hypot(values[best] - lower, reach)), one.lower),
        min(float(values[best] + math.hypot(upper - values[best], reach)), one.upper),
    )
    shape = _shape([end is not None for end in ends], float(values[best]), one)
    return Profile(one.name, values, rise, points, interval, shape, partners, rough)


def _partners(tracer: Tracer, n: int, near: np.ndarray) -> tuple[str, ...]:
    """Names of unknowns that move along at points (M, d), those other than faults first."""
    if np.ptp(near[:, n]) == 0.0:
        return ()
    # in standard errors while the fault moves by one
    moved = np.abs(np.polyfit(near[:, n], near, 1)[0]) * tracer.errors[n] / tracer.errors
    along = [k for k in range(len(moved)) if k != n and moved[k] > _MOVED]
    along.sort(key=lambda k: (tracer.chart.unknowns[k].role == "fault", -moved[k]))
    return tuple(tracer.chart.names[k] for k in along[:PARTNERS])


def smoothed(u: np.ndarray, rise: np.ndarray) -> tuple[np.ndarray, float]:
    """Rises (n,) over the bottom of a parabola through them, at least 0; and their roughness.

    Impacts make the misfit rough. The least of many rough values is a lucky one, and an interval
    that began there would be too short.
    """
    near = rise < NEAR
    if near.sum() < 5:  # points that the parabola needs
        return rise, 0.0
    at = u[near] - u[near].mean()
    at /= float(np.abs(at).max()) or 1.0
    fitted = np.polyfit(at, rise[near], 2)
    rough = float(np.sqrt(np.mean((rise[near] - np.polyval(fitted, at)) ** 2)))
    if fitted[0] <= 0.0:
        return rise, rough
    lowest = np.clip(-fitted[1] / (2.0 * fitted[0]), at.min(), at.max())
    return np.maximum(rise - max(float(np.polyval(fitted, lowest)), 0.0), 0.0), rough


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
