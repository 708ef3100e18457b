"""The least squares of all equations along recorded motions, with the priors of all unknowns.

By Gauss-Newton steps within bounds, whose slopes follow the residuals between fresh ones (Broyden
1965). Residuals of a motion that was not recorded are regressed on points around instead
(`ematwin.estimation.followed_motion`). What an equation leaves beyond noise at the end is a
discrepancy (`Remainder`).
"""

import math
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ematwin.estimation.aliases import Aliases, Direction, directions
from ematwin.estimation.constants import DECIDES, WORSE
from ematwin.estimation.descent import TooFarError
from ematwin.estimation.equations import candidate, found_first_sample, lefts_of, with_secant
from ematwin.estimation.laplace import principal
from ematwin.estimation.levenberg_marquardt import NOTHING
from ematwin.estimation.prior import Information, Remainder
from ematwin.estimation.problem import Problem
from ematwin.models.comparison import correlation_time
from ematwin.models.optional import FIRST_SAMPLE, Candidate, Equation
from ematwin.models.parameter_set import ParameterSet
from ematwin.numerics.linear_algebra import bounded_squares
from ematwin.numerics.side_by_side import in_blocks, side_by_side

_STEP = 1e-3  # of a coordinate: priors are smooth
_SHARES = (1.0, 0.3, 0.1)  # of a step that are tried where it promises much
_SLOWER = 0.5  # of the gain before: by less than that secants no longer agree with the equations


def values_at(problem: Problem, z: np.ndarray) -> list[dict[str, float]]:
    """Values by name for each recording at coordinates (1, d)."""
    point = problem.chart.to_values(z)
    return [
        {name: float(x[0]) for name, x in problem.candidates(point, n).items()}
        for n in range(len(problem.comparisons))
    ]


class Along(NamedTuple):
    """An equation along the motion of the nth recording."""

    recording: int
    equation: Equation

    @property
    def name(self) -> tuple[int, str]:
        """Of the equation among those of all recordings."""
        return self.recording, self.equation.name


def nearer(
    every: Sequence[Along], problem: Problem, z: np.ndarray,
    known: Mapping[tuple[int, str], Remainder], ahead: bool = False,
) -> list[Along]:  # fmt: skip
    """Equations at coordinates (1, d), by noise ``known`` of them, or for a nearer estimate."""
    values, noises = values_at(problem, z), {name: one.noise for name, one in known.items()}
    return [
        Along(n, one.at(values[n], noises.get((n, one.name)), ahead) if one.at else one)
        for n, one in every
    ]


class MotionFit:
    """Some equations with their priors; a fit begins at coordinates ``z`` (1, d)."""

    def __init__(
        self,
        actuator: ParameterSet,
        problem: Problem,
        z: np.ndarray,
        every: Sequence[Along],
        known: Mapping[tuple[int, str], Remainder],
        aliases: Aliases,
        held: Collection[str] = (),
        information: np.ndarray | None = None,
    ) -> None:
        self._actuator, self._problem, self.every, self._aliases = actuator, problem, every, aliases
        self.information = information  # (d, d), as is known so far
        # of loops, s; 0 if unknown
        self.first_samples = [one.recording.first_sample for one in problem.comparisons]
        self._matters = [_matters(one, actuator, problem) for one in every]
        # equations along one motion that was not recorded take the same candidates
        self._given = [own.copy() for own in self._matters]
        for one, given in zip(every, self._given, strict=True):
            for other, places in zip(every, self._matters, strict=True):
                if one.equation.noise and one.recording == other.recording:
                    given |= places
        point = problem.chart.to_values(z)[0]
        stable = [self.candidate(n, point) or (actuator, {}) for n in range(len(every))]
        pairs = zip(every, stable, strict=True)
        lefts = side_by_side(lambda pair: pair[0].equation.left(*pair[1]), pairs)
        self._counts = [each.size for each in lefts]
        ends = np.cumsum(self._counts).tolist()
        self._parts = [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]
        self._known = [known.get(one.name) for one in every]
        # an error of the equations is the same in each recording: no mean of several makes it less
        alike = [math.sqrt(len(problem.comparisons)) * x.equation.alike(actuator) for x in every]
        # what noise and their own errors leave of equations, before a fit
        self._remainders = [
            before
            or Remainder(0.0, one.least(actuator) * one.size, share * one.size, 1.0, one.noise)
            for before, (_, one), share in zip(self._known, every, alike, strict=True)
        ]
        self._scales = [1.0 / one.deviation(one.norm) for one in self._remainders]
        # of a coordinate: ripple is another at each value, and slopes have to stand out from it
        self._steps = [max(one.equation.step, 3.0 * x) for one, x in zip(every, alike, strict=True)]
        matters = {name: n for places in self._matters for name, n in places.items()}
        self.free = matters.keys() - {*held}
        self._free = np.array(sorted({matters[name] for name in self.free}), dtype=int)
        self._last: Any = None  # residuals (K,), and slopes (f, K), where a descent ended
        self._fresh = False  # these slopes
        self._weights: list[Any] = [one.weights for one in self._remainders]  # of residuals

    def descended(self, z: np.ndarray, most: float = math.inf, rough: bool = False) -> np.ndarray:
        """Coordinates (1, d) of least squares next to others, within bounds.

        A descent begins with the slopes of the one before, and ends with fresh ones; a ``rough``
        one where secants promise no more. `TooFarError` if more than ``most`` squared standard
        deviations would be left by twice the gain that fresh slopes promise.
        """
        chart, free = self._problem.chart, self._free
        here, fresh = self.residuals(z), self._fresh
        if self._last is None:
            self._last, fresh = (here, self._slopes(z, here)), True
            self._weigh()
            here = self._last[0]
        slopes, before = self._last[1], math.inf
        for _ in range(30):  # at most; mostly ten, as the equations are nearly linear
            step = self._least(z, here, slopes)
            least, cost = here + step[free] @ slopes, float(here @ here)
            promised = cost - float(least @ least)
            if fresh and cost - 2.0 * promised > most:
                raise TooFarError
            gained, moves = 0.0, fresh or promised > NOTHING
            for share in _SHARES if moves else ():
                tried, left = self._corrected(chart.project(z + share * step), slopes, cost)
                gained = cost - float(left @ left)
                if gained > 0.0 or promised < DECIDES:
                    break
            if gained > 0.0:
                moved, change = (tried - z)[0, free], left - here
                z, here = tried, left
            if gained > NOTHING:
                slopes, fresh = with_secant(slopes, moved, change), False
                slower, before = gained > _SLOWER * before, gained
                if not slower:
                    continue
            elif fresh or (rough and (gained > 0.0 or not moves)):
                break  # slopes of so short a step would be those of ripple
            slopes, fresh, before = self._slopes(z, here), True, math.inf
        if not fresh and not rough:
            slopes, fresh = self._slopes(z, here), True
        self._last, self._fresh = (here, slopes), fresh
        return z

    def _corrected(self, z: np.ndarray, slopes: np.ndarray, cost: float) -> tuple[Any, Any]:
        """Coordinates (1, d) after a step, and their residuals (K,).

        A straight step leaves a minimum that is narrow and curved: where it costs more than before,
        its residuals correct it (second-order correction; Fletcher 1982, Lecture Notes in
        Mathematics 912, 85-114).
        """
        left, height = self.residuals(z), math.inf
        while cost <= left @ left < height:
            height = _SLOWER * float(left @ left)
            z = self._problem.chart.project(z + self._least(z, left, slopes))
            left = self.residuals(z)
        return z, left

    def _least(self, z: np.ndarray, here: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Step (d,) from coordinates (1, d) with residuals (K,) to their least squares."""
        chart, free, step = self._problem.chart, self._free, np.zeros(z.shape[1])
        low, high = (chart.lower - z[0])[free], (chart.upper - z[0])[free]
        step[free] = bounded_squares(slopes.T, -here, low, high)
        return step

    @property
    def cost(self) -> float:
        """Squared standard deviations that are left where a fit ended."""
        return float(self._last[0] @ self._last[0])

    def evidence(self, z: np.ndarray) -> Information:
        """What the equations tell at coordinates (1, d) at which `descended` ended."""
        self.counts_more()
        here, slopes = (one[..., : self._parts[-1].stop] for one in self._last)
        rotation, root = np.linalg.qr(slopes.T)
        every = np.zeros((self._free.size + 1, z.shape[1]))
        every[:-1, self._free] = root
        moved = rotation.T @ here
        beyond = math.sqrt(max(0.0, float(here @ here - moved @ moved)))
        # of recorded currents: in the gap few samples of small angles count
        point = self._problem.chart.to_values(z)[0]
        unexplained = 0.0
        for n, (rest, one) in enumerate(zip(self._remainders, self.every, strict=True)):
            if rest.norm > WORSE * rest.least and one.equation.judged:
                unexplained = max(unexplained, rest.norm / one.equation.size)
            elif at := self.candidate(n, point):
                unexplained = max(unexplained, one.equation.unexplained(*at))
        # what no sensor makes is alike throughout, as errors of the model are
        share = max(one.equation.discrepancy for one in self.every)
        wider = math.sqrt(1.0 + share * (self._problem.model_error**2 - 1.0))
        chart, every, left = self._problem.chart, every / wider, np.append(moved, beyond) / wider
        remainders = {one.name: x for one, x in zip(self.every, self._remainders, strict=True)}
        return Information(chart, z[0], every, left, remainders, unexplained, wider)

    def counts_more(self) -> bool:
        """Count as discrepancies what equations leave beyond noise where a descent ended.

        Where the other fit leaves more, what is left here counts. Whether that is so anywhere.
        """
        more = False
        for n, (known, part) in enumerate(zip(self._known, self._parts, strict=True)):
            norm = float(np.linalg.norm(self._last[0][part])) / self._scales[n]
            weights = self._weights[n]
            self._remainders[n] = left = self._remainders[n]._replace(norm=norm, weights=weights)
            self._rescale(n, left.deviation(norm if known is None else min(norm, known.norm)))
            more |= known is not None and norm < known.norm
        return more

    def _rescale(self, n: int, deviation: float) -> None:
        """Weigh the nth equation by another standard deviation, its last residuals too."""
        ratio, part = 1.0 / deviation / self._scales[n], self._parts[n]
        self._scales[n] = 1.0 / deviation
        for one in self._last:
            one[..., part] *= ratio

    def finds_first_samples(self, z: np.ndarray) -> bool:
        """Find when loops sampled first, near coordinates (1, d) at which `descended` ended.

        Whether that explains more of a recording than another instant may by chance.
        """
        here, slopes = self._last
        basis, found = np.linalg.qr(slopes.T)[0], False
        point = self._problem.chart.to_values(z)[0]
        for m in range(len(self.first_samples)):
            sampled = [
                n for n, one in enumerate(self.every)
                if one.recording == m and one.equation.first_samples(self._actuator)
            ]  # fmt: skip
            if self.first_samples[m] or not sampled:
                continue

            def costs(instants: Sequence[float], own: Sequence[int] = sampled) -> list[float]:
                lefts = np.tile(here, (len(instants), 1))
                for n in own:
                    tries = [self.candidate(n, point, one) for one in instants]
                    lefts[:, self._parts[n]] = in_blocks(partial(self.scaled, n), tries, 1)
                return (np.sum(lefts**2, axis=1) - np.sum((lefts @ basis) ** 2, axis=1)).tolist()

            instants = self.every[sampled[0]].equation.first_samples(self._actuator)
            instant = found_first_sample(costs, instants)
            with_it, without = costs([instant, 0.0])
            if with_it < without - DECIDES:
                self.first_samples[m], found, self._fresh = instant, True, False
        return found

    def _slopes(self, z: np.ndarray, here: np.ndarray) -> np.ndarray:
        """(f, K), of residuals (K,) at coordinates (1, d), by those that matter.

        Known directions are not differenced: ripple would tell a fault from the parameter that it
        multiplies.
        """
        chart, free = self._problem.chart, self._free
        same, asked = self._known_slopes(z)

        def along(one: tuple[int, np.ndarray]) -> tuple[np.ndarray, np.ndarray] | None:
            """A step (f,), and the change (K,) of the residuals."""
            n, way = one
            for side in (1.0, -1.0):
                beside = chart.project(z + side * way)
                (left,) = self.scaled(n, [self.candidate(n, chart.to_values(beside)[0])])
                if left is not None and not np.array_equal(beside, z):
                    return (beside - z)[0, free], left - here[self._parts[n]]
            return None

        ways = [(n, way) for n, some in enumerate(asked) for way in self._ways(n, some, z[0])]
        changes = side_by_side(along, ways)
        found = np.zeros((free.size, here.size))
        for n, some in enumerate(asked):
            pairs = zip(ways, changes, strict=True)
            own = [change for (each, _), change in pairs if each == n and change is not None]
            if own:  # else a loop is unstable beside this point, whatever changes
                moved, changed = (np.array(each) for each in zip(*own, strict=True))
                slopes = np.linalg.lstsq(moved[:, some], changed, rcond=None)[0]
                found[some, self._parts[n]] = slopes
        return self._with_known(found, z, here, same)

    def _known_slopes(self, z: np.ndarray) -> tuple[list[dict[int, Direction]], list[np.ndarray]]:
        """Known directions of each equation by their pivot, and rows of all that are differenced.

        The free unknowns by which an equation changes, without pivots.
        """
        point, free = self._problem.chart.to_values(z)[0], self._free
        known = directions(self._problem, point, self._aliases)
        same = [
            {
                one.pivot: one
                for one in known
                if {one.pivot, *one.others} <= {*places.values()} & {*free.tolist()}
            }
            for places in self._matters
        ]
        asked = [
            np.flatnonzero(np.isin(free, [*({*places.values()} - mine.keys())]))
            for places, mine in zip(self._matters, same, strict=True)
        ]
        return same, asked

    def _with_known(
        self, found: np.ndarray, z: np.ndarray, here: np.ndarray,
        same: Sequence[Mapping[int, Direction]],
    ) -> np.ndarray:  # fmt: skip
        """Slopes (f, K) with those along known directions, and of the priors."""
        chart, free, last = self._problem.chart, self._free, self._parts[-1].stop
        for part, mine in zip(self._parts, same, strict=True):
            for pivot, one in mine.items():
                found[np.searchsorted(free, pivot), part] = one.same[free] @ found[:, part]
        steps = np.where(z[0, free] + _STEP <= chart.upper[free], _STEP, -_STEP)
        beside = np.tile(z, (free.size, 1))
        beside[np.arange(free.size), free] += steps
        found[:, last:] = (self._priors(chart.to_values(beside)) - here[last:]) / steps[:, None]
        self._learn(found)
        return found

    def _learn(self, slopes: np.ndarray) -> None:
        """Take the information (d, d) from slopes (f, K)."""
        self.information = np.zeros((self._problem.chart.lower.size,) * 2)
        self.information[np.ix_(self._free, self._free)] = slopes @ slopes.T

    def _ways(self, n: int, some: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(m, d) steps along which the nth equation is differenced, by some of the free unknowns.

        Where they are known, the principal directions of the width: what unknowns that compensate
        each other leave together is small beside what each of them changes.
        """
        chart, step, own = self._problem.chart, self._steps[n], self._free[some]
        ways = np.zeros((own.size, z.size))
        known = self.information
        if known is None or not (np.diag(known)[own] > 0.0).all():
            ways[:, own] = step * np.eye(own.size)
            return ways
        ways[:, own] = principal(
            known[np.ix_(own, own)], z[own], chart.lower[own], chart.upper[own]
        )
        # products of unknowns bend what is the same along straight lines
        return ways * (step / np.abs(ways).max(axis=1, keepdims=True))

    def _weigh(self) -> None:
        """Weigh equations anew by independent samples of their noise.

        The unknowns of an equation explain most of its residual at a start that is far away.
        """
        here, slopes = self._last
        for n, part in enumerate(self._parts):
            if self._known[n] is None:
                step = np.linalg.lstsq(slopes[:, part].T, here[part], rcond=1e-9)[0]
                left = here[part] - step @ slopes[:, part]
                independent = left.size / correlation_time(left)
                self._remainders[n] = one = self._remainders[n]._replace(independent=independent)
                self._rescale(n, one.deviation(one.norm))

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """(K,), in standard deviations, at (1, d), priors last; infinite if a loop is unstable."""
        point = self._problem.chart.to_values(z)[0]

        def left(n: int) -> np.ndarray:
            (found,) = self.scaled(n, [self.candidate(n, point)])
            return np.full(self._counts[n], np.inf) if found is None else found

        parts = side_by_side(left, range(len(self.every)))
        return np.concatenate([*parts, self._priors(point[None])[0]])

    def _priors(self, points: np.ndarray) -> np.ndarray:
        """(B, k), in standard deviations, at points (B, d)."""
        return np.asarray(self._problem.prior_distances(points) / self._problem.noise)

    def candidate(self, n: int, point: np.ndarray, first: float | None = None) -> Candidate | None:
        """The nth equation's at a point (d,), with loops that sampled ``first``, s, or as found."""
        first = self.first_samples[self.every[n].recording] if first is None else first
        values = {name: float(point[m]) for name, m in self._given[n].items()}
        return candidate(self._actuator, {FIRST_SAMPLE: first, **values})

    def scaled(self, n: int, candidates: Sequence[Candidate | None]) -> list[np.ndarray | None]:
        """Residuals of the nth equation with each candidate, in standard deviations."""
        scales = self._scales[n] * self._weights[n]
        lefts = lefts_of(self.every[n].equation, candidates)
        return [None if left is None else scales * left for left in lefts]


def _matters(along: Along, actuator: ParameterSet, problem: Problem) -> dict[str, int]:
    """Places among the free unknowns, by name, of those on which an equation depends."""
    one = along.equation
    stated = (place for form in one.forms if form.is_stated(actuator) for place in form.fitted)
    mine = {*one.fitted, *stated, *one.unknowns}
    return {name: n for name, n in problem.places(along.recording).items() if name in mine}
