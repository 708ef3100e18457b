"""Optional parts of a kind of actuator: for test commands, figures, studies, forms and populations.

Each is a small object that a `Model` holds or gives; without it the kind is treated as any other.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.recordings.recording import Recording

Values = Mapping[str, float]
Choices = Sequence[Callable[[Any], Sequence[Values]]]
FIRST_SAMPLE = "first_sample"  # s, of `Recording.first_sample`, among values by name


def with_values(actuator: ParameterSet, values: Values) -> ParameterSet:
    """The actuator with values by place; others are of a recording."""
    places = {name: value for name, value in values.items() if "." in name}
    return actuator.changed(places) if places else actuator


Candidate = tuple[Any, Values]  # an actuator, with faults, load and sensors by name


@dataclass(frozen=True)
class Signal:
    """A trace for a figure."""

    title: str
    unit: str
    values: np.ndarray  # (S,)
    reference: np.ndarray | None = None  # (S,), the commanded trace


class Demand(NamedTuple):
    """Demand of a motion on an actuator, which a test may limit: the largest magnitude."""

    name: str  # of travel, speed, current, load or what else the kind can be strained by
    unit: str
    channels: tuple[str, ...]  # of those that a recording has, the largest counts
    is_rate: bool = False  # of the channel's change with time

    def size(self, recording: Recording) -> float | None:
        """The largest magnitude in a recording, SI; None without such a channel."""
        seen = [recording.channels[name] for name in self.channels if name in recording.channels]
        if self.is_rate:
            seen = [np.gradient(values, recording.time) for values in seen]
        return max((float(np.abs(values).max()) for values in seen), default=None)


class OtherForm(NamedTuple):
    """A form of a fault that an actuator's file leaves out, and that may pass for another fault."""

    actuator: ParameterSet  # with the form
    meaning: str  # such as "an eccentricity that is fixed in space"
    setting: str  # of the file that states it
    names: tuple[str, ...]  # of its faults
    mistaken: frozenset[str]  # names of the faults that may be called in its place
    starts: tuple[Values, ...]  # by name, some by place, from which a descent may set out


@dataclass(frozen=True)
class Study:
    """Cases for studies of search methods, and the measure of an error."""

    noisy: bool = False  # a simulation has the noise of usual sensors where none is asked for
    # least and largest severity of a random fault, shares of the way from healthy to a bound, by
    # name; and of a fault that is not named
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
    """A form that a file may leave out and that healthy recordings may show."""

    name: str  # such as "cogging"
    is_stated: Callable[[Any], bool]  # in the file of an actuator
    places: tuple[str, ...]  # of its parameters
    # values by place, each a whole section, from which a fit may set out; of an actuator as it is
    # known so far
    starts: Callable[[Any], Sequence[Values]]
    said: Callable[[Any], str]  # of the found form, such as "cogging of 1.1 mN m, 12 a turn"
    fitted: tuple[str, ...] = ()  # places
    # values by place that are chosen from a list, such as sample times
    alternatives: Callable[[Any], Sequence[Values]] = lambda actuator: ()
    is_sound: Callable[[Any], bool] = lambda actuator: True  # would anyone build it so?


class Equation(NamedTuple):
    """Equation of a part of an actuator along a recorded motion, and its forms."""

    name: str  # such as "controller"
    # what an actuator leaves of the recording, (K,) in the order of time, with faults, load and
    # sensors by name, as they usually are if not named
    left: Callable[[ParameterSet, Values], np.ndarray]
    size: float  # norm of the trace to be explained, in the same unit
    least: Callable[[ParameterSet], float]  # share of it that noise and the model's error leave
    fitted: tuple[str, ...]  # places that are fitted whatever the forms
    forms: tuple[Form, ...]  # that are looked for
    unknowns: tuple[str, ...] = ()  # names of faults, load and sensors that matter to it
    rests: str = ""  # name of the equation on whose estimates it rests
    judged: bool = True  # whether a verdict needs it to be explained
    step: float = 0.001  # of a coordinate, that is differenced; 0 where it is rough, and regressed
    # it, for values of these unknowns, and for this noise of its motion; where it is None, for the
    # likeliest one there, or if so asked for that of a nearer estimate, of which this one's error
    # is no part
    at: "Callable[[Values, Any, bool], Equation] | None" = None
    noise: Any = None  # of its motion, if that was not recorded
    # share of the currents that only this noise accounts for, with faults, load and sensors by name
    unexplained: Callable[[ParameterSet, Values], float] = lambda actuator, values: 0.0
    discrepancy: float = 0.0  # share of this noise that no sensor makes: torques that are not known
    # values of unknowns from which to set out, where they are likelier than those it is for
    begins: Callable[[], Values] = dict
    # values by place of one form after the other, some with `FIRST_SAMPLE`, to be chosen together,
    # as times of two loops may pass for one another; tried while more than noise is left
    together: Sequence[Choices] = ()
    # instants at which loops may sample first: those in one sample time, evenly spaced, and in each
    # that follows until all loops sample as before
    first_samples: Callable[[Any], Sequence[Sequence[float]]] = lambda actuator: ()
    # share of it that the equation's own error leaves, alike throughout: it counts once in standard
    # errors, however many samples there are
    alike: Callable[[ParameterSet], float] = lambda actuator: 0.0
    # how the residual (K,) changes with load, sensors or timing that may pass for a form, by name
    changes: Callable[[ParameterSet], Mapping[str, np.ndarray]] = lambda actuator: {}
    # what each of several candidates leaves, side by side: sooner than one after the other
    each: Callable[[Sequence[Candidate]], Sequence[np.ndarray]] | None = None
    near: "Callable[[ParameterSet], Equation] | None" = None  # it, corrected by the reference there


class Likelihood(NamedTuple):
    """How likely a recorded motion is, for a form that its equations do not show."""

    form: Form
    # log density of what was seen with each of some actuators, by the noise that is likeliest
    log_densities: Callable[[Sequence[ParameterSet]], Sequence[float]]
    samples: int  # that were seen


# What a healthy population uses: `calibrate` learns the scatter of features between healthy runs of
# kinds such as the ball screw, and `detect` compares a run with them.


@dataclass(frozen=True)
class Reported:
    """A quantity that is reported where a healthy population judges."""

    name: str  # of an unknown, or of a statistic that the model derives from features
    unit: str  # of ``scale`` times the value; "x" for a multiple of the healthy mean
    meaning: str
    logarithmic: bool = False  # the population is one of logarithms and the unit is "x"
    scale: float = 1.0  # shown value over SI value
    named: str = ""  # fault that a raised value names
    either: bool = False  # a lowered value names it as well


@dataclass(frozen=True)
class Statistic:
    """A number that a comparison measures beside the values, such as noise shared by sensors."""

    name: str  # in `Comparison.statistics`
    unit: str  # SI
    changed: str  # sentence on a recording whose value is unlike the healthy ones
    advice: str  # a sentence on why that may be


@dataclass(frozen=True)
class Monitoring:
    """Reported quantities, features and statistics of a kind; a kind overrides the methods."""

    covariate: str | None = None  # name of the nuisance on which healthy features depend
    statistics: tuple[Statistic, ...] = ()  # that comparisons measure beside the values
    short: Mapping[str, str] = field(default_factory=dict)  # channels in features, where shorter

    def reported(self, model: Any, actuator: Any) -> tuple[Reported, ...]:
        """Reported quantities; by default each fault as it is searched."""
        return tuple(
            Reported(
                one.name, one.unit, one.meaning, named=one.name, either=one.lower < one.healthy
            )
            for one in model.faults(actuator)
            if one.direction_of is None
        )

    def settling_time(self, actuator: Any) -> float:
        """Seconds from a change of the command until its transient has died out."""
        return 0.0

    def compare(
        self, model: Any, recording: Recording, actuator: Any, settling_time: float
    ) -> Comparison:
        """A recording prepared for the population.

        A kind whose preparation depends on steady motion takes ``settling_time`` (s) of the
        calibration.
        """
        return model.compare(recording, actuator)

    @staticmethod
    def of(model: Any) -> "Monitoring":
        """The one of a kind that is judged by a healthy population."""
        found = model.monitoring
        assert isinstance(found, Monitoring), f"{model.kind} has no healthy population"
        return found

    def derived(self, features: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Reported quantities that are no unknowns, (N,) by name, from features (N,) by name."""
        return {}
