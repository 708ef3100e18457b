"""Life left: the time until a magnitude passes its limit, or the actuator no longer does its job.

From the posterior of level, slope and acceleration (`ematwin.fleet.trend`) the wear goes on as one
of two processes with that slope and that variance per year: a Wiener process, whose first passage
has an inverse Gaussian distribution where slope and level are known (Folks and Chhikara 1978,
J. R. Stat. Soc. B 40, 263-289), or a gamma process, which never goes back (van Noortwijk 2009,
Reliab. Eng. Syst. Saf. 94, 2-21). The evidence of the fleet's increments decides which.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import gamma, norm

from ematwin.errors import InputError
from ematwin.fleet.trend import Trend
from ematwin.models.registry import model_of
from ematwin.models.simulating import simulate

HORIZON = 10.0  # years; what lives longer is said to live longer than this
DRAWS = 1000
LEVEL = 0.8  # probability of the interval of life left, as prognostics states it
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(15)


@dataclass(frozen=True)
class Life:
    """A distribution of the life that is left."""

    name: str  # the magnitude, or the requirement, that ends it
    draws: np.ndarray  # (N,) array, years from ``moment``; infinite beyond `HORIZON`
    moment: float  # years, when it is asked

    def within(self, years: float) -> float:
        """Probability that it ends within a time."""
        return float(np.mean(self.draws <= years))

    def quantile(self, share: float) -> float:
        """Years within which it ends with a probability; infinite beyond the horizon."""
        return float(np.quantile(self.draws, share, method="inverted_cdf"))

    @property
    def median(self) -> float:
        """Years."""
        return self.quantile(0.5)

    @property
    def interval(self) -> tuple[float, float]:
        """Years, between which it ends with a probability of 80 %."""
        return self.quantile(0.5 - LEVEL / 2.0), self.quantile(0.5 + LEVEL / 2.0)

    def __str__(self) -> str:
        low, high = self.interval
        if high == 0.0:
            return "none: beyond the limit"
        if math.isinf(self.median):
            least = "" if math.isinf(low) else f", {spoken(low)} at the least (90 %)"
            return spoken(math.inf) + least
        return f"{spoken(self.median)} (80 %: {spoken(low)} to {spoken(high)})"


def spoken(years: float) -> str:
    """A time in the unit that people would use."""
    if math.isinf(years):
        return f"more than {HORIZON:g} years"
    days = 365.25 * years
    if days < 1.0:
        return "0 days" if days <= 0.0 else "less than a day"
    if days < 60.0:
        return f"{days:.0f} day{'s' * (days >= 1.5)}"
    return f"{12.0 * years:.0f} months" if years < 2.0 else f"{years:.1f} years"


class Paths(NamedTuple):
    """Levels to come."""

    ahead: np.ndarray  # (K,) array, years after the moment, the first 0
    level: np.ndarray  # (draws, K) array
    variance: np.ndarray  # (draws, 1) array, of the increments per year


def paths(
    one: Trend, moment: float, process: str, *, horizon: float = HORIZON, draws: int = DRAWS,
    seed: int = 1,
) -> Paths:  # fmt: skip
    """Levels to come after a moment, years, with each draw of the fleet's variances.

    ``process`` is "wiener" or "gamma".
    """
    generator = np.random.default_rng(seed)
    ahead = np.concatenate([[0.0], np.geomspace(1.0 / 365.25, horizon, 60)])
    states = [
        (of.q_level, of.q_slope, mean, cov, np.tile(of.bend(ahead)[1], (len(mean), 1)))
        for of, mean, cov in one.later(max(0.0, moment - one.time))
    ]
    q_level, q_slope, mean, cov, climb = map(np.concatenate, zip(*states, strict=True))
    # of each law as many paths as it has draws, in an order that other magnitudes do not share
    which = generator.permutation(np.arange(draws) * len(mean) // draws)
    q_level, q_slope, climb = q_level[which, None], q_slope[which, None], climb[which]
    least = 1e-15 * np.trace(cov, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    root = np.linalg.cholesky(cov + least)
    deviates = generator.standard_normal((draws, 3))
    start = mean[which] + np.einsum("nij,nj->ni", root[which], deviates)
    dt = np.diff(ahead)
    wander = np.sqrt(q_slope * dt) * generator.standard_normal((draws, dt.size))
    drift = start[:, 1:2] + np.cumsum(wander, axis=1)
    drift += start[:, 2:] * np.diff(climb, axis=1) / dt
    variance = q_level * dt
    if process == "gamma":
        direction = 1.0 if one.mean[1] >= 0.0 else -1.0
        speed = np.maximum(direction * drift, 0.0)  # what is worn does not heal
        shape = (speed * dt) ** 2 / variance
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(speed > 0.0, variance / (speed * dt), 0.0)
        steps = direction * generator.standard_gamma(np.maximum(shape, 1e-12)) * scale
    else:
        steps = drift * dt + np.sqrt(variance) * generator.standard_normal((draws, dt.size))
    steps = np.concatenate([np.zeros((draws, 1)), np.cumsum(steps, axis=1)], axis=1)
    return Paths(ahead, start[:, :1] + steps, q_level)


def life_left(
    name: str, one: Trend, limit: float, moment: float, process: str = "wiener", *,
    upwards: bool = True, draws: int = DRAWS, seed: int = 1,
) -> Life:  # fmt: skip
    """Time from a moment, years, until a magnitude passes its limit, in the magnitude's unit.

    Values above the limit are beyond it, those below it unless ``upwards``. All else is of the
    simulated `paths` from the last estimate on: what has passed its limit by the moment stays so.
    """
    gap = max(0.0, moment - one.time)
    ahead, level, q = paths(
        one, one.time, process, horizon=HORIZON + gap, draws=draws, seed=seed
    )  # fmt: skip
    sign = 1.0 if upwards else -1.0
    room = sign * (limit - level)
    generator = np.random.default_rng([seed, 1])
    beyond = room <= 0.0
    if process == "wiener":
        # between two moments a Wiener path may pass the limit and come back (Brownian bridge)
        variance = np.maximum(q, 1e-300) * np.diff(ahead)
        with np.errstate(over="ignore", under="ignore"):
            chance = np.exp(-2.0 * np.clip(room[:, :-1] * room[:, 1:], 0.0, None) / variance)
        beyond[:, 1:] |= generator.random(chance.shape) < chance
    return Life(name, np.maximum(_first(ahead, room, beyond) - gap, 0.0), moment)


def _first(ahead: np.ndarray, room: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Times (N,) at which paths first are beyond, linear between moments; infinite if never."""
    at = np.argmax(beyond, axis=1)
    rows = np.arange(len(room))
    before = np.maximum(at - 1, 0)
    left, right = room[rows, before], room[rows, at]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(right < 0.0, left / (left - right), 0.5)
    times = ahead[before] + np.nan_to_num(share) * (ahead[at] - ahead[before])
    return np.where(~beyond.any(axis=1), np.inf, np.where(at == 0, 0.0, times))


def sooner(lives: Sequence[Life]) -> Life | None:
    """The life that ends first: draw by draw, as magnitudes wear on their own; None of none.

    It has the name of the magnitude that most often ends it.
    """
    if not lives:
        return None
    table = np.stack([one.draws for one in lives])
    first = np.bincount(np.argmin(table, axis=0), minlength=len(lives))
    first = np.where([np.isfinite(one.draws).any() for one in lives], first, -1)
    ends = lives[int(np.argmax(first))]
    return Life(ends.name, table.min(axis=0), ends.moment)


def process_of(fleet: Sequence[Trend]) -> str:
    """The process, "wiener" or "gamma", that explains the fleet's increments better.

    The series between jumps are cut into blocks; each increment between neighbouring blocks has the
    slope of its actuator and the fleet's variance, and the noise of both means.
    """
    told = 0.0
    for one in fleet:
        size = max(2, one.series.time.size // 12)  # estimates of a block
        kept = np.setdiff1d(np.arange(one.series.time.size), one.outliers)
        edges = [*one.jumps, *np.searchsorted(one.series.time, one.series.overhauls)]
        for part in np.split(kept, np.searchsorted(kept, sorted(edges))):
            blocks = [part[n : n + size] for n in range(0, len(part) - size + 1, size)]
            if len(blocks) < 2:
                continue
            time = np.array([one.series.time[b].mean() for b in blocks])
            level = np.array([one.corrected[b].mean() for b in blocks])
            variance = np.array([one.wear.variance(one.series.error[b]).mean() for b in blocks])
            told += _gamma_over_wiener(
                np.diff(level), np.diff(time), (level[-1] - level[0]) / (time[-1] - time[0]),
                one.wear.q_level, 2.0 * variance.mean() / size,
            )  # fmt: skip
    return "gamma" if told > 0.0 else "wiener"


def _gamma_over_wiener(
    steps: np.ndarray, dt: np.ndarray, slope: float, q: float, noise: float
) -> float:
    """Log ratio of the densities of increments (n,) with normal noise of a variance."""
    sign = 1.0 if slope >= 0.0 else -1.0
    mean = abs(slope) * dt
    if not (mean > 0.0).all():
        return 0.0
    wiener = norm.logpdf(sign * steps, mean, np.sqrt(q * dt + noise)).sum()
    shape, scale = mean**2 / (q * dt), q * dt / mean
    # gamma and noise convolved; over half a deviation, as the density may have a pole
    spread = math.sqrt(noise)
    at, half = sign * steps - spread * _NODES[:, None], 0.25 * spread
    inside = gamma.cdf(at + half, shape, scale=scale) - gamma.cdf(at - half, shape, scale=scale)
    with np.errstate(divide="ignore"):
        told = np.log((_WEIGHTS / _WEIGHTS.sum()) @ inside / (2.0 * half)).sum()
    return float(np.clip(told - wiener, -1e3, 1e3))


@dataclass(frozen=True)
class Requirement:
    """What an actuator has to do: a measure of its motion in a scenario, and the worst value."""

    # "following_error_peak", "following_error_rms", "settling_time", "rise_time", or a number
    # of the kind's summary, such as "current_peak"
    measure: str
    limit: float  # SI, the largest value with which it does its job
    scenario: str | None = None  # name or file; None takes the kind's default

    def value(self, actuator: Any, faults: dict[str, float]) -> float:
        """The measure, as the twin of an actuator with some faults shows it."""
        recording = simulate(None, self.scenario, faults, actuator)
        model = model_of(actuator)
        found = model.summary(recording, actuator)
        units = {one.name: one.unit for one in model.channels if one.name in recording.channels}
        name = next((one for one in ("output_position", "position") if one in units), "")
        if name and units.get(model.command) == units[name]:  # volts command no position
            command, output = recording.channels[model.command], recording.channels[name]
            error = command - output
            found["following_error_peak"] = float(np.abs(error).max())
            found["following_error_rms"] = float(np.sqrt(np.mean(error**2)))
            found["settling_time"] = _settling(recording.time, command, output)
            found["rise_time"] = _rise(recording.time, command, output)
        if self.measure not in found:
            raise InputError(
                f"A requirement on the kind {model.kind} measures one of {', '.join(found)}; "
                f"received {self.measure!r}."
            )
        return found[self.measure]


def _settling(time: np.ndarray, command: np.ndarray, output: np.ndarray) -> float:
    """Seconds after the last change of the command until the output stays within 5 % of it."""
    moved = np.flatnonzero(np.diff(command))
    begin = int(moved[-1]) + 1 if moved.size else 0
    outside = np.flatnonzero(np.abs(output - command[-1]) > 0.05 * np.ptp(command))
    end = int(outside[-1]) if outside.size else begin
    return float(time[max(end, begin)] - time[begin])


def _rise(time: np.ndarray, command: np.ndarray, output: np.ndarray) -> float:
    """Seconds from 10 to 90 % of the way to the last command; infinite if it gets less far."""
    way = command[-1] - output[0]
    gone = np.append(np.sign(way) * (output - output[0]), np.inf)
    begin, end = (np.append(time, np.inf)[gone >= share * abs(way)][0] for share in (0.1, 0.9))
    return float(end - begin) if np.isfinite(begin) else math.inf


def job_left(
    trends: dict[str, Trend], process: dict[str, str], moment: float, actuator: Any,
    requirement: Requirement, draws: int = 15,
) -> Life:  # fmt: skip
    """Time until the actuator no longer does its job, by its twin at the states to come.

    Each draw is one path of all magnitudes together; where it first fails the requirement is found
    by bisection over its moments, with about eight simulations. ``trends`` and ``process`` are by
    magnitude; ``moment`` is in years.
    """
    known = {one.name: one for one in model_of(actuator).faults(actuator)}
    since = min(moment, *(one.time for one in trends.values()))  # what failed by now has failed
    drawn = {
        name: paths(
            one, since, process[name], horizon=HORIZON + moment - since, draws=draws, seed=seed
        )
        for seed, (name, one) in enumerate(trends.items(), 1)
    }
    ahead = next(iter(drawn.values())).ahead

    def fails(draw: int, step: int) -> bool:
        faults = {
            name: float(np.clip(to_come.level[draw, step], known[name].lower, known[name].upper))
            for name, to_come in drawn.items()
        }
        return requirement.value(actuator, faults) > requirement.limit

    ends, last = np.full(draws, np.inf), len(ahead) - 1
    for draw in range(draws):
        if fails(draw, 0):
            ends[draw] = 0.0
        elif fails(draw, last):
            step = bisect_left(range(last), True, lo=1, key=partial(fails, draw))
            ends[draw] = 0.5 * (ahead[step - 1] + ahead[step])
    return Life(requirement.measure, np.maximum(ends - (moment - since), 0.0), moment)
