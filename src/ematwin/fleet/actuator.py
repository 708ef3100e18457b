"""One actuator of a fleet: its history, trends, life left and alarms."""

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import brentq

from ematwin.errors import InputError
from ematwin.estimation.thresholds import thresholds_of
from ematwin.fleet.alarms import STEPS, Alarm, Before, by_urgency, judge
from ematwin.fleet.life import Life, Requirement, job_left, life_left, sooner
from ematwin.fleet.store import moment_of, years
from ematwin.fleet.trend import Series, Trend, trend
from ematwin.models.unknown import Unknown
from ematwin.monitoring.calibration import Calibration
from ematwin.showing.results import page_written

if TYPE_CHECKING:
    from ematwin.fleet.fleet import Fleet


ENTRIES = ("overhaul", "acknowledged", "silenced")  # of maintainers, who may withdraw them


class FleetActuator:
    """One actuator of a fleet. `Fleet` makes it.

    Attributes
    ----------
    serial_number, kind : str
    rows : its judged recordings, by time
    history : all events, by time: alarms, and what maintainers entered and withdrew
    events : those that are not withdrawn
    """

    def __init__(
        self, fleet: "Fleet", serial_number: str, rows: list[dict[str, Any]],
        events: list[dict[str, Any]],
    ) -> None:  # fmt: skip
        self.fleet, self.serial_number, self.rows = fleet, serial_number, rows
        self._withdrawn = {one["entry"] for one in events if one["what"] == "withdrawn"}
        self.history: list[dict[str, Any]] = []
        self.events: list[dict[str, Any]] = []
        self._before: dict[str, Before] = {}  # by magnitude, when its alarm was last looked at
        for one in events:
            self._take(one)
        self.kind = str(self.rows[-1]["kind"])  # of its latest twin
        self._trends: dict[str, Trend] = {}
        self._lives: dict[str, Life] = {}

    @cached_property
    def twin(self) -> Calibration:
        """The twin that judged its latest recording."""
        return self.fleet.store.twin(self.rows[-1]["twin"])

    @cached_property
    def unknowns(self) -> dict[str, Unknown]:
        """The faults of its kind by name."""
        faults = self.twin.model.faults(self.twin.actuator)
        return {one.name: one for one in faults if one.direction_of is None}

    @cached_property
    def magnitudes(self) -> tuple[str, ...]:
        """Names of the faults with estimates."""
        return tuple(n for n in self.unknowns if n in self._columns)

    @cached_property
    def _columns(self) -> dict[str, np.ndarray]:
        """By magnitude, of n rows with a verdict, (n, 5): time, value, error, temperature, load."""
        found: dict[str, list[tuple[Any, ...]]] = {}
        for row in self.rows:
            names = () if row["grade"] == "none" else row["names"] or ()
            for n, name in enumerate(names):
                variance = row["covariance"][n * len(names) + n]
                if variance is not None and 0.0 <= variance < math.inf:
                    own = years(row["time"]), row["values"][n], variance**0.5
                    found.setdefault(name, []).append((*own, row["temperature"], row["load"]))
        return {name: np.array(several, dtype=float) for name, several in found.items()}

    def unknown(self, name: str) -> Unknown:
        """A magnitude as the table of its kind has it; `InputError` without an estimate of it."""
        if name not in self.magnitudes:
            raise InputError(
                f"There is no estimate of {name!r} of {self.serial_number}; there are some of "
                f"{', '.join(self.magnitudes)}."
            )
        return self.unknowns[name]

    def series(self, name: str) -> Series:
        """Estimates of a magnitude with their standard errors, by time."""
        self.unknown(name)
        columns = self._columns[name]
        covariates = np.nan_to_num((columns[:, 3:] - self._usual[0]) / self._usual[1])
        renewed = [one["time"] for one in self.events if one["what"] == "overhaul"]
        # a calibration takes the actuator for healthy: the same as an overhaul
        renewed += [b["time"] for a, b in pairwise(self.rows) if a["twin"] != b["twin"]]
        overhauls = tuple(sorted(map(years, renewed)))
        time, value, error = columns[:, :3].T
        return Series(time, value, error, covariates, overhauls)

    @cached_property
    def _usual(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and deviation of its own temperatures and loads."""
        rows = [[row["temperature"], row["load"]] for row in self.rows]
        table = np.ma.masked_invalid(np.array(rows, dtype=float))
        spread = table.std(axis=0).filled(0.0)
        return table.mean(axis=0).filled(0.0), np.where(spread > 0.0, spread, 1.0)

    def trend(self, name: str) -> Trend:
        """Posterior of level and slope of a magnitude."""
        if name not in self._trends:
            self._trends[name] = trend(self.series(name), self.fleet.wear(self.kind, name))
        return self._trends[name]

    def limit(self, name: str) -> float | None:
        """The limit of a magnitude in the unit in which it is searched; None where none is stated.

        `InputError` where ``fleet.toml`` states one outside its range.
        """
        given = self.fleet.limits_given.get(name)
        if given is None:
            return None
        one = self.unknown(name)
        stated = thresholds_of({name: given}, [one], self.twin.actuator)[name]
        if not stated.physical or one.physical is None:
            return stated.value
        ends = (one.healthy, one.upper) if stated.above else (one.lower, one.healthy)

        def over(value: float) -> float:
            return float(one.physical_value(self.twin.actuator, value).value - stated.value)

        if over(ends[0]) * over(ends[1]) > 0.0:  # a physical value that falls as the fault grows
            ends = (one.lower, one.healthy) if stated.above else (one.healthy, one.upper)
        return float(brentq(over, *ends))

    def life_left(
        self, name: str | None = None, requirement: Requirement | None = None
    ) -> Life | None:
        """Life until a magnitude passes its limit; of all of them where none is named.

        None where no limit is stated. With a requirement: until the twin at the states to come no
        longer fulfils it.
        """
        moment = years(self.fleet.now)
        if requirement is not None:
            chosen = [name] if name is not None else list(self.magnitudes)
            trends = {one: self.trend(one) for one in chosen}
            process = {one: self.fleet.process(self.kind, one) for one in chosen}
            return job_left(trends, process, moment, self.twin.actuator, requirement)
        if name is None:
            found = [self.life_left(one) for one in self.magnitudes]
            return sooner([one for one in found if one is not None])
        limit = self.limit(name)
        if limit is None:
            return None
        if name not in self._lives:
            self._lives[name] = life_left(
                name, self.trend(name), limit, moment, self.fleet.process(self.kind, name),
                upwards=limit >= self.unknown(name).healthy,
                seed=1 + self.magnitudes.index(name),
            )  # fmt: skip
        return self._lives[name]

    def _take(self, event: dict[str, Any]) -> None:
        """Take an event into the history, but an alarm that another watcher had noted already."""
        if event["what"] == "alarm":
            name, step, at = event["magnitude"], event["step"], years(event["time"])
            held = self._before.get(name, Before("none", at))
            if step == held.step:
                return
            self._before[name] = Before(step, at, at if step == "none" else held.cleared)
        elif event["what"] == "overhaul" and event["id"] not in self._withdrawn:
            self._before.clear()
        self.history.append(event)
        if event["id"] not in self._withdrawn:
            self.events.append(event)

    def alarms(self) -> dict[str, Alarm]:
        """The alarm of each magnitude, also those that are none."""
        moment, found, count = years(self.fleet.now), {}, len(self.magnitudes)
        for name in self.magnitudes:
            alarm = judge(
                self.trend(name), self.life_left(name), moment, self.fleet.policy,
                unknown=self.unknown(name), count=count, before=self._before.get(name),
            )  # fmt: skip
            seen = [one for one in self.events if one.get("magnitude") == name]
            since = [e["what"] for e in seen if years(e["time"]) >= alarm.since - 1e-9]
            until = [moment_of(e["until"]) for e in seen if e["what"] == "silenced"][-1:]
            found[name] = replace(
                alarm,
                acknowledged="acknowledged" in since,
                silenced=bool(until) and until[0] > self.fleet.now,
            )
        return found

    def update(self) -> list[dict[str, Any]]:
        """Keep its alarms that have changed in the store; gives these."""
        changed = []
        for name, alarm in self.alarms().items():
            before = self._before.get(name)
            if alarm.step != ("none" if before is None else before.step):
                told = {"magnitude": name, "step": alarm.step, "why": alarm.why}
                noted = self.fleet.store.note(self.serial_number, "alarm", self.fleet.now, **told)
                self._take(noted)
                changed.append({"serial_number": self.serial_number, **told})
        return changed

    def overhaul(self, when: str | datetime, note: str = "") -> None:
        """State that it was repaired or exchanged: from then on it begins as the fleet does.

        `InputError` for one that is to come, or before its first recording.
        """
        at, first = moment_of(when), self.rows[0]["time"]
        if at > self.fleet.now or at.date() < first.date():
            why = "to come" if at > first else f"before its first recording ({first:%Y-%m-%d})"
            said = f"received {at:%Y-%m-%d %H:%M}, which is {why}"
            raise InputError(f"An overhaul is entered when it is done, {said}.")
        self._note("overhaul", at, note=note)

    def acknowledge(self, magnitude: str | None = None, note: str = "") -> tuple[str, ...]:
        """State that an alarm, or all of them, were seen; gives the magnitudes.

        It is shown as acknowledged until its step changes. `InputError` without such an alarm.
        """
        self.update()  # it counts from when the alarm is first seen
        alarmed = [name for name, one in self.alarms().items() if one.step != "none"]
        names = [one for one in alarmed if magnitude in (None, one)]
        if not names:
            if magnitude is not None:
                self.unknown(magnitude)
            raise InputError(
                f"{self.serial_number} has no alarm{f' of {magnitude}' if magnitude else ''} to "
                f"acknowledge; alarms: {', '.join(alarmed) or 'none'}."
            )
        return self._note("acknowledged", self.fleet.now, names, note=note)

    def silence(
        self, magnitude: str | None = None, until: str | datetime = "", note: str = ""
    ) -> tuple[str, ...]:
        """Hear no more of an alarm, or of all, until a moment; gives the magnitudes.

        The latest silence counts: one until a moment that has passed ends it, and is refused
        (`InputError`) where there is none.
        """
        names = self.magnitudes if magnitude is None else [self.unknown(magnitude).name]
        end, alarms = moment_of(until), self.alarms()
        if end <= self.fleet.now and not any(alarms[name].silenced for name in names):
            raise InputError(
                f"{self.serial_number} has no silence to end, and {end:%Y-%m-%d %H:%M} has passed; "
                "give a moment that is to come."
            )
        return self._note("silenced", self.fleet.now, names, until=end.isoformat(), note=note)

    def withdraw(self, *entries: str, note: str = "") -> list[dict[str, Any]]:
        """Withdraw overhauls, acknowledgements or silences, and give them; the history shows both.

        Each entry is the ``id`` in `history`, or the beginning of it. `InputError` for one that is
        not there, stands for several, or is withdrawn already.
        """
        held = {one["id"]: one for one in self.events if one["what"] in ENTRIES}
        found = []
        for entry in entries:
            meant = [name for name in held if name.startswith(entry)]
            if len(meant) != 1:
                gone = any(name.startswith(entry) for name in self._withdrawn)
                why = "stands for several" if meant else "is withdrawn" if gone else "is unknown"
                raise InputError(
                    f"The entry {entry!r} of {self.serial_number} {why}; those that can be "
                    f"withdrawn: {', '.join(name[:8] for name in held) or 'none'}."
                )
            found += [held[name] for name in meant]
        for one in found:
            self._note("withdrawn", self.fleet.now, entry=one["id"], note=note)
        return found

    def _note(
        self, what: str, when: datetime, names: Sequence[str] = (), **more: Any
    ) -> tuple[str, ...]:
        entered = self.fleet.now.isoformat()
        for given in [{**more, "magnitude": name} for name in names] or [more]:
            same = {"what": what, "time": when, **given}.items()
            before = [one for one in self.history if same <= one.items()]
            if not any(one in self.events for one in before):  # again is once
                # one that was withdrawn can be entered again
                given |= {"entered": entered, "again": len(before)}
                self.fleet.store.note(self.serial_number, what, when, **given)
        self.fleet.refresh()
        self.__dict__ = vars(self.fleet[self.serial_number])  # this one knows it as well
        return tuple(names)

    def row(self) -> dict[str, Any]:
        """State of the actuator as a row of `Fleet.table`."""
        unalarmed = Alarm("", "none", 0.0, math.inf, "")  # of one without an estimate
        first, last = next(iter(by_urgency(self.alarms())), unalarmed), self.rows[-1]
        life = self.life_left()
        low, high = (math.inf, math.inf) if life is None else life.interval
        advice = "none" if first.silenced else first.step
        why = "" if advice == "none" else first.why
        if not why and last["grade"] == "none":
            why = f"The last recording has no verdict. {last['reason']}"
        return {
            "serial_number": self.serial_number, "kind": self.kind, "recordings": len(self.rows),
            "last_recording": last["time"].isoformat(),
            "state": last["grade"], "faults": ", ".join(last["faults"] or ()),
            "health_magnitude": first.magnitude, "health_probability": first.probability,
            "life_left_days": 365.25 * (math.inf if life is None else life.median),
            "life_left_low_days": 365.25 * low,
            "life_left_high_days": 365.25 * high,
            "life_left_of": "" if life is None or math.isinf(low) else life.name,
            "advisory": advice, "advisory_level": STEPS.index(advice), "advisory_reason": why,
            "acknowledged": first.acknowledged,
        }  # fmt: skip

    def flat(self) -> list[dict[str, Any]]:
        """Its recordings as rows with a column for each magnitude and its standard error."""
        shown = (
            "serial_number", "source", "grade", "sentence", "reason", "temperature", "load", "note"
        )  # fmt: skip
        found = []
        for row in self.rows:
            values = {name: row[name] for name in shown}
            values |= {"time": row["time"].isoformat(), "faults": ", ".join(row["faults"] or ())}
            names = row["names"] or ()
            for n, name in enumerate(names):
                values[name] = row["values"][n]
                values[f"{name}_error"] = max(row["covariance"][n * len(names) + n], 0.0) ** 0.5
            found.append(values)
        return found

    def report(self, path: str | Path) -> None:
        """Write its page (.html), which holds all that it shows."""
        page_written(self, path, "fleet.pages:actuator_page")

    def __repr__(self) -> str:
        since, last = self.rows[0]["time"], self.rows[-1]["time"]
        return (
            f"FleetActuator({self.serial_number}: {len(self.rows)} recordings, {since:%Y-%m-%d} to "
            f"{last:%Y-%m-%d})"
        )
