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
from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import InputError, ParameterError
from ematwin.estimation.latest import Latest
from ematwin.estimation.prior import Prior, coordinate
from ematwin.models.base import Model
from ematwin.models.chart import Chart
from ematwin.models.comparison import Comparison
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side
from ematwin.recordings.recording import Recording

_ROUNDING = 1e-12
_BESIDE = 0.1  # standard deviations of the prior


class Residuals(NamedTuple):
    """Residuals (..., K) by where they come from.

    ``data`` are the residuals that a search sees, ``evidence`` the residuals of further channels
    (`Comparison.with_evidence`), ``priors`` the distances from the prior means.
    """

    data: np.ndarray
    evidence: np.ndarray
    priors: np.ndarray


class _Unseen(NamedTuple):
    """An unknown on which only the reference depends.

    Attributes
    ----------
    unknown : Unknown
    around : float, where the reference was asked: the value, or its logarithm
    slopes : (K,) array for each recording, how residuals change with it
    """

    unknown: Unknown
    around: float
    slopes: list[np.ndarray]


class Information(NamedTuple):
    """What is known of unknowns: the density exp(-|left + root (z - z_0)|^2/2).

    Its last row is what stays of the residuals wherever the unknowns lie.

    Attributes
    ----------
    chart : Chart, of the unknowns
    z : (d,) array, coordinates z_0
    root : (k, d) array
    left : (k,) array
    """

    chart: Chart
    z: np.ndarray
    root: np.ndarray
    left: np.ndarray

    def distances(self, points: np.ndarray) -> np.ndarray:
        """(B, k), standard deviations, of points (B, d)."""
        return np.asarray(self.left + (self.chart.from_values(points) - self.z) @ self.root.T)


class _Secants(NamedTuple):
    """How the error of the fast model changes, by its values at other points.

    Attributes
    ----------
    chart : Chart, of the unknowns of the points
    z : (d,) array, coordinates of the point at which it is corrected
    shares : (d, m) array, of each other point in a step
    changes : of each recording (m, K), changes of residuals from here to the other points
    """

    chart: Chart
    z: np.ndarray
    shares: np.ndarray
    changes: list[np.ndarray]


class Problem:
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
        if not free:
            raise InputError("No unknown is left to search; name at least one, e.g. friction.")
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
        self.prior = known = Prior.independent(self.unknowns) if prior is None else prior
        names = [one.name for one in self.unknowns]
        self._priors = [names.index(name) for name in known.names]
        self._logarithmic = np.array([self.unknowns[n].logarithmic for n in self._priors], bool)
        self._prior_mean = known.mean
        # distances in standard deviations: the inverse root of the covariance
        self._whiten = np.linalg.inv(np.linalg.cholesky(known.covariance)).T
        self._latest = Latest()
        self._unseen: list[_Unseen] = []
        self._information: Information | None = None
        self._secants: _Secants | None = None
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
        backend: str = "cpu",
        **settings: Any,
    ) -> "Problem":
        """The problem that `ematwin.identify` solves; arguments as there.

        ``settings`` go to the comparison of the kind (`ematwin.models.base.Model.compare`).
        """
        chosen = load_actuator(actuator)
        model = model_of(chosen)
        free, fixed = unknowns_of(model, chosen, only, held)
        model.check_backend(backend)
        if backend != "cpu":
            settings["backend"] = backend
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

    def costs(self, points: np.ndarray, limits: np.ndarray | None = None) -> np.ndarray:
        """Sums of squares (B,) of points (B, d), priors included; infinite where one diverged.

        Costs above ``limits`` (B,) may be given as infinite.
        """
        if self.has_evidence or self._unseen or self._secants:
            residuals = self.residuals(points)
            squares = np.einsum("bk,bk->b", residuals, residuals)
            return np.where(np.isfinite(squares), squares, np.inf)
        cost: Any = 0.0
        if self._priors:
            away = self.prior_distances(points)
            cost = np.einsum("bk,bk->b", away, away)
        for n, comparison in enumerate(self.comparisons):
            candidates = self.candidates(points, n)
            if limits is None:
                part = comparison.costs(candidates, len(points))
            else:
                # what the others leave of the limit, and a little more: their sum is rounded
                with np.errstate(invalid="ignore"):  # infinite cost, infinite limit
                    rest = limits * (1.0 + _ROUNDING) - cost
                part = comparison.costs_within(candidates, len(points), rest)
            cost = cost + part
        return np.asarray(cost)

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """Weighted residuals (B, K) of points (B, d), as `split` takes them apart."""
        parts = [
            self._residuals_of(n, comparison, points)
            for n, comparison in enumerate(self.comparisons)
        ]
        if self.has_evidence:
            counts = [one.evidence for one in self.comparisons]
            ends = [part.shape[1] - count for part, count in zip(parts, counts, strict=True)]
            evidence = [part[:, end:] for part, end in zip(parts, ends, strict=True)]
            parts = [part[:, :end] for part, end in zip(parts, ends, strict=True)]
            parts += [self.noise * self.trust * part for part in evidence]
        if self._priors:
            parts.append(self.prior_distances(points))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def _residuals_of(self, n: int, comparison: Comparison, points: np.ndarray) -> np.ndarray:
        """Residuals (B, K) of a recording; points that differ only for others are simulated once.

        The columns of a Jacobian over the unknowns that each recording has for itself do.
        """
        candidates = self.candidates(points, n)
        found = self._seen_of(n, comparison, points, candidates)
        for one, around, slopes in self._unseen:
            moved = coordinate(one, candidates[one.name]) - around
            found = found + np.outer(moved, slopes[n])
        if self._secants is not None:
            chart, z, shares, changes = self._secants
            steps = (chart.from_values(self._every(chart, points)) - z) @ shares
            found = found + steps @ changes[n]
        return found

    def with_secants(
        self, z: np.ndarray, others: "Sequence[tuple[np.ndarray, Problem]]", errors: np.ndarray
    ) -> "Problem":
        """The same problem, in which the error of the fast model changes as it did elsewhere.

        Parameters
        ----------
        z : (d,) array, coordinates where it is corrected
        others : coordinates and problems that are corrected there
        errors : (d,) array, in which steps are measured
        """
        away = np.array([(there - z) / errors for there, _ in others])
        points = self.chart.to_values(np.array([there for there, _ in others]))
        changes = [
            np.array(
                [
                    one._residuals_of(n, one.comparisons[n], point[None])[0]
                    - self._residuals_of(n, self.comparisons[n], point[None])[0]
                    for (_, one), point in zip(others, points, strict=True)
                ]
            )
            for n in range(len(self.comparisons))
        ]
        other = copy.copy(self)
        shares = np.linalg.pinv(away, rcond=1e-3) / errors[:, None]
        other._secants = _Secants(self.chart, z, shares, changes)
        return other

    def _seen_of(
        self, n: int, comparison: Comparison, points: np.ndarray, candidates: dict[str, np.ndarray]
    ) -> np.ndarray:
        """The same by the comparison alone."""
        if not self._each:
            return self._latest.residuals(comparison, candidates, len(points))
        first = len(self._shared) + n * len(self._each)
        mine = np.r_[0 : len(self._shared), first : first + len(self._each)]
        _, chosen, back = np.unique(points[:, mine], axis=0, return_index=True, return_inverse=True)
        found = comparison.residuals(self.candidates(points[chosen], n), len(chosen))
        return np.asarray(found[back.ravel()])

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
        """Root of the ratio of the cost to the cost of an unresponsive twin: 0 is a perfect fit."""
        return float(np.sqrt(cost / sum(one.scale for one in self.comparisons)))

    def noise_at(self, misfit: float) -> float:
        """Standard deviation of an independent residual that leaves a relative misfit."""
        scale = sum(one.scale for one in self.comparisons)
        return misfit * math.sqrt(scale / sum(one.independent for one in self.comparisons))

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
        return self._with([one for one in smooth if one is not None])

    def coarse(self) -> "Problem":
        """The same problem with the longer steps of its twins."""
        return self._with([one.coarse() for one in self.comparisons])

    def refined(self) -> "Problem":
        """The same problem with the finer steps of its twins."""
        return self._with([one.refined() for one in self.comparisons])

    def corrected(self, point: np.ndarray, like: "Problem | None" = None) -> "Problem | None":
        """The same problem, corrected by the reference minus the fast model at a point (d,).

        The correction is linear in unknowns that the fast model does not have. Slopes come from
        ``like``, which was corrected before, or take an answer of the reference each.
        The noise is what recordings are expected to leave beside the reference. None where a
        recording has no reference, or the reference diverged.
        """
        unseen = [one for one in self._shared if one.name in self.comparisons[0].unseen]
        values = self.values(point)
        first = self._missed(point, {})
        if first is None:
            return None
        other = self._without(first)
        for k, one in enumerate(unseen):
            now = coordinate(one, values[one.name])
            if like is not None:
                slopes = like._unseen[k].slopes
            else:
                there = _likely(one, values[one.name], self.prior)
                missed = self._missed(point, {one.name: there})
                if missed is None:
                    return None
                far = coordinate(one, there) - now
                slopes = other._changes(self._without(missed), point, far)
            other._unseen.append(_Unseen(one, now, slopes))
        return other

    @property
    def least_noise(self) -> float:
        """The least noise of the data: where equations are known besides, these know better.

        What a closed loop leaves beyond sensor noise is alike throughout the recording.
        """
        factor = self.comparisons[0].model_error if self.is_informed else 1.0
        return factor * self.comparisons[0].noise

    @property
    def lacks_forms(self) -> bool:
        """Whether only the reference has some forms of the actuator."""
        return any(one.unseen for one in self.comparisons)

    def searched(self) -> "Problem":
        """The same problem as a search sees it.

        Where the fast model lacks forms of the actuator, it is corrected at healthy values first:
        minima of the fast model alone belong to another actuator.
        """
        if not self.lacks_forms:
            return self
        return self.corrected(self.start) or self

    def scatter(self, point: np.ndarray) -> float:
        """The relative misfit by which the reference differs from one candidate to the next.

        Behind sampled loops they do: a small change moves samples, and these the impacts in a gap.
        A recording is one such answer. The candidates are a point (d,) and one beside it, within a
        tenth of a standard deviation of its prior; 0 where the kind has no reference.
        """
        here = self.corrected(point)
        if here is None:
            return 0.0
        sides = np.random.default_rng(0).choice([-1.0, 1.0], len(self._priors))
        moves = _BESIDE * sides * np.sqrt(np.diag(self.prior.covariance))
        near = point.copy()
        near[self._priors] = np.where(
            self._logarithmic, point[self._priors] * np.exp(moves), point[self._priors] + moves
        )
        beside = self.corrected(np.clip(near, self.lower, self.upper), here)
        if beside is None:
            return 0.0
        change = here.data_cost(beside.residuals(point[None])[0] - here.residuals(point[None])[0])
        return self.relative_misfit(0.5 * change)

    def of_fast_model(self) -> "Problem":
        """The same problem where the recordings are of the fast model: a correction is nothing."""
        if not self.comparisons[0].has_reference:
            return self
        every = [one.measured() for one in self.comparisons]
        return self._without([{n: np.zeros_like(x) for n, x in one.items()} for one in every])

    def _missed(
        self, point: np.ndarray, moved: Mapping[str, float]
    ) -> list[Mapping[str, np.ndarray]] | None:
        """Reference minus fast model, per recording, at a point (d,) with some values ``moved``.

        None where a recording has no reference, or the reference diverged.
        """

        def missed(n: int) -> Mapping[str, np.ndarray] | None:
            beside = {name: float(x[0]) for name, x in self.candidates(point[None], n).items()}
            try:
                found = self.comparisons[n].missed({**beside, **moved})
            except ParameterError:  # a sampled loop that is unstable there
                return None
            if found is None or not all(np.isfinite(trace).all() for trace in found.values()):
                return None
            return found

        every = side_by_side(missed, range(len(self.comparisons)))
        known = [one for one in every if one is not None]
        return known if len(known) == len(every) else None

    def _without(self, missed: Sequence[Mapping[str, np.ndarray]]) -> "Problem":
        """The same problem with that taken off each recording, and the noise that is left then."""
        pairs = zip(self.comparisons, missed, strict=True)
        other = self._with([one.with_missed(by_channel) for one, by_channel in pairs])
        other.model_error = 1.0  # until a discrepancy shows (`with_discrepancy`)
        return other.with_noise(other.comparisons[0].noise)

    def _changes(self, other: "Problem", point: np.ndarray, far: float) -> list[np.ndarray]:
        """Change of residuals (K,) of each recording from this problem to another, per ``far``."""
        return [
            (
                other.comparisons[n].residuals(self.candidates(point[None], n), 1)[0]
                - mine.residuals(self.candidates(point[None], n), 1)[0]
            )
            / far
            for n, mine in enumerate(self.comparisons)
        ]

    def restarted(self) -> "Problem | None":
        """The same problem by stretches from recorded states, or None without states."""
        parts = [one.restarted() for one in self.comparisons]
        if any(one is None for one in parts):
            return None
        return self._with([one for one in parts if one is not None])

    def _with(self, comparisons: Sequence[Comparison]) -> "Problem":
        other = copy.copy(self)
        other.comparisons, other._unseen, other._secants = tuple(comparisons), [], None
        return other

    def prior_distances(self, points: np.ndarray, informed: bool = True) -> np.ndarray:
        """Distances (B, P) from the means of the priors, in the unit of the residuals.

        And those of what is known besides, unless not ``informed``.
        """
        away = points[:, self._priors]
        if self._logarithmic.any():
            away[:, self._logarithmic] = np.log(away[:, self._logarithmic])
        distances = self.noise * ((away - self._prior_mean) @ self._whiten)
        if self._information is not None and informed:
            every = self._every(self._information.chart, points)
            distances = np.hstack([distances, self.noise * self._information.distances(every)])
        return np.asarray(distances)

    def _every(self, chart: Chart, points: np.ndarray) -> np.ndarray:
        """Values (B, n) of the unknowns of a chart, free and held ones, at points (B, d)."""
        free = dict(zip(self.names, points.T, strict=True))
        held = {name: np.full(len(points), value) for name, value in self.held.items()}
        return np.array([{**held, **free}[one.name] for one in chart.unknowns]).T

    @property
    def is_informed(self) -> bool:
        """Whether something is known of the unknowns besides their priors."""
        return self._information is not None

    def informed(self, information: Information) -> "Problem":
        """The same problem with what is known of its unknowns besides; it counts as a prior."""
        other = copy.copy(self)
        other._information = information
        return other

    @property
    def has_evidence(self) -> bool:
        """Whether further channels count beside those that a search sees."""
        return any(one.evidence for one in self.comparisons)

    def split(self, residuals: np.ndarray) -> Residuals:
        """Residuals (..., K) by where they come from; recordings in their order."""
        known = 0 if self._information is None else self._information.left.size
        priors = residuals.shape[-1] - len(self._priors) - known
        data = priors - sum(one.evidence for one in self.comparisons)
        return Residuals(
            residuals[..., :data], residuals[..., data:priors], residuals[..., priors:]
        )

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
        other.noise, other.trust, other._latest = self.noise, self.trust, self._latest
        other.model_error = self.model_error
        other._unseen, other._information = self._unseen, self._information
        other._secants = self._secants
        return other

    def with_noise(self, noise: float) -> "Problem":
        """The same problem with another level of noise."""
        other = copy.copy(self)
        other.noise = noise
        return other

    def with_discrepancy(self, cost: float, scatter: float) -> "Problem":
        """The same problem, where noise and scatter explain but a part of the cost at a minimum.

        The rest, the discrepancy, is alike throughout a recording: standard errors that take it for
        noise are too small by the factor that the kind states (`Comparison.model_error`).

        Parameters
        ----------
        cost : of the data at the minimum
        scatter : what of it impacts and ripple of the reference leave
        """
        scale = sum(one.scale for one in self.comparisons)
        left = max(0.0, cost - self.recorded_misfit**2 * scale - scatter)
        share = left / cost if left else 0.0
        other = self.with_noise(self.noise)
        other.model_error = math.sqrt(1.0 - share + share * self.comparisons[0].model_error ** 2)
        return other

    def weighed(self, residuals: np.ndarray, least_noise: float = 0.0) -> "Problem":
        """The same problem with the noise that residuals (K,) at a good point show.

        Evidence counts by the noise of its channels, where that is more than was expected.
        """
        left = self.split(residuals)
        other = self.with_noise(max(self.noise_of(left.data), least_noise))
        if self.has_evidence:
            count = sum(one.independent for one in self.comparisons if one.evidence)
            unit = self.noise * self.trust
            found = float(np.sqrt(left.evidence @ left.evidence / count)) / unit
            other.trust = 1.0 / max(1.0, found)
        return other

    def reweighed(self, point: np.ndarray) -> "Problem | None":
        """The problem with each channel weighed by the noise that a good point (d,) leaves of it.

        None where nothing changes.
        """
        parts = [
            one.reweighed(self._residuals_of(n, one, point[None])[0])
            for n, one in enumerate(self.comparisons)
        ]
        if all(new is old for new, old in zip(parts, self.comparisons, strict=True)):
            return None
        return self._with(parts).with_noise(parts[0].noise)

    def noise_of(self, data: np.ndarray) -> float:
        """Standard deviation of an independent residual, from those that are left, (K,)."""
        scale = sum(one.scale for one in self.comparisons)
        independent = sum(one.independent for one in self.comparisons)
        return float(np.sqrt((data @ data) / independent)) or 1e-9 * float(np.sqrt(scale))


def _likely(one: Unknown, value: float, prior: Prior) -> float:
    """A value one standard deviation from another: impacts make shorter differences rough."""
    spread = 0.1 if one.logarithmic else 0.1 * one.width
    if one.name in prior.names:
        n = prior.names.index(one.name)
        spread = math.sqrt(prior.covariance[n, n])
    sign = 1.0 if one.upper - value >= value - one.lower else -1.0
    moved = value * math.exp(sign * spread) if one.logarithmic else value + sign * spread
    return min(max(moved, one.lower), one.upper)


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
    every = [one for one in model.unknowns(actuator) if one.role in ("fault", "nuisance")]
    own = [one for one in every if not one.marginal]
    if only is None:
        free = own
    else:
        wanted = [model.unknown(actuator, name) for name in dict.fromkeys(only)]
        if not wanted:
            raise InputError("No fault is left to search; name at least one, e.g. friction.")
        names = {one.name for one in wanted}
        # nuisances stay free: a load that was not recorded is unknown whatever is searched
        free = [one for one in own if one.name in names or one.role == "nuisance"]
        free += [one for one in wanted if one.role == "nominal" or one.marginal]
        unsearchable = [one.name for one in wanted if one.role == "symptom"]
        if unsearchable:
            raise InputError(
                f"{unsearchable[0]} is derived from what the twin leaves unexplained and cannot be "
                "searched; use ematwin detect."
            )
    left_out = {one.name for one in free}
    left_out |= {one.name for one in model.unknowns(actuator) if one.role == "symptom"}
    # held at healthy by nobody's wish: these join where intervals are formed
    asked = set(held) if isinstance(held, Mapping) else set()
    left_out |= {one.name for one in every if one.marginal and one.name not in asked}
    fixed = {**values, **places}
    return free, {name: value for name, value in fixed.items() if name not in left_out}
