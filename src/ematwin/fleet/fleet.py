"""A fleet: every actuator with its history, trends, alarms and life left.

    fleet = ematwin.Fleet("fleet/")
    fleet.watch("recordings/")
    fleet["EMA-17"].trend("friction")
    fleet["EMA-17"].life_left()
    fleet.report("fleet.html")

`fleet.toml` in its folder states limits and when alarms are raised (docs/fleet.md); all else
follows from the rows of the store.
"""

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ematwin.errors import EmatwinError, InputError, MissingExtraError
from ematwin.files import check_target
from ematwin.fleet.actuator import FleetActuator
from ematwin.fleet.alarms import Policy
from ematwin.fleet.learning import learn
from ematwin.fleet.life import Requirement, process_of
from ematwin.fleet.store import SET_ASIDE, YEAR, FleetStore, moment_of, settings_in
from ematwin.fleet.trend import Wear
from ematwin.quantities import parse_quantity
from ematwin.showing.results import page_written

_SETTINGS = ("limits", "alarms", "requirement", "serial_number", "store")


class Fleet:
    """The actuators of a store, as they are known at a moment.

    Parameters
    ----------
    folder : of the store; made where it is missing
    now : moment, ISO 8601 or datetime, from which life is counted, and after which nothing is
        known; None takes the present
    create : False refuses a folder that holds no fleet

    `FileError` if the folder cannot be used, `InputError` if its ``fleet.toml`` is none.
    """

    def __init__(
        self, folder: str | Path, *, now: str | datetime | None = None, create: bool = True
    ) -> None:
        self.store = FleetStore(folder, create=create)
        self._now = None if now is None else moment_of(now)
        self._read()

    @property
    def now(self) -> datetime:
        """The moment at which the fleet is looked at."""
        return self._now or datetime.now(UTC)

    def _latest(self) -> tuple[str, ...]:
        return (f"{self.now:%Y-%m-%d %H}", *self.store.version())  # life is counted from now

    def watch(self, recordings: Any, **settings: Any) -> Any:
        """Judge the recordings that are new; see `ematwin.fleet.watch.watch`."""
        from ematwin.fleet.watch import watch

        pattern = settings.pop("pattern", None) or self.pattern
        found = watch(self.store, recordings, pattern=pattern, **settings)
        self.refresh()
        self.update()
        return found

    def refresh(self) -> None:
        """Read the store again, where it has changed or an hour has passed."""
        if self._latest() != self.version:
            self._read()

    def _read(self) -> None:
        latest, last = self._latest(), self.now
        folder = self.store.folder
        self.limits_given, self.policy, self.requirement, self.pattern = settings_of(
            settings_in(folder), folder / "fleet.toml"
        )
        self._rows: dict[str, list[dict[str, Any]]] = {}
        self.set_aside: list[dict[str, Any]] = []
        for row in self.store.rows().to_pylist():
            if row["grade"] == SET_ASIDE:
                self.set_aside.append(row)
            elif row["time"] <= last:
                self._rows.setdefault(row["serial_number"], []).append(row)
        self._events = [one for one in self.store.events() if one["known"] <= last]
        self._wear: dict[tuple[str, str], Wear] = {}
        self._process: dict[tuple[str, str], str] = {}
        self._units: dict[str, FleetActuator] = {}
        self.version = latest

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, serial_number: object) -> bool:
        return serial_number in self._rows

    def __iter__(self) -> Iterator["FleetActuator"]:
        return (self[name] for name in self._rows)

    def __getitem__(self, serial_number: str) -> "FleetActuator":
        if serial_number not in self._rows:
            known = ", ".join(list(self._rows)[:8]) or "none"
            raise InputError(
                f"There is no judged recording of {serial_number!r} in {self.store.folder}; there "
                f"are some of {known}."
            )
        if serial_number not in self._units:
            self._units[serial_number] = FleetActuator(
                self, serial_number, self._rows[serial_number],
                [one for one in self._events if one["serial_number"] == serial_number],
            )  # fmt: skip
        return self._units[serial_number]

    def _alike(self, kind: str, name: str) -> list[FleetActuator]:
        return [one for one in self if one.kind == kind and name in one.magnitudes]

    def wear(self, kind: str, name: str) -> Wear:
        """Wear of a magnitude, from all actuators of a kind together."""
        if (kind, name) not in self._wear:
            alike = self._alike(kind, name)
            unknown = alike[0].unknown(name)
            several = [one.series(name) for one in alike]
            self._wear[kind, name] = learn(several, unknown.healthy, unknown.width)
        return self._wear[kind, name]

    def process(self, kind: str, name: str) -> str:
        """The process, wiener or gamma, that explains the increments of the fleet better."""
        if (kind, name) not in self._process:
            trends = [one.trend(name) for one in self._alike(kind, name)]
            self._process[kind, name] = process_of(trends)
        return self._process[kind, name]

    def update(self) -> list[dict[str, Any]]:
        """Look at all alarms, and keep in the store those that have changed; gives these."""
        return [one for unit in self for one in unit.update()]

    def table(self) -> list[dict[str, Any]]:
        """A row for each actuator, the most urgent first; names of fields as in ISO 13374.

        State detection (grade, faults), health assessment (the magnitude that matters most),
        prognostic assessment (life left, days), advisory (what to do, and why). `InputError` with a
        limit of what no actuator has.
        """
        known = sorted({name for one in self for name in one.unknowns})
        wrong = [name for name in self.limits_given if name not in known]
        if known and wrong:
            raise InputError(
                f"{self.store.folder / 'fleet.toml'} has a limit of {wrong[0]!r}, which no "
                f"actuator of this fleet has; there are {', '.join(known)}."
            )
        rows = [one.row() for one in self]
        return sorted(rows, key=lambda row: (-row["advisory_level"], row["life_left_low_days"]))

    def query(self, sql: str) -> Any:
        """Ask DuckDB of the table ``fleet``, a row for each recording; ``.df()`` is a DataFrame.

        fleet.query("select serial_number, count(*) from fleet group by all")
        """
        try:
            import duckdb
        except ImportError:
            raise MissingExtraError("duckdb", "fleet", "A query of a fleet") from None
        connection = duckdb.connect()
        connection.register("fleet", self.store.rows())
        try:
            return connection.sql(sql)
        except duckdb.Error as error:
            raise InputError(f"DuckDB cannot answer: {str(error).splitlines()[0]}") from None

    def export(self, path: str | Path, what: str = "recordings") -> None:
        """Write a table (.csv or .parquet): "recordings", or the "advisory" of each actuator."""
        from ematwin.recordings.tables import write_rows

        check_target(Path(path), (".csv", ".parquet"))
        if what == "advisory":
            rows = self.table()
        elif what == "recordings":
            rows = [one for unit in self for one in unit.flat()]
        else:
            raise InputError(f"what must be recordings or advisory, received {what!r}.")
        if not rows:
            raise InputError(f"The fleet {self.store.folder} holds no judged recording yet.")
        write_rows(path, rows)

    def report(self, path: str | Path) -> None:
        """Write the page of the fleet (.html), which holds all that it shows."""
        page_written(self, path, "fleet.pages:fleet_page")


def settings_of(
    table: Mapping[str, Any], path: Path
) -> tuple[dict[str, Any], Policy, Requirement | None, str | None]:
    """Limits, alarms, requirement and pattern of serial numbers of a ``fleet.toml``."""
    unknown = [name for name in table if name not in _SETTINGS]
    if unknown:
        raise InputError(f"{path} has {unknown[0]!r}; it may have {', '.join(_SETTINGS)}.")
    try:
        given = dict(table.get("alarms", {}))
        for name in ("plan", "act", "look"):
            if isinstance(given.get(name), str):
                given[name] = parse_quantity(given[name], "s", name) / YEAR
        policy = Policy(**given)
        required = table.get("requirement")
        requirement = None if required is None else Requirement(**required)
        limits = dict(table.get("limits", {}))
    except EmatwinError as error:
        raise InputError(f"{path}: {error}") from None
    except (TypeError, ValueError) as error:
        raise InputError(f"{path} cannot be used: {error}.") from None
    return limits, policy, requirement, table.get("serial_number")
