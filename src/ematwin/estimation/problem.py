"""Problem: recordings, the twin, and what is unknown: the seam under every search.

Search, covariance, intervals and everything later are functions of a problem and know no actuator.
A problem answers batches: `costs` and `residuals` of points (B, d), one row a candidate, over all
its recordings. Its points are values of the free unknowns, in their own units; `chart` gives the
coordinates for methods that follow slopes.
"""

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.models.base import Model
from ematwin.models.chart import Chart
from ematwin.models.comparison import Comparison
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.unknown import Unknown
from ematwin.recordings.recording import Recording


class Problem:
    """What is searched: free unknowns over one or several recordings.

    Parameters
    ----------
    comparisons : one for each recording
    free : unknowns that are searched
    held : values of others, by name; what is not named is healthy or nominal
    own : names of the free unknowns that each recording has for itself, such as its load; with
        several recordings each becomes one unknown a recording, ``load@2`` that of the third
    start : values, by name, of the first point that a search looks at; healthy if not given
    starts : values, by name, from which a local search may set out; those of ``start`` if not named

    Attributes
    ----------
    unknowns : tuple of Unknown, (d,)
    chart : Chart
    start : (d,) array
    starts : (M, d) array
    """

    def __init__(
        self,
        comparisons: Sequence[Comparison],
        free: Sequence[Unknown],
        *,
        held: Mapping[str, float] | None = None,
        own: Iterable[str] = (),
        start: Mapping[str, float] | None = None,
        starts: Sequence[Mapping[str, float]] = ({},),
    ) -> None:
        if not free:
            raise InputError("No unknown is left to search; name at least one, e.g. friction.")
        self.comparisons = tuple(comparisons)
        self.held = dict(held or {})
        count = len(self.comparisons)
        mine = set(own) if count > 1 else set()
        shared = [one for one in free if one.name not in mine]
        each = [one for one in free if one.name in mine]
        self._shared, self._each = shared, each
        self.unknowns: tuple[Unknown, ...] = (
            *shared,
            *(replace(one, name=f"{one.name}@{n}") for n in range(count) for one in each),
        )
        self.chart = Chart(self.unknowns)
        self._priors = [n for n, one in enumerate(self.unknowns) if one.spread is not None]
        held_by = [self.unknowns[n] for n in self._priors]
        self._spread = np.array([one.spread for one in held_by], dtype=float)
        self._logarithmic = np.array([one.logarithmic for one in held_by], dtype=bool)
        self._prior_mean = np.array(
            [np.log(one.healthy) if one.logarithmic else one.healthy for one in held_by]
        )
        given = dict(start or {})
        self.start = np.array([given.get(one.name, one.healthy) for one in self.unknowns])
        self.starts = np.array(
            [
                [one.get(name, value) for name, value in zip(self.names, self.start, strict=True)]
                for one in starts
            ]
        )

    @classmethod
    def of(
        cls,
        recording: Recording,
        actuator: Any,
        *,
        only: Iterable[str] | None = None,
        held: Mapping[str, float] | Any | None = None,
        threads: int | None = None,
        **settings: Any,
    ) -> "Problem":
        """The problem that `ematwin.identify` solves; arguments as there.

        ``settings`` go to the comparison of the kind (`ematwin.models.base.Model.compare`).
        """
        chosen = load_actuator(actuator)
        model = model_of(chosen)
        free, fixed = unknowns_of(model, chosen, only, held)
        comparison = model.compare(recording, chosen, threads=threads, **settings)
        starts = model.starts(chosen, recording)
        return cls([comparison], free, held=fixed, start=fixed, starts=starts)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free unknowns."""
        return tuple(one.name for one in self.unknowns)

    @property
    def lower(self) -> np.ndarray:
        """(d,) lower bounds."""
        return np.array([one.lower for one in self.unknowns])

    @property
    def upper(self) -> np.ndarray:
        """(d,) upper bounds."""
        return np.array([one.upper for one in self.unknowns])

    @property
    def healthy(self) -> np.ndarray:
        """(d,) healthy values."""
        return np.array([one.healthy for one in self.unknowns])

    def costs(self, points: np.ndarray) -> np.ndarray:
        """Sums of squares (B,) of points (B, d), priors included; infinite where one diverged."""
        cost: Any = 0.0
        if self._priors:
            away = self._priors_of(points)
            cost = np.einsum("bk,bk->b", away, away)
        for n, comparison in enumerate(self.comparisons):
            cost = cost + comparison.costs(self.candidates(points, n), len(points))
        return np.asarray(cost)

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """Weighted residuals (B, K) of points (B, d): recordings in their order, then priors."""
        parts = [
            comparison.residuals(self.candidates(points, n), len(points))
            for n, comparison in enumerate(self.comparisons)
        ]
        if self._priors:
            parts.append(self._priors_of(points))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def candidates(self, points: np.ndarray, recording: int = 0) -> dict[str, np.ndarray]:
        """Values (B,) by name, as a comparison takes them, of points (B, d)."""
        found = {name: np.full(len(points), value) for name, value in self.held.items()}
        for n, one in enumerate(self._shared):
            found[one.name] = points[:, n]
        first = len(self._shared) + recording * len(self._each)
        for n, one in enumerate(self._each):
            found[one.name] = points[:, first + n]
        return found

    def from_box(self, points: np.ndarray) -> np.ndarray:
        """Points (B, d) of those (B, d) that a method sees which searches the box between bounds.

        The same, unless a study turns the box round.
        """
        return points

    def values(self, point: np.ndarray) -> dict[str, float]:
        """Held and free values by name at a point (d,)."""
        return {**self.held, **dict(zip(self.names, point.tolist(), strict=True))}

    def relative_misfit(self, cost: float) -> float:
        """Root of the cost over that of a twin that does not answer: 0 is a perfect fit."""
        return float(np.sqrt(cost / sum(one.scale for one in self.comparisons)))

    @property
    def expected_misfit(self) -> float:
        """The relative misfit that the noise of the recordings alone leaves."""
        noise = sum(one.expected_misfit**2 * one.scale for one in self.comparisons)
        return float(np.sqrt(noise / sum(one.scale for one in self.comparisons)))

    def smoothed(self) -> "Problem":
        """The same problem with misfits that are smooth over wide valleys, or itself."""
        smooth = [one.smoothed() for one in self.comparisons]
        if any(one is None for one in smooth):
            return self
        return self._with([one for one in smooth if one is not None])

    def restarted(self) -> "Problem | None":
        """The same problem by stretches from recorded states, or None without states."""
        parts = [one.restarted() for one in self.comparisons]
        if any(one is None for one in parts):
            return None
        return self._with([one for one in parts if one is not None])

    def _with(self, comparisons: Sequence[Comparison]) -> "Problem":
        other = copy.copy(self)
        other.comparisons = tuple(comparisons)
        return other

    def _priors_of(self, points: np.ndarray) -> np.ndarray:
        """Distances (B, P) from the means of the priors, in the unit of the residuals."""
        away = points[:, self._priors]
        if self._logarithmic.any():
            away[:, self._logarithmic] = np.log(away[:, self._logarithmic])
        return np.asarray(self.comparisons[0].noise * ((away - self._prior_mean) / self._spread))


def unknowns_of(
    model: Model, actuator: Any, only: Iterable[str] | None, held: Any
) -> tuple[list[Unknown], dict[str, float]]:
    """Free unknowns, and values of those that are held."""
    places: dict[str, float] = {}
    given = held
    if isinstance(held, Mapping):
        places = {name: float(value) for name, value in held.items() if "." in name}
        given = {name: value for name, value in held.items() if "." not in name}
        for place, value in places.items():
            model.unknown(actuator, place).check(value)
    values = model.values_of(actuator, given)
    own = [one for one in model.unknowns(actuator) if one.role in ("fault", "nuisance")]
    if only is None:
        free = own
    else:
        wanted = [model.unknown(actuator, name) for name in dict.fromkeys(only)]
        if not wanted:
            raise InputError("No fault is left to search; name at least one, e.g. friction.")
        names = {one.name for one in wanted}
        # nuisances stay free: a load that was not recorded is unknown whatever is searched
        free = [one for one in own if one.name in names or one.role == "nuisance"]
        free += [one for one in wanted if one.role == "nominal"]
        unsearchable = [one.name for one in wanted if one.role == "symptom"]
        if unsearchable:
            raise InputError(
                f"{unsearchable[0]} is derived from what the twin leaves unexplained and cannot be "
                "searched; use ematwin detect."
            )
    left_out = {one.name for one in free}
    left_out |= {one.name for one in model.unknowns(actuator) if one.role == "symptom"}
    fixed = {**values, **places}
    return free, {name: value for name, value in fixed.items() if name not in left_out}
