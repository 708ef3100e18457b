"""Uncertainty of an identification: intervals, probabilities, and doubts about them.

Three methods evaluate the joint density (`ematwin.estimation.joint`): `LaplaceIntervals` here,
`ematwin.estimation.profile.Profiles` and `ematwin.estimation.posterior.Posterior`. Each takes a
`Question` and answers with an `Uncertainty`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.assess import Assessment
from ematwin.estimation.constants import ANYTHING, SMALLEST
from ematwin.estimation.intervals import Draws
from ematwin.estimation.joint import Joint
from ematwin.estimation.problem import Problem
from ematwin.estimation.spike_and_slab import FaultSets
from ematwin.estimation.thresholds import Threshold
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.showing.text import listed

Report = Callable[[int, int], None]
"""Called with simulations and how many there may be; may raise to end the work."""

METHODS = ("laplace", "profile", "posterior")
_UNINFORMED = 0.9  # share of its prior's width that a value still has


@dataclass(frozen=True)
class Question:
    """Result of a search, and the joint density around it.

    Attributes
    ----------
    problem : that was searched
    actuator : of the twin
    assessed : its values with Laplace's intervals
    joint : the joint density of all that is free
    thresholds : by fault
    """

    problem: Problem
    actuator: ParameterSet
    assessed: Assessment
    joint: Joint
    thresholds: Mapping[str, Threshold] = field(default_factory=dict)

    @property
    def sets(self) -> FaultSets:
        """The posterior of sets of faults around its minima."""
        assert self.assessed.sets is not None
        return self.assessed.sets

    @property
    def faults(self) -> tuple[Unknown, ...]:
        """Magnitudes of the faults that were searched."""
        every = self.problem.unknowns
        return tuple(one for one in every if one.role == "fault" and one.direction_of is None)


@dataclass(frozen=True)
class Uncertainty:
    """Intervals and probabilities of an identification.

    Attributes
    ----------
    method : "laplace", "profile" or "posterior"
    intervals : by name, ends of the 95 % interval
    present : by fault, the probability that it deviates by `constants.SMALLEST` of its range
        (`ematwin.estimation.spike_and_slab`)
    healthy : the probability that none does
    exceeds : by fault, the probability that it lies beyond its threshold
    thresholds : by fault, as it was given, with its unit
    doubts : sentences on why not to believe it
    draws : of everything that is unknown
    """

    method: str
    intervals: dict[str, tuple[float, float]]
    present: dict[str, float]
    healthy: float
    exceeds: dict[str, float]
    thresholds: dict[str, str]
    doubts: tuple[str, ...]
    draws: Draws

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, without the draws."""
        return {
            "method": self.method,
            "intervals": {name: list(ends) for name, ends in self.intervals.items()},
            "present": self.present,
            "healthy": self.healthy,
            "exceeds": {
                name: {"threshold": self.thresholds[name], "probability": share}
                for name, share in self.exceeds.items()
            },
            "doubts": list(self.doubts),
        }

    @property
    def headings(self) -> tuple[str, ...]:
        """Of `rows`."""
        return "fault", "95 %", "probability of a fault"

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """A row for each fault, for people."""
        return [
            (name, "{:.4g} to {:.4g}".format(*self.intervals[name]), as_probability(share))
            for name, share in self.present.items()
        ]

    @property
    def sentences(self) -> list[str]:
        """Probabilities in words."""
        healthy = as_probability(self.healthy)
        said = [f"No fault of {100 * SMALLEST:g} % of its range or more: {healthy}."]
        for name, share in self.exceeds.items():
            said.append(f"{name} is beyond {self.thresholds[name]}: {as_probability(share)}.")
        return said

    def __str__(self) -> str:
        rows = ["".join(f"{cell:<24}" for cell in row) for row in (self.headings, *self.rows)]
        doubts = [f"Doubt: {sentence}" for sentence in self.doubts]
        return "\n".join([f"By {self.method}:", *rows, *self.sentences, *doubts])


class Method(Protocol):
    """Method that finds an `Uncertainty`."""

    @property
    def name(self) -> str:
        """One of `METHODS`."""
        ...

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """The answer; after Ctrl-C the best until then, which its doubts say."""
        ...


@dataclass(frozen=True)
class LaplaceIntervals:
    """The intervals of `assess`: a normal distribution around the best point, within the bounds."""

    name: str = "laplace"

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """The answer, without a simulation."""
        sets = question.sets
        ends = {name: (one.low, one.high) for name, one in question.assessed.intervals.items()}
        doubts = (*strained(question), *uninformed(question, sets.drawn))
        return Uncertainty(self.name, ends, **by_sets(question, sets, sets.drawn), doubts=doubts)


def named(method: "str | Method") -> Method:
    """The method that a name or a method means.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if not isinstance(method, str):
        return method
    if method == "laplace":
        return LaplaceIntervals()
    if method == "profile":
        from ematwin.estimation.profile import Profiles

        return Profiles()
    if method == "posterior":
        from ematwin.estimation.posterior import Posterior

        return Posterior()
    raise InputError(f"uncertainty must be {', '.join(METHODS)}, received {method!r}.")


def by_sets(question: Question, sets: FaultSets, drawn: Draws) -> dict[str, Any]:
    """Probabilities by sets of faults, as arguments of `Uncertainty`; ``drawn`` is to be shown."""
    limits, actuator = question.thresholds.items(), question.actuator

    def beyond(one: Threshold) -> float:
        return sets.share(lambda drawn: one.is_beyond(actuator, drawn))

    return {
        "present": sets.probabilities,
        "healthy": 1.0 - sets.faulty,
        "exceeds": {name: beyond(one) for name, one in limits},
        "thresholds": {name: one.text for name, one in limits},
        "draws": drawn,
    }


def predicted(
    drawn: Draws,
    held: Mapping[str, float],
    comparison: Comparison,
    count: int = 80,
) -> dict[str, np.ndarray]:
    """Bands of the model's answers by compared channel: (3, S), 2.5 %, 50 % and 97.5 % of draws.

    Parameters
    ----------
    drawn : of the unknowns
    held : values of the others, by name
    comparison : beside the recording
    count : draws that are simulated
    """
    chosen = np.linspace(0, len(drawn.values) - 1, count).astype(int)
    candidates = {name: np.full(count, value) for name, value in held.items()}
    candidates |= {name: drawn.of(name)[chosen] for name in drawn.names}
    answers = comparison.responses(candidates, count)
    return {n: np.quantile(one, [0.025, 0.5, 0.975], axis=0) for n, one in answers.items()}


def strained(question: Question) -> list[str]:
    """Sentences on priors that the recording contradicts."""
    return [
        f"The recording puts {name} {away:.1f} standard deviations from its known value: correct "
        "the value, widen its tolerance, or check the channels."
        for name, away in question.assessed.strained.items()
    ]


def uninformed(question: Question, drawn: Draws) -> list[str]:
    """Sentences on faults and parameters about which the recording holds no information."""
    faults: list[str] = []
    rest: list[str] = []
    prior = question.joint.problem.prior
    widths = dict(zip(prior.names, np.sqrt(np.diag(prior.covariance)).tolist(), strict=True))
    for one in question.joint.problem.unknowns:
        x = drawn.of(one.name)
        if one.direction_of is not None:
            continue
        if one.name in widths:
            spread = float(np.std(np.log(x) if one.logarithmic else x))
            if spread > _UNINFORMED * widths[one.name]:
                (faults if one.role == "fault" else rest).append(one.name)
        elif float(np.std(x)) > ANYTHING * one.width:
            faults.append(one.name)
    said = []
    if faults:
        said.append(tells_nothing(faults))
    if rest:
        said.append(f"The recording adds nothing to the prior of {listed(rest)}.")
    return said


def tells_nothing(faults: Sequence[str]) -> str:
    """Sentence: a recording holds no information on faults."""
    return (
        f"The recording holds no information on {listed(faults)}; the interval is that of the "
        "prior. Use a command that moves the actuator more."
    )


def as_probability(share: float) -> str:
    """ "34 %"; never quite 0 or 100, which no finite number of draws tells."""
    if share < 0.005:
        return "below 1 %"
    if share > 0.995:
        return "above 99 %"
    return f"{100.0 * share:.0f} %"
