"""What of a scenario may be designed: its numbers as a box, and back.

Parts of a scenario say which of their numbers may be chosen and what each is
(`Component.designed`); a kind of actuator adds parts that a command may have besides
(`Model.designable`). Their ranges follow from the limits of the motion: sizes of the
command from the travel, rates from the speed, sizes of the load from the load.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import InputError
from ematwin.models.base import Model
from ematwin.models.scenario import Component, Scenario

_OCTAVES = 2.5  # that a frequency may be moved, to both sides
_LATEST = 0.95  # share of the duration: what comes later hardly shows
_MOST_POINTS = 24  # of a profile: a longer one is a recording, and stays as it is


class Number(NamedTuple):
    """A number of a scenario that may be chosen.

    ``history`` and ``part`` say where, ``name`` which; ``point`` in a profile, else None.
    """

    history: str
    part: int
    name: str
    point: int | None
    lower: float
    upper: float
    start: float
    logarithmic: bool

    @property
    def place(self) -> str:
        """Such as ``command.0.amplitude``."""
        point = "" if self.point is None else f".{self.point}"
        return f"{self.history}.{self.part}.{self.name}{point}"


class DesignSpace:
    """The commands that can be made of a scenario, as points (d,) of the unit box.

    Parameters
    ----------
    model : of the kind
    scenario : from which the design begins
    limits : largest demands by name, SI; the travel, "speed" and "load" bound sizes

    Attributes
    ----------
    numbers : what may be chosen, (d,)
    start : (d,) array, the scenario itself, within the limits

    Raises
    ------
    InputError
        If nothing of the scenario may be designed.
    """

    def __init__(self, model: Model, scenario: Scenario, limits: Mapping[str, float]) -> None:
        self.limits = dict(limits)
        self._size = next(
            (o.name for o in model.limited if model.command in o.channels and not o.is_rate), ""
        )
        added = {
            history: parts
            for history, parts in model.designable.items()
            if history == "command" or limits.get("load", 0.0) > 0.0
        }
        self._parts: dict[str, list[Any]] = {
            "command": [*scenario.command, *added.get("command", ())],
            "load": [*scenario.load, *added.get("load", ())],
        }
        self._base = scenario
        self.numbers = tuple(
            number
            for history, parts in self._parts.items()
            for n, part in enumerate(parts)
            for number in self._numbers_of(history, n, part)
        )
        if not self.numbers:
            raise InputError(
                f"Nothing of the scenario {scenario.name} may be designed: its parts are recorded. "
                "Give one with a chirp, steps, or a profile of few points."
            )
        self.start = np.array([_share(one, one.start) for one in self.numbers])

    def scenario(self, point: np.ndarray, name: str = "designed") -> Scenario:
        """The command at a point (d,); sizes are scaled down to the limits of travel and load."""
        tables = {
            history: [part.model_dump() for part in parts] for history, parts in self._parts.items()
        }
        for one, share, own in zip(self.numbers, point.tolist(), self.start, strict=True):
            table = tables[one.history][one.part]
            # the scenario itself to the last digit, where it is meant
            value = (
                min(max(one.start, one.lower), one.upper) if share == own else _value(one, share)
            )
            if one.point is None:
                table[one.name] = value
            else:
                table[one.name][one.point] = value
        time = np.linspace(0.0, self._base.duration, 1001)  # times at which a history is measured
        parts = {}
        for history, bound in (("command", self._size), ("load", "load")):
            made = [
                _sorted(type(part), table)
                for part, table in zip(self._parts[history], tables[history], strict=True)
            ]
            kept = [part for part in made if _adds(part, self._base.duration, time)]
            size = _size(kept, self._base.duration, time)
            limit = self.limits.get(bound, math.inf)
            parts[history] = (
                [_scaled(part, limit / size) for part in kept] if size > limit else kept
            )
        if not parts["command"]:
            parts["command"] = [self._parts["command"][0]]
        return Scenario(name=name, duration=self._base.duration, **parts)

    def _numbers_of(self, history: str, n: int, part: Component) -> list[Number]:
        size = self.limits.get(self._size if history == "command" else "load", math.inf)
        duration = self._base.duration
        found = []
        for name, what in part.designed.items():
            value = getattr(part, name)
            if isinstance(value, list):
                if len(value) > _MOST_POINTS:
                    continue
                reach = size if math.isfinite(size) else 2.0 * max(map(abs, value))
                # the first point stays: the actuator stands there
                found += [
                    Number(history, n, name, k, -reach, reach, x, False)
                    for k, x in enumerate(value)
                    if k > 0 and reach > 0.0
                ]
                continue
            if value is None:
                continue  # left to the scenario's end, or given by a file
            reach = abs(value)
            if what in ("size", "amplitude"):
                reach = size if math.isfinite(size) else 2.0 * reach
                lower, upper = (0.0 if what == "amplitude" else -reach), reach
            elif what == "rate":
                limit = self.limits.get("speed", 2.0 * reach) if history == "command" else 2 * reach
                lower, upper = -limit, limit
            elif what == "time":
                lower, upper = 0.0, _LATEST * duration
            elif what == "phase":
                lower, upper = -math.pi, math.pi
            else:
                middle = max(value, 1.0 / duration)
                lower, upper = middle / 2.0**_OCTAVES, middle * 2.0**_OCTAVES
            if upper > lower:
                found.append(
                    Number(history, n, name, None, lower, upper, value, what == "frequency")
                )
        return found


def _share(one: Number, value: float) -> float:
    low, high = one.lower, one.upper
    if one.logarithmic:
        low, high, value = math.log(low), math.log(high), math.log(max(value, low))
    return min(1.0, max(0.0, (value - low) / (high - low)))


def _value(one: Number, share: float) -> float:
    if one.logarithmic:
        return float(one.lower * (one.upper / one.lower) ** share)
    return float(one.lower + share * (one.upper - one.lower))


_SIZES = ("amplitude", "value", "rate")


def _adds(part: Any, duration: float, time: np.ndarray) -> bool:
    """Whether a part adds anything to its history."""
    return bool(np.any(part.within(duration).at(time)))


def _scaled(part: Any, factor: float) -> Any:
    """The part multiplied by a factor; one from a file stays."""
    found = {}
    for name in _SIZES:
        size = getattr(part, name, None)
        if isinstance(size, list):
            found[name] = [factor * x for x in size]
        elif size is not None:
            found[name] = factor * size
    return part.model_copy(update=found)


def _size(parts: list[Any], duration: float, time: np.ndarray) -> float:
    total = sum((part.within(duration).at(time) for part in parts), np.zeros(time.shape))
    return float(np.abs(total).max())


def _sorted(kind: type[Component], table: dict[str, Any]) -> Component:
    """The part of a table; a ramp that would stop before it starts is turned round."""
    if table.get("stop") is not None and table["stop"] < table["start"]:
        table["start"], table["stop"] = table["stop"], table["start"]
    return kind(**table)
