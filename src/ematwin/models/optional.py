"""What monitoring, design, figures and studies need of a kind of actuator; all of it optional.

Each is a small object that a `Model` holds or gives; without it the kind is treated as any other.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.recordings.recording import Recording

Values = Mapping[str, float]


@dataclass(frozen=True)
class Reported:
    """A quantity that is reported where a healthy population judges.

    Parameters
    ----------
    name : str; an unknown, or a statistic that the model derives from features
    unit : str, of ``scale`` times the value; "x" for a multiple of the healthy mean
    meaning : str
    logarithmic : bool, the population is one of logarithms and the unit is "x"
    scale : float, shown value over SI value
    named : str, the fault that a raised value names; "" if it names none
    either : bool, a lowered value names it as well
    least : float, in SI or as a logarithm: no healthy run is so far from the others; infinite
        where that is not known
    """

    name: str
    unit: str
    meaning: str
    logarithmic: bool = False
    scale: float = 1.0
    named: str = ""
    least: float = math.inf
    either: bool = False


@dataclass(frozen=True)
class Signal:
    """A trace for a figure.

    Parameters
    ----------
    title, unit : of the panel
    values : (S,) array
    reference : (S,) array or None, what was commanded
    """

    title: str
    unit: str
    values: np.ndarray
    reference: np.ndarray | None = None


class Demand(NamedTuple):
    """What a motion asks of an actuator, and a test may limit: the largest magnitude.

    Parameters
    ----------
    name, unit : str; of travel, speed, current, load or what else the kind can be strained by
    channels : of those that a recording has, the largest counts
    is_rate : of the channel's change with time
    """

    name: str
    unit: str
    channels: tuple[str, ...]
    is_rate: bool = False

    def size(self, recording: Recording) -> float | None:
        """The largest magnitude in a recording, SI; None without such a channel."""
        seen = [recording.channels[name] for name in self.channels if name in recording.channels]
        if self.is_rate:
            seen = [np.gradient(values, recording.time) for values in seen]
        return max((float(np.abs(values).max()) for values in seen), default=None)


class OtherForm(NamedTuple):
    """A form of a fault that an actuator's file leaves out, and that may pass for another fault.

    Parameters
    ----------
    actuator : with the form
    meaning : str, such as "an eccentricity that is fixed in space"
    setting : str, what the file says to have it
    names : of the faults that are said of it
    mistaken : names of the faults that may be called in its place
    starts : values by name, some of parameters by place, from which a descent may set out
    """

    actuator: ParameterSet
    meaning: str
    setting: str
    names: tuple[str, ...]
    mistaken: frozenset[str]
    starts: tuple[Values, ...]


@dataclass(frozen=True)
class Statistic:
    """A number that a comparison measures beside the values, such as noise shared by sensors.

    Parameters
    ----------
    name : str, in `Comparison.statistics`
    unit : str, SI
    changed : str, what is said of a recording whose value is unlike the healthy ones
    advice : str, a sentence on why that may be
    """

    name: str
    unit: str
    changed: str
    advice: str


class Study:
    """What studies of search methods need: cases, and how far an answer is off.

    Attributes
    ----------
    noisy : whether a simulation has the noise of usual sensors where none is asked for
    severities : by name, how severe a random fault is: least and most, as shares of the way from
        healthy to a bound
    severity : the same of a fault that is not named
    """

    noisy: ClassVar[bool] = False
    severities: ClassVar[Mapping[str, tuple[float, float]]] = {}
    severity: ClassVar[tuple[float, float]] = (0.1, 0.9)

    def cases(self, faults: tuple[Unknown, ...]) -> dict[str, dict[str, float]]:
        """Named faults; by default each small and large."""
        found: dict[str, dict[str, float]] = {}
        for one in faults:
            if one.direction_of is not None:
                continue
            for title, share in (("Low", 0.25), ("High", 0.75)):
                end = one.upper if one.upper > one.healthy else one.lower
                value = one.healthy + share * (end - one.healthy)
                found[f"{title} {one.name}"] = {one.name: value}
        return found

    def error_percent(
        self, faults: tuple[Unknown, ...], found: Values, injected: Values, *, wrapped: bool = False
    ) -> float:
        """How far values are from those injected, per cent of their ranges, root sum of squares.

        ``wrapped`` asks for directions as angles, which they are here in any case.
        """
        total = 0.0
        by_name = {one.name: one for one in faults}
        for one in faults:
            gap = (found[one.name] - injected[one.name]) / one.width
            if one.direction_of is not None:
                magnitude = by_name[one.direction_of]
                share = abs(injected[magnitude.name] - magnitude.healthy) / magnitude.width
                gap = (gap - round(gap)) * math.sqrt(share)
            total += gap * gap
        return 100.0 * math.sqrt(total)


class Form(NamedTuple):
    """A form that a file may leave out and that healthy recordings may show.

    Parameters
    ----------
    name : str, such as "cogging"
    is_stated : tells whether the file of an actuator has it
    places : of its parameters
    starts : gives values by place, each a whole section, from which a fit may set out; an actuator
        is given as it is known so far
    alternatives : gives values by place that are chosen from a list, such as sample times
    fitted : places that are fitted
    said : says what was found, such as "cogging of 1.1 mN m, 12 a turn"
    """

    name: str
    is_stated: Callable[[Any], bool]
    places: tuple[str, ...]
    starts: Callable[[Any], Sequence[Values]]
    alternatives: Callable[[Any], Sequence[Values]]
    fitted: tuple[str, ...]
    said: Callable[[Any], str]


class Equation(NamedTuple):
    """What a part of an actuator has to satisfy along a recorded motion, and its forms.

    Parameters
    ----------
    name : str, such as "controller"
    left : gives what an actuator leaves of the recording, (K,) array
    size : float, norm of what is to be explained, in the same unit
    least : gives the share of it that noise and the error of the model leave of an actuator
    fitted : places that are fitted whatever the forms
    forms : that are looked for
    alike : gives the share of it that the equation's own error leaves, alike throughout: standard
        errors count it once, however many samples there are
    """

    name: str
    left: Callable[[ParameterSet], np.ndarray]
    size: float
    least: Callable[[ParameterSet], float]
    fitted: tuple[str, ...]
    forms: tuple[Form, ...]
    alike: Callable[[ParameterSet], float] = lambda actuator: 0.0
