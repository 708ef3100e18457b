"""A simulated fleet with known truth: to try the fleet's commands, and to test them.

Wear laws differ on purpose from the processes by which life is predicted: friction grows with a
power of time, gaps by gamma increments that missions scale, turns short suddenly and grow from then
on, magnets lose flux on hot days. Temperature follows the seasons and shifts estimates; recordings
fail for weeks, some have no verdict, a few are wrong. What passes its limit is repaired some weeks
later; of three repairs one is not recorded.

Estimates are drawn around the truth with the standard errors of `ematwin.identify`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
import tomli_w

from ematwin.errors import InputError
from ematwin.files import write_text
from ematwin.fleet.store import FleetStore, row_of, settings_in
from ematwin.models.registry import load_actuator
from ematwin.monitoring.calibration import Calibration

ACTUATOR = "servo400"
LIMITS = {
    "friction": 0.4, "backlash": 0.3, "short_a": 0.2, "short_b": 0.2, "short_c": 0.2,
    "demagnetisation": 0.25,
}  # fmt: skip
# Standard errors of `identify` on the default command of the calibrated actuator, 2 % noise, about
# as `python benchmarks/fleet.py errors` prints them; those of shorts have become smaller since.
ERRORS = {
    "friction": 0.0009, "backlash": 0.0005, "short_a": 0.014, "short_b": 0.014, "short_c": 0.014,
    "demagnetisation": 0.03,
}  # fmt: skip
_SAME = 0.7  # share of the variance that is the same in all recordings: parameters and sensors


def worn(
    generator: np.random.Generator, days: int, severity: float, temperature: np.ndarray
) -> dict[str, np.ndarray]:
    """Magnitudes of an actuator from new on, (days,) arrays."""
    time = np.arange(days) / 365.25
    rate = generator.lognormal(np.log(0.06), 0.7) * severity
    friction = rate * time ** generator.uniform(1.0, 1.4)
    mean = generator.lognormal(np.log(0.06), 0.6) * severity / 365.25  # a day
    scale = 0.004
    backlash = np.cumsum(generator.gamma(mean / scale, scale, days))
    found = {"friction": friction, "backlash": backlash}
    for phase in "abc":
        begins = generator.exponential(20.0)  # years
        size, growth = generator.uniform(0.05, 0.2), generator.lognormal(np.log(0.05), 0.5)
        after = time >= begins
        found[f"short_{phase}"] = after * (size + growth * (time - begins))
    hot = np.maximum(temperature - 20.0, 0.0)
    found["demagnetisation"] = generator.lognormal(np.log(1e-5), 1.0) * np.cumsum(hot)
    return {name: np.minimum(path, 1.0) for name, path in found.items()}


Worn = Callable[[np.random.Generator, int, float, np.ndarray], Mapping[str, np.ndarray]]


@dataclass(frozen=True)
class SimulatedFleet:
    """Truth and estimates of a fleet."""

    actuators: int = 60
    years: float = 3.0  # for how long they are recorded, until ``end``
    per_year: float = 100.0  # recordings of each actuator in a year
    seed: int = 1
    end: datetime | None = None  # moment of the last day; None takes the present day
    # magnitudes over the days from new on, by generator, days, severity and temperatures
    worn: Worn = worn

    def __post_init__(self) -> None:
        if self.actuators < 1 or self.years <= 0.0 or self.per_year <= 0.0:
            raise InputError(
                "A simulated fleet needs at least one actuator, and years and recordings above 0; "
                f"received {self.actuators}, {self.years:g} and {self.per_year:g}."
            )

    @property
    def days(self) -> int:
        """Days of its history."""
        return round(365.25 * self.years)

    @property
    def start(self) -> datetime:
        """The first day."""
        end = self.end or datetime.now(UTC)
        midnight = end.astimezone(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        return midnight - timedelta(days=self.days)

    def serial_numbers(self) -> list[str]:
        """``EMA-01``, ..."""
        return [f"EMA-{n:02d}" for n in range(1, self.actuators + 1)]

    def truth(self, serial_number: str) -> "Truth":
        """What an actuator went through."""
        number = self.serial_numbers().index(serial_number)
        return _lived(np.random.default_rng([self.seed, number]), self.days, self.worn)

    def fill(self, store: FleetStore) -> None:
        """Write estimates, overhauls, limits and the twin into the store of a fleet."""
        known = Calibration.of(load_actuator(ACTUATOR))
        twin = store.keep_twin(known)
        settings = {**settings_in(store.folder), "limits": LIMITS}
        write_text(store.folder / "fleet.toml", tomli_w.dumps(settings))
        rows = []
        for number, serial in enumerate(self.serial_numbers()):
            truth = self.truth(serial)
            generator = np.random.default_rng([self.seed, number, 1])
            for day, announced in truth.repairs:
                if announced:
                    when = self.start + timedelta(days=day)
                    store.note(serial, "overhaul", when, note="simulated")
            rows += self._estimates(generator, serial, truth, twin, known.model.kind)
        store.add(rows)

    def _estimates(
        self, generator: np.random.Generator, serial: str, truth: "Truth", twin: str, kind: str
    ) -> list[dict[str, object]]:
        names, error = list(LIMITS), np.array([ERRORS[name] for name in LIMITS])
        constant = np.sqrt(_SAME) * error * generator.standard_normal(len(names))
        rows: list[dict[str, object]] = []
        for day in self._recorded(generator):
            value = np.array([truth.level[name][day] for name in names]) + constant
            value += np.sqrt(1.0 - _SAME) * error * generator.standard_normal(len(names))
            # scatter between occasions: lubricant, mounting, run-in
            value += 0.006 * generator.standard_normal(len(names))
            # a warm lubricant is thin: friction per K
            value[0] -= 0.0015 * (truth.temperature[day] - truth.temperature.mean())
            if generator.random() < 0.005:  # is wrong
                value[generator.integers(len(names))] += generator.uniform(0.1, 0.5)
            value = np.clip(value, 0.0, 1.0)  # as identify stays within the bounds
            without = generator.random() < 0.02  # a verdict
            large = [n for n, v, e in zip(names, value, error, strict=True) if v > 0.02 + 2.0 * e]
            grade = "none" if without else "fault" if large else "healthy"
            reason = "No verdict: the motion is too small." if without else ""
            said = f"Fault: {', '.join(large)}." if large else "Healthy."
            when = self.start + timedelta(days=int(day), hours=float(generator.uniform(6.0, 18.0)))
            rows.append(
                row_of(
                    serial, when, content=f"{self.seed} {serial}", motion=len(rows), twin=twin,
                    kind=kind, grade=grade, faults=large if grade == "fault" else [],
                    sentence=reason or said, reason=reason, names=names, values=value.tolist(),
                    covariance=np.diag(error**2).ravel().tolist(),
                    temperature=float(truth.temperature[day]), load=float(truth.load[day]),
                    source="simulated", note="",
                )
            )  # fmt: skip
        return rows

    def _recorded(self, generator: np.random.Generator) -> np.ndarray:
        """Days with a recording: irregular, and none for some weeks now and then."""
        count = int(self.per_year * self.years)
        days = np.sort(generator.integers(0, self.days, count))
        for _ in range(generator.poisson(0.7 * self.years)):
            begin = generator.integers(0, self.days)
            days = days[(days < begin) | (days > begin + generator.uniform(20.0, 90.0))]
        return days


@dataclass(frozen=True)
class Truth:
    """What an actuator went through, day by day."""

    level: Mapping[str, np.ndarray]  # by magnitude, (days,) arrays
    temperature: np.ndarray  # temperature, load: (days,) arrays, deg C and N m
    load: np.ndarray
    repairs: tuple[tuple[int, bool], ...]  # days, and whether they were recorded

    def passes(self, name: str, day: int = 0) -> int | None:
        """The first day from ``day`` on beyond its limit; None if there is none."""
        beyond = np.flatnonzero(self.level[name][day:] >= LIMITS[name])
        return None if not beyond.size else day + int(beyond[0])


def _lived(generator: np.random.Generator, days: int, worn: Worn) -> Truth:
    """The life of one actuator: wear by mission and season, repairs."""
    day = np.arange(days)
    season = np.sin(2.0 * np.pi * day / 365.25 + 4.5)
    temperature = 15.0 + 12.0 * season + 3.0 * generator.standard_normal(days)
    severity = generator.lognormal(0.0, 0.4)
    load = 0.5 * severity * generator.lognormal(0.0, 0.2, days)
    level = {name: np.zeros(days) for name in LIMITS}
    repairs: list[tuple[int, bool]] = []
    begin = 0
    while begin < days:
        span = days - begin
        grown = worn(generator, span, severity, temperature[begin:])
        beyond = [np.flatnonzero(grown[name] >= LIMITS[name]) for name in LIMITS]
        first = min((int(b[0]) for b in beyond if b.size), default=span)
        end = min(span, first + int(generator.uniform(20.0, 60.0)))
        for name, path in grown.items():
            level[name][begin : begin + end] = path[:end]
        begin += end
        if begin < days:
            repairs.append((begin, bool(generator.random() < 2.0 / 3.0)))
    return Truth(level, temperature, load, tuple(repairs))
