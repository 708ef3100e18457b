"""Optional parts of a kind of actuator, for test commands, figures, studies and unstated forms.

Each is a small object that a `Model` holds or gives; without it the kind is treated as any other.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.recordings.recording import Recording

Values = Mapping[str, float]
Choices = Sequence[Callable[[Any], Sequence[Values]]]
FIRST_SAMPLE = "first_sample"  # s, of `Recording.first_sample`, among values by name


@dataclass(frozen=True)
class Signal:
    """A trace for a figure.

    Parameters
    ----------
    title, unit : of the panel
    values : (S,) array
    reference : (S,) array or None, the commanded trace
    """

    title: str
    unit: str
    values: np.ndarray
    reference: np.ndarray | None = None


class Demand(NamedTuple):
    """Demand of a motion on an actuator, which a test may limit: the largest magnitude.

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
    setting : str, the setting of the file that states it
    names : of its faults
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
class Study:
    """Cases for studies of search methods, and the measure of an error.

    Parameters
    ----------
    noisy : whether a simulation has the noise of usual sensors where none is asked for
    severities : by name, least and largest severity of a random fault, as shares of the way from
        healthy to a bound
    severity : the same for a fault that is not named
    """

    noisy: bool = False
    severities: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    severity: tuple[float, float] = (0.1, 0.9)

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
    said : describes the found form, such as "cogging of 1.1 mN m, 12 a turn"
    fitted : places that are fitted
    alternatives : gives values by place that are chosen from a list, such as sample times
    """

    name: str
    is_stated: Callable[[Any], bool]
    places: tuple[str, ...]
    starts: Callable[[Any], Sequence[Values]]
    said: Callable[[Any], str]
    fitted: tuple[str, ...] = ()
    alternatives: Callable[[Any], Sequence[Values]] = lambda actuator: ()


class Equation(NamedTuple):
    """Equation of a part of an actuator along a recorded motion, and its forms.

    Parameters
    ----------
    name : str, such as "controller"
    left : gives what an actuator leaves of the recording, (K,) array in the order of time, with
        faults, load and sensors by name, as they usually are if not named
    size : float, norm of the trace to be explained, in the same unit
    least : gives the share of it that noise and the error of the model leave of an actuator
    fitted : places that are fitted whatever the forms
    forms : that are looked for
    unknowns : names of faults, load and sensors that matter to it
    rests : name of the equation on whose estimates it rests; "" if on none
    at : gives it for values of the unknowns, where it rests on another
    together : each gives values by place of one form after the other, some with `FIRST_SAMPLE`, to
        be chosen together, such as times of two loops, which may pass for one another; tried in
        turn while more than noise is left
    first_samples : gives instants at which loops may sample first: those in one sample time, evenly
        spaced, and in each that follows until all loops sample as before
    alike : gives the share of it that the equation's own error leaves, alike throughout: standard
        errors count it once, however many samples there are
    changes : gives how the residual (K,) changes with load, sensors or timing that may pass for a
        form, by name
    each : gives what each of several actuators leaves, by a kind that answers for many at once, in
        the time of one; None where ``left`` serves
    near : gives the same equation corrected by the reference model at an actuator; None where no
        reference corrects it
    """

    name: str
    left: Callable[[ParameterSet, Values], np.ndarray]
    size: float
    least: Callable[[ParameterSet], float]
    fitted: tuple[str, ...]
    forms: tuple[Form, ...]
    unknowns: tuple[str, ...] = ()
    rests: str = ""
    at: Callable[[Values], "Equation"] | None = None
    together: Sequence[Choices] = ()
    first_samples: Callable[[Any], Sequence[Sequence[float]]] = lambda actuator: ()
    alike: Callable[[ParameterSet], float] = lambda actuator: 0.0
    changes: Callable[[ParameterSet], Mapping[str, np.ndarray]] = lambda actuator: {}
    each: Callable[[Sequence[ParameterSet]], Sequence[np.ndarray]] | None = None
    near: "Callable[[ParameterSet], Equation] | None" = None
