"""Motor and output as the recorded currents drive them, where the motor's angle was not recorded.

Nothing is fed back by the controller: the torque of the recorded currents moves both masses, and
each of the `commutations`, and the output's angle where that was recorded, corrects angle and speed
by a Kalman filter (Kalman 1960, J. Basic Eng. 82, 35-45), so that a torque that is a little wrong
does not add up. It is an extended one: errors of a speed grow where friction falls with speed. The
angle that was seen less the one expected, in standard deviations, is white if the actuator is
right. These innovations are the residual of the mechanics (prediction-error method; Ljung 1999,
System Identification, section 3.2). How noisy the acceleration is follows from them by maximum
likelihood (Mehra 1970, IEEE Trans. Autom. Control 15(2), 175-184): where the actuator is known
badly, the filter trusts it less.
"""

import copy
import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.bldc.commutations import commutations
from ematwin.models.bldc.constants import kernel_constants, truer_constants
from ematwin.models.bldc.faults import UNKNOWNS, ZERO, fault_vector
from ematwin.models.bldc.masses_filter import SWITCHED, Sensed, evened, masses_along
from ematwin.models.optional import Candidate, Values
from ematwin.numerics.lanes import LANES
from ematwin.numerics.side_by_side import cores, in_blocks
from ematwin.numerics.signals import white_noise

LEAST = 0.001  # of the recorded current: what simulators of other make differ by
RECENT = 32  # answers that are kept: many of the next differ by a sensor or a mass alone
_STEP = 5e-6  # s, at most: steps of 0.5 us change innovations by 0.03 of their deviations
_SHORT = 2.5e-6  # s: where friction near rest is looked for
_LATE = 0.5  # of the deviation of when they came: so far all commutations were off in the mean
_APART = 5e-4  # s, between angles of the output that count
_TRUST = tuple(10.0**n for n in range(-1, 8))  # times the density of what noise of currents makes
_DOUBT = tuple(10.0 ** (0.5 * n) for n in range(5))  # times the noise of the output's angle
_NEAR = 10.0  # times that density: the torques are known
_AHEAD = 10.0  # by which the noise of a nearer estimate may be less
_LOST = 1e3  # times that density: something is far off
_ASTRAY = 0.15  # rad: outputs by currents and as recorded are a fiftieth of it apart
_FRICTIONS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.6)  # faults
_GAPS = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7)
# sections of an actuator on which their motion depends
OF_GEAR = ("transmission", "presliding", "compliance")
OF_MOTOR = ("motor", "cogging", "emf", "torque_ripple", "eccentricity")
MOVES = {  # what it depends on, by name, and what that usually is
    **{one.name: one.healthy for one in UNKNOWNS if one.name != "gain"},
    "load_gain": 1.0, "load_offset": 0.0, "current_gain": 1.0, "current_offset": 0.0, ZERO: 0.0,
}  # fmt: skip


class Noise(NamedTuple):
    """What a filter along currents does not know."""

    density: float  # rad^2/s^3, of white noise of the acceleration
    output: float = math.inf  # rad, standard deviation of the recorded angle of the output
    least: float = math.inf  # rad^2/s^3, that a nearer estimate may leave

    @property
    def ahead(self) -> "Noise":
        """For a nearer estimate: a part of the noise is what this one is wrong by."""
        less = max(self.least, self.density / _AHEAD)
        return self._replace(density=min(self.density, less))


# sections of an actuator, and values, by name, on which the motion depends
_Key = tuple[tuple[tuple[str, Any], ...], tuple[tuple[str, float], ...], Noise]


class Moved(NamedTuple):
    """How both masses moved, on the motor shaft."""

    motor: np.ndarray  # (S,), rad
    speed: np.ndarray  # rad/s
    output: np.ndarray  # rad
    left: np.ndarray  # (K,), innovations in standard deviations
    log_density: float  # of all that was seen


class Masses:
    """Both masses along recorded currents, A, and their ``load`` (S,), N m.

    Currents are those of the phases (S, 3), or one equivalent current (S,), whose commutations are
    told apart by where the motor is ``near`` (S,), rad. Both masses ``begin`` at rest at an angle,
    rad; an ``output`` (S,), rad, may have been recorded, with noise of a ``deviation``, rad. All on
    the motor shaft.
    """

    def __init__(
        self, currents: np.ndarray, load: np.ndarray, rate: float, begin: float, sheet: Any,
        near: np.ndarray | None = None, output: np.ndarray | None = None, deviation: float = 0.0,
    ) -> None:  # fmt: skip
        self._every = commutations(currents, rate, sheet)
        self._seen = self._every if near is None else self._every.placed(near, near)
        self._currents = currents = currents.reshape(len(currents), -1)
        self._load, self._rate, self._begin, self._sheet = load, rate, begin, sheet
        self._step = _STEP
        inertia = sheet.motor.inertia + sheet.transmission.output_inertia
        unit = sheet.motor.emf_constant / inertia
        # each phase makes half of the torque constant, the open one less
        share = 1.0 if near is not None else 0.76
        noise = share * float(np.mean([white_noise(x) for x in currents.T]))
        usual = float(np.sqrt(np.mean(currents**2)))
        density = (unit * math.hypot(noise, LEAST * usual)) ** 2 / rate
        # one current's commutations are told apart by the motion, which is not trusted too early
        least = density if near is None else math.inf
        self._usual = Noise(density, max(SWITCHED, deviation), least)
        self._whole = (unit * usual) ** 2 / rate  # of noise as large as the currents
        self.noise = self._usual._replace(output=math.inf)
        self._output = output
        self._recent: dict[_Key, Moved] = {}
        self._beside = lru_cache(maxsize=RECENT)(self._at)

    def at(
        self, actuator: Any, values: Values, noise: Noise | None = None, ahead: bool = False
    ) -> "Masses":
        """The same with this noise, or the likeliest one at these values.

        ``ahead`` asks for that of a nearer estimate, of which the error of this one is no part.
        """
        return self._beside(actuator, _given(values), noise, ahead)

    def _at(
        self, actuator: Any, given: tuple[tuple[str, float], ...], noise: Noise | None, ahead: bool
    ) -> "Masses":
        if noise is not None:
            return self._with(noise=noise)
        values = dict(given)
        near = _NEAR * self._usual.density
        best = self._with(noise=self._likeliest(actuator, [values], angles=(math.inf,))[1])
        if self._output is not None:
            # beside a wrong gap it hides how the motor turns; in rests it alone tells
            shown = self._with(noise=self._likeliest(actuator, [values])[1])
            if shown.noise.density <= max(best.noise.density, near):
                best = shown
        if self._currents.shape[1] == 1 and best.noise.density <= near:
            # such a motion tells turns better than that near which it was
            moved = best.moved(actuator, values).motor
            best = best._with(_seen=self._every.placed(moved, self._seen.near))
        return best._with(noise=best.noise.ahead) if ahead else best

    def _likeliest(
        self, actuator: Any, some: Sequence[Values], densities: Sequence[float] = _TRUST,
        angles: Sequence[float] = _DOUBT,
    ) -> tuple[Values, Noise]:  # fmt: skip
        """Values, of some, and the noise, in multiples of the usual one, that are most likely."""
        usual, seen = self._usual, (math.inf,) if self._output is None else angles
        noises = [
            usual._replace(density=x * usual.density, output=y * usual.output)
            for x, y in product(densities, seen)
        ]
        tried = list(product(some, noises))

        def log_densities(block: Sequence[tuple[Values, Noise]]) -> list[float]:
            candidates = [(actuator, values) for values, _ in block]
            moved = self.moved_each(candidates, [noise for _, noise in block])
            return [one.log_density for one in moved]

        return tried[int(np.argmax(in_blocks(log_densities, tried, LANES)))]

    def begins(self, actuator: Any, values: Values) -> Values:
        """Faults that are likelier than those of values, where these explain little, or no output.

        Between commutations a motor is lost whose friction is far off, and an output whose gap is.
        """
        known = self._output is None or math.isfinite(self.noise.output)
        if known and self.noise.density <= _LOST * self._usual.density:
            return {}
        some = [{**values, "friction": one} for one in _FRICTIONS]
        if self._output is not None:
            some = [{**one, "backlash": gap} for one in (values, *some) for gap in _GAPS]
        best, _ = self._likeliest(actuator, [values, *some], _TRUST[1:6:2], _DOUBT[:3:2])
        return {name: x for name, x in best.items() if x != values.get(name)}

    def _with(self, **changed: Any) -> "Masses":
        other = copy.copy(self)
        other.__dict__.pop("size", None)
        other.__dict__ |= changed
        if changed.keys() != {"noise"}:
            other._recent = {}
        other._beside = lru_cache(maxsize=RECENT)(other._at)
        return other

    @cached_property
    def size(self) -> float:
        """Norm of the innovations without any torque."""
        free = self._sheet.model_copy(update={"presliding": None, "cogging": None})
        still = self._with(
            _currents=0.0 * self._currents, _load=0.0 * self._load,
            _seen=self._seen._replace(other=0.0),
        )  # fmt: skip
        return float(np.linalg.norm(still.left(free, {"friction": -0.5})))  # which leaves none

    def unexplained(self, actuator: Any, values: Values) -> float:
        """Share of the currents that would be noise, beyond that which they have.

        Or share of `_ASTRAY` by which the recorded output is elsewhere, as one that comes late.
        """
        noise = math.sqrt(max(0.0, self.noise.density - self._usual.density) / self._whole)
        if self._output is None or not self._seen.when.size:
            return noise
        if math.isfinite(self.noise.output):
            return max(noise, self.noise.output / _ASTRAY)
        moved = self.moved(actuator, values).output
        some = slice(int(self._seen.when[-1]))  # beyond, nothing shows where they are
        return max(noise, float(np.std((self._output - moved)[some])) / _ASTRAY)

    @property
    def discrepancy(self) -> float:
        """Share of the noise of the acceleration that the currents do not make."""
        return max(0.0, 1.0 - self._usual.density / self.noise.density)

    def moved(self, actuator: Any, values: Values) -> Moved:
        """How they moved, with faults, load and sensors by name."""
        return self.moved_each([(actuator, values)])[0]

    def moved_each(
        self, candidates: Sequence[Candidate], noises: Sequence[Noise] = ()
    ) -> list[Moved]:
        """The same of several candidates, side by side; with these noises, or its own.

        An output shows in all of these or in none.
        """
        pairs = zip(candidates, noises or [self.noise] * len(candidates), strict=True)
        keys = [self._key(actuator, values, noise) for (actuator, values), noise in pairs]
        found = {key: moved for key in keys if (moved := self._recent.get(key))}
        new = [key for key in dict.fromkeys(keys) if key not in found]
        for stiff in (True, False):
            alike = [key for key in new if (dict(key[0])["presliding"] is None) == stiff]
            for first in range(0, len(alike), LANES):
                some = alike[first : first + LANES]
                found |= (fresh := dict(zip(some, self._filtered(some), strict=True)))
                self._recent |= fresh
        # each thread has those of two equations at hand
        for key in list(self._recent)[: -2 * LANES * cores()]:
            self._recent.pop(key, None)
        return [found[key] for key in keys]

    def log_densities(self, actuators: Sequence[Any]) -> list[float]:
        """Log density of all angles with each of some actuators, by its likeliest noise."""
        usual, shortly = self._usual, self._with(_step=_SHORT)
        noises = [usual._replace(density=x * usual.density) for x in _TRUST[1:5]]

        def of(some: Sequence[Any]) -> list[float]:
            candidates: list[Candidate] = [(actuator, {}) for actuator in some for _ in noises]
            moved = shortly.moved_each(candidates, noises * len(some))
            each = np.reshape([one.log_density for one in moved], (len(some), -1))
            return list(each.max(axis=1).tolist())

        return in_blocks(of, actuators, max(1, LANES // len(noises)))

    def _key(self, actuator: Any, values: Values, noise: Noise) -> _Key:
        sections = {name: getattr(actuator, name) for name in (*OF_GEAR, *OF_MOTOR)}
        resistance = self._sheet.motor.resistance  # of which currents are known
        sections["motor"] = actuator.motor.model_copy(update={"resistance": resistance})
        return tuple(sections.items()), _given(values), noise

    def _filtered(self, keys: Sequence[_Key]) -> list[Moved]:
        seen = self._seen
        rows: tuple[list[Any], ...] = [], [], [], []
        for sections, values, noise in keys:
            actuator = self._sheet.model_copy(update=dict(sections))
            given = {**MOVES, **dict(values)}
            offset = given["current_offset"] * actuator.motor.emf_constant
            sensed = Sensed(
                self._begin - given[ZERO], given[ZERO], 1.0 / given["current_gain"],
                -offset / given["current_gain"], given["load_gain"],
                given["load_offset"] / actuator.transmission.ratio, noise.density, noise.output,
            )  # fmt: skip
            row = fault_vector(given), kernel_constants(actuator), truer_constants(actuator), sensed
            for every, one in zip(rows, row, strict=True):
                every.append(one)
        found, left, fixed, when = masses_along(
            *(np.array(every, dtype=float) for every in rows),
            self._sheet.transmission.backlash,  # they stand somewhere in the gap
            self._currents, self._load, 1.0 / self._rate,
            math.ceil(1.0 / (self._rate * self._step) - 1e-9),
            np.array([seen.when, seen.angle, seen.jitter]), seen.near,
            self._shown_by(keys[0][2]), np.array([seen.turn, seen.within, seen.other]),
        )  # fmt: skip
        evened(found, fixed, when, self._rate)
        each, spreads = left[:, 0] / left[:, 1], left[:, 1]
        log_densities = -0.5 * each**2 - np.log(spreads)
        every = log_densities.sum(axis=1).tolist()
        return [Moved(*x[:3], *more) for x, *more in zip(found, each, every, strict=True)]

    def left(self, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Innovations (K,), in standard deviations."""
        return self.moved(actuator, values or {}).left

    def each(self, candidates: Sequence[Candidate]) -> list[np.ndarray]:
        """The same of several candidates."""
        return [one.left for one in self.moved_each(candidates)]

    def _shown_by(self, noise: Noise) -> np.ndarray:
        """Angles (S,) of the output that count beside a noise, rad; NaN where none does."""
        found, every = np.full(len(self._load), math.nan), math.ceil(_APART * self._rate)
        if self._output is not None and math.isfinite(noise.output):
            found[::every] = self._output[::every]
        return found

    def _events(self, noise: Noise) -> int:
        return self._seen.when.size + int(np.isfinite(self._shown_by(noise)).sum())

    @property
    def samples(self) -> int:
        """Number of angles that count in `log_densities`."""
        return self._events(self._usual)

    def least(self, actuator: Any) -> float:
        """Share of the innovations without any torque that noise leaves."""
        return math.hypot(self.alike(actuator), math.sqrt(self._events(self.noise)) / self.size)

    def alike(self, actuator: Any) -> float:
        """The same that commutations which all come late leave, and simulators of other make."""
        late = _LATE * math.sqrt(self._seen.when.size)
        return math.hypot(LEAST, late / self.size)

    def seen_anew(self, seed: int) -> "Masses":
        """The same with other noise of commutations, and of the acceleration by its density."""
        rng, seen = np.random.default_rng(seed), self._seen
        when = seen.when + seen.jitter * self._rate * rng.standard_normal(seen.when.size)
        noise = np.array([white_noise(x) for x in self._currents.T])
        noise *= math.sqrt(self.noise.density / self._usual.density)
        return self._with(
            _seen=seen._replace(when=when).rows(np.argsort(when)),
            _output=None
            if self._output is None
            else self._output + self._usual.output * rng.standard_normal(len(self._load)),
            _currents=self._currents + noise * rng.standard_normal(self._currents.shape),
        )


def _given(values: Values) -> tuple[tuple[str, float], ...]:
    """Those of values on which masses depend."""
    return tuple((name, values[name]) for name in MOVES if name in values)
