"""Problem: recordings, the twin, and the unknowns: the seam under every search.

Search, covariance, intervals and everything later are functions of a problem and know no actuator.
A problem answers batches: `costs` and `residuals` of points (B, d), one row a candidate, over all
its recordings. Its points are values of the free unknowns, in their own units; `chart` gives the
coordinates for methods that follow slopes.
"""

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.free_unknowns import unknowns_of
from ematwin.estimation.prior import Information, Prior
from ematwin.models.chart import Chart
from ematwin.models.comparison import Comparison
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.unknown import HasUnknowns, Unknown
from ematwin.numerics.side_by_side import side_by_side
from ematwin.recordings.recording import Recording


class Residuals(NamedTuple):
    """Residuals (..., K) by where they come from.

    ``data`` are the residuals that a search sees, ``evidence`` the residuals of further channels
    (`Comparison.with_evidence`), ``priors`` the distances from the prior means.
    """

    data: np.ndarray
    evidence: np.ndarray
    priors: np.ndarray


class ResidualChange(Protocol):
    """A change of residuals with the unknowns, which the fast model lacks."""

    def residuals(self, values: Mapping[str, np.ndarray], recording: int) -> np.ndarray:
        """(B, K), of a recording, at values (B,) of all unknowns by name."""


class Problem(HasUnknowns):
    """Free unknowns to be estimated from one or several recordings.

    Parameters
    ----------
    comparisons : one for each recording
    free : unknowns that are searched
    held : values of others, by name; unnamed ones are healthy or nominal
    own : names of the free unknowns that each recording has for itself, such as its load; with
        several recordings each becomes one unknown per recording: ``load@2`` for the third
    start : values, by name, of the first point that a search looks at; healthy if not given
    starts : values, by name, from which a local search may start; as in ``start`` if not named
    prior : of free unknowns; by default their spreads, independent of one another

    Attributes
    ----------
    unknowns : tuple of Unknown, (d,)
    chart : Chart
    start : (d,) array
    starts : (M, d) array
    noise : float, standard deviation of an independent residual: the unit in which priors count
    changes : tuple of ResidualChange, of a problem that the reference corrects
    answered : residuals (K,) of each recording that no unknown moves; None where the twin answers
    information : Information, knowledge beside the priors; None without
    trust : float, how far evidence counts: one over its noise in the unit of that expected, 1 at
        most
    model_error : float, factor on standard errors for errors of the fast model that are the same
        throughout a recording; where the reference corrects it, for its discrepancy alone
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
        prior: Prior | None = None,
    ) -> None:
        self.comparisons = tuple(one.beside(comparisons) for one in comparisons)
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
        self.noise = self.comparisons[0].noise
        self.trust = 1.0
        self.model_error = self.comparisons[0].model_error
        self.prior = Prior.independent(self.unknowns) if prior is None else prior
        self._priors = [self.names.index(name) for name in self.prior.names]
        self._logarithmic = np.array([self.unknowns[n].logarithmic for n in self._priors], bool)
        self.changes: tuple[ResidualChange, ...] = ()
        self.answered: Sequence[np.ndarray] | None = None
        self.information: Information | None = None
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
        if not free:
            raise InputError("No unknown is left to search; name at least one, e.g. friction.")
        comparison = model.compare(recording, chosen, threads=threads, **settings)
        starts = model.starts(chosen, recording)
        return cls([comparison], free, held=fixed, start=fixed, starts=starts)

    def costs(self, points: np.ndarray, limits: np.ndarray | None = None) -> np.ndarray:
        """Sums of squares (B,) of points (B, d), priors included; infinite where one diverged.

        Costs above ``limits`` (B,) may be given as infinite.
        """
        if self.has_evidence or self.changes or self.answered is not None:
            residuals = self.residuals(points)
            squares = np.einsum("bk,bk->b", residuals, residuals)
            return np.where(np.isfinite(squares), squares, np.inf)
        cost: Any = 0.0
        if self._priors or self.is_informed:
            away = self.prior_distances(points)
            cost = np.einsum("bk,bk->b", away, away)
        for n, comparison in enumerate(self.comparisons):
            candidates = self.candidates(points, n)
            if limits is None:
                part = comparison.costs(candidates, len(points))
            else:
                # what the others leave of the limit, and a little more: their sum is rounded
                with np.errstate(invalid="ignore"):  # infinite cost, infinite limit
                    rest = limits * (1.0 + 1e-12) - cost
                part = comparison.costs_within(candidates, len(points), rest)
            cost = cost + part
        return np.asarray(cost)

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """Weighted residuals (B, K) of points (B, d), as `split` takes them apart."""
        every = range(len(self.comparisons))
        parts = side_by_side(lambda n: self.residuals_of(n, points), every)
        if self.has_evidence:
            counts = [one.evidence for one in self.comparisons]
            ends = [part.shape[1] - count for part, count in zip(parts, counts, strict=True)]
            evidence = [part[:, end:] for part, end in zip(parts, ends, strict=True)]
            parts = [part[:, :end] for part, end in zip(parts, ends, strict=True)]
            parts += [self.noise * self.trust * part for part in evidence]
        if self._priors or self.is_informed:
            parts.append(self.prior_distances(points))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def residuals_of(self, recording: int, points: np.ndarray) -> np.ndarray:
        """Residuals (B, K) of a recording at points (B, d), evidence not yet weighed."""
        if self.answered is not None:
            return np.tile(self.answered[recording], (len(points), 1))
        found = self._compared(recording, points)
        if self.changes:
            values = self._by_name(points)
            for change in self.changes:
                found = found + change.residuals(values, recording)
        return found

    def _compared(self, n: int, points: np.ndarray) -> np.ndarray:
        """The same by the comparison alone; points that differ only for others are simulated once.

        The columns of a Jacobian over the unknowns that each recording has for itself do.
        """
        comparison = self.comparisons[n]
        if not self._each:
            return comparison.residuals(self.candidates(points, n), len(points))
        mine = points[:, list(self.places(n).values())]
        _, chosen, back = np.unique(mine, axis=0, return_index=True, return_inverse=True)
        found = comparison.residuals(self.candidates(points[chosen], n), len(chosen))
        return np.asarray(found[back.ravel()])

    def candidates(self, points: np.ndarray, recording: int = 0) -> dict[str, np.ndarray]:
        """Values (B,) by name, as a comparison takes them, of points (B, d)."""
        held = {name: np.full(len(points), value) for name, value in self.held.items()}
        own = {name: points[:, column] for name, column in self.places(recording).items()}
        return {**held, **own}

    def places(self, recording: int) -> dict[str, int]:
        """Columns of points, by name, of the unknowns on which a recording depends."""
        first = len(self._shared) + recording * len(self._each)
        columns = (*range(len(self._shared)), *range(first, first + len(self._each)))
        own = (*self._shared, *self._each)
        return {one.name: column for one, column in zip(own, columns, strict=True)}

    def from_box(self, points: np.ndarray) -> np.ndarray:
        """Points (B, d) of those (B, d) that a method sees which searches the box between bounds.

        The same, unless a study turns the box round.
        """
        return points

    def values(self, point: np.ndarray) -> dict[str, float]:
        """Held and free values by name at a point (d,)."""
        return {**self.held, **dict(zip(self.names, point.tolist(), strict=True))}

    def relative_misfit(self, cost: float) -> float:
        """Root of the ratio of the cost to the cost of an unresponsive twin: 0 is a perfect fit."""
        return float(np.sqrt(cost / sum(one.scale for one in self.comparisons)))

    @property
    def expected_misfit(self) -> float:
        """The relative misfit that the noise of the recordings alone leaves."""
        return self._mean_misfit([one.expected_misfit for one in self.comparisons])

    @property
    def recorded_misfit(self) -> float:
        """The same, with expected misfit and the noise that was measured on the recordings."""
        return self._mean_misfit(
            [math.hypot(one.expected_misfit, one.recorded_noise) for one in self.comparisons]
        )

    def _mean_misfit(self, misfits: Sequence[float]) -> float:
        """Root of the summed costs over the summed scales, of a misfit for each comparison."""
        scales = np.array([one.scale for one in self.comparisons])
        return float(np.sqrt(scales @ np.square(misfits) / scales.sum()))

    def smoothed(self) -> "Problem":
        """The same problem with smoothed misfits, whose basins are wide, or itself."""
        smooth = [one.smoothed() for one in self.comparisons]
        if any(one is None for one in smooth):
            return self
        return self.with_comparisons([one for one in smooth if one is not None])

    @property
    def is_smooth(self) -> bool:
        """Whether the misfits are smooth, those of the reference too."""
        return not self.lacks_forms and all(one.smoothed() is None for one in self.comparisons)

    def coarse(self) -> "Problem":
        """The same problem with the longer steps of its twins."""
        return self.with_comparisons([one.coarse() for one in self.comparisons])

    def refined(self) -> "Problem":
        """The same problem with the finer steps of its twins."""
        return self.with_comparisons([one.refined() for one in self.comparisons])

    @property
    def least_noise(self) -> float:
        """The least noise of the data: where equations are known besides, these know better.

        The residual of a closed loop beyond sensor noise is alike throughout the recording.
        """
        factor = self.comparisons[0].model_error if self.is_informed else 1.0
        return factor * self.comparisons[0].noise

    @property
    def lacks_forms(self) -> bool:
        """Whether only the reference has some forms of the actuator."""
        return any(one.unseen for one in self.comparisons)

    def sampled_first(self, instants: Sequence[float]) -> "Problem":
        """The same problem with first samples of the drive's loops, s after each start."""
        pairs = zip(self.comparisons, instants, strict=True)
        return self.with_comparisons([one.sampled_first(instant) for one, instant in pairs])

    def restarted(self) -> "Problem | None":
        """The same problem by stretches from recorded states, or None without states."""
        parts = [one.restarted() for one in self.comparisons]
        if any(one is None for one in parts):
            return None
        return self.with_comparisons([one for one in parts if one is not None])

    def with_comparisons(
        self, comparisons: Sequence[Comparison], changes: Sequence[ResidualChange] = ()
    ) -> "Problem":
        """The same problem with other comparisons of its recordings, and changes beside these."""
        other = copy.copy(self)
        other.comparisons, other.changes = tuple(comparisons), tuple(changes)
        other.answered = None
        return other

    def with_answer(self, residuals: Sequence[np.ndarray]) -> "Problem":
        """The same problem with residuals (K,) of each recording that no unknown moves."""
        other = copy.copy(self)
        other.answered = residuals
        return other

    def prior_distances(self, points: np.ndarray, informed: bool = True) -> np.ndarray:
        """Distances (B, P) from the means of the priors, in the unit of the residuals.

        Distances of further information (`informed`) follow if ``informed``.
        """
        z = points[:, self._priors]
        if self._logarithmic.any():
            z[:, self._logarithmic] = np.log(z[:, self._logarithmic])
        distances = self.noise * self.prior.distances(z)
        if self.information is not None and informed:
            known = self.information.distances(self._by_name(points))
            distances = np.hstack([distances, self.noise * known])
        return np.asarray(distances)

    def _by_name(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Values (B,) of all unknowns by name, held ones and those of each recording, of points."""
        held = {name: np.full(len(points), value) for name, value in self.held.items()}
        return {**held, **dict(zip(self.names, points.T, strict=True))}

    @property
    def is_informed(self) -> bool:
        """Whether something is known of the unknowns besides their priors."""
        return self.information is not None

    @property
    def is_told(self) -> bool:
        """Whether that holds all that the recordings show of faults."""
        return self.information is not None and self.information.whole

    def informed(self, information: Information) -> "Problem":
        """The same problem with further knowledge of its unknowns, which counts as a prior."""
        other = copy.copy(self)
        other.information = information
        return other

    @property
    def has_evidence(self) -> bool:
        """Whether further channels count beside those that a search sees."""
        return any(one.evidence for one in self.comparisons)

    def split(self, residuals: np.ndarray) -> Residuals:
        """Residuals (..., K) by where they come from; recordings in their order."""
        known = 0 if self.information is None else self.information.left.size
        priors = residuals.shape[-1] - len(self._priors) - known
        data = priors - sum(one.evidence for one in self.comparisons)
        return Residuals(
            residuals[..., :data], residuals[..., data:priors], residuals[..., priors:]
        )

    def weighed_anew(self, residuals: np.ndarray, other: "Problem") -> np.ndarray:
        """Residuals (K,) that another problem gives, which differs in noise and trust alone."""
        found = residuals.copy()
        parts, ratio = self.split(found), self.noise / other.noise
        parts.evidence[...] *= ratio * self.trust / other.trust
        parts.priors[...] *= ratio
        return found

    def data_cost(self, residuals: np.ndarray) -> float:
        """The sum of squares of the data in residuals (K,), without evidence and priors."""
        data = self.split(residuals).data
        return float(data @ data)

    def holding(self, values: Mapping[str, float]) -> "Problem":
        """The problem in which some of the free unknowns are held at values; not those ``@``."""
        free = [one for one in (*self._shared, *self._each) if one.name not in values]
        logs = {
            one.name: np.log(values[one.name]) if one.logarithmic else values[one.name]
            for one in self.unknowns
            if one.name in values
        }
        other = Problem(
            self.comparisons, free, held={**self.held, **values},
            own=[one.name for one in self._each],
            start=dict(zip(self.names, self.start, strict=True)), prior=self.prior.given(logs),
        )  # fmt: skip
        other.noise, other.trust = self.noise, self.trust
        other.model_error = self.model_error
        other.changes, other.answered = self.changes, self.answered
        other.information = self.information
        return other

    def with_noise(
        self, noise: float, *, trust: float | None = None, model_error: float | None = None
    ) -> "Problem":
        """The same problem with another level of noise; trust and model error where given."""
        other = copy.copy(self)
        other.noise = noise
        other.trust = self.trust if trust is None else trust
        other.model_error = self.model_error if model_error is None else model_error
        return other
