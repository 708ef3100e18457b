"""Identifiability of faults from the answer to a command, before anything is recorded.

It is read from the expected posterior of a simulated recording (`ematwin.experiments.experiment`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import ANYTHING, PARTNERS, SIGMAS, SMALLEST, TRADED
from ematwin.experiments.experiment import Expected, Experiment
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import PhysicalValue, Unknown
from ematwin.recordings.noise import Noise
from ematwin.showing.results import drawn, frame, html, plain

FALSE_ALARM, MISS = 1.0 - NormalDist().cdf(SIGMAS), 0.1
HEADINGS = (
    "fault", "standard error", "all else known", "smallest found", "that is", "",
)  # fmt: skip


@dataclass(frozen=True)
class FaultIdentifiability:
    """Identifiability of one fault."""

    name: str
    meaning: str
    value: float  # value, range: where slopes were taken, and upper less lower bound
    range: float
    error: float  # standard error, with parameters, load and sensors as uncertain as they are
    sharp_error: float  # standard error if all of them were known exactly
    # least deviation from healthy that is found with the rates that were asked for; infinite if
    # none within the range is
    smallest: float
    # the value that deviates so much, in physical units; None if there is none
    physical: PhysicalValue | None
    # "pinned"; "traded" (others widen its error `TRADED` times or more); "open" (it may be
    # anything); "dead" (it hardly shows, even if all else is known)
    how: str
    # what widens it, with the correlation, the strongest first
    partners: tuple[tuple[str, float], ...]

    @property
    def sentence(self) -> str:
        """Identifiability in words."""
        against = " and ".join(f"{name} ({r:+.2f})" for name, r in self.partners)
        if self.how == "dead":
            return "does not show"
        if self.how == "open":
            return f"may be anything: {against}" if against else "may be anything"
        if self.how == "traded":
            return f"traded off against {against}" if against else "widened by many others"
        return "well determined"

    @property
    def weakness(self) -> tuple[float, float]:
        """Order of faults: the smallest that is found, then the error, as shares."""
        return self.smallest / self.range, self.error / self.range

    @property
    def cells(self) -> list[str]:
        """Its row in a table for people, below `HEADINGS`."""
        shown = self.physical
        smallest = f"{self.smallest:.2g}" if math.isfinite(self.smallest) else "none"
        physical = "" if shown is None else shown.said[0]
        errors = f"{self.error:.2g}", f"{self.sharp_error:.2g}"
        return [self.name, *errors, smallest, physical, self.sentence]

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; infinite ones are null."""
        shown = self.physical
        told = {name: x for name, x in vars(self).items() if name not in ("range", "physical")}
        return plain(told | {
            "smallest_physical": shown and {"value": shown.value, "unit": shown.unit},
            "sentence": self.sentence, "partners": dict(self.partners),
        })  # fmt: skip


@dataclass(frozen=True)
class Identifiability:
    """Identifiability of all faults of an actuator from its answer to a command."""

    scenario: Scenario  #: the command
    actuator: ParameterSet  # of the twin
    faults: dict[str, float]  #: values by name at which slopes were taken
    told: tuple[FaultIdentifiability, ...]  #: of each fault but directions
    contrasts: dict[str, float]  #: standard errors of combinations of faults, by name
    names: tuple[str, ...]  #: of all d unknowns; vectors by component
    correlation: np.ndarray  #: (d, d), of these
    noise: float  #: relative misfit that noise and the twin's own error leave
    obstacles: tuple[str, ...]  #: sentences on why no verdict would be given on such a recording
    false_alarm: float  #: false_alarm, miss: rates to which ``smallest`` belongs
    miss: float

    @property
    def weakest(self) -> FaultIdentifiability:
        """The fault that is least identifiable, as a share of its range."""
        return max(self.told, key=lambda one: one.weakness)

    @property
    def lead(self) -> str:
        """The least identifiable fault, in words."""
        if all(one.how == "pinned" for one in self.told):
            return f"{self.scenario.name} determines all faults."
        return f"{self.scenario.name}: {self.weakest.name} {self.weakest.sentence}."

    def __getitem__(self, fault: str) -> FaultIdentifiability:
        return {one.name: one for one in self.told}[fault]

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each fault, by name; needs pandas."""
        shown = ("sharp_error", "smallest", "range", "how", "sentence")
        rows = (
            {"fault": one.name, "standard_error": one.error, **{n: getattr(one, n) for n in shown}}
            for one in self.told
        )
        return frame(rows, "fault")

    to_dataframe = to_frame

    def plot(self, kind: str = "smallest") -> Any:
        """A figure of plotly: "smallest" (fault that is found) or "correlation"."""
        return drawn(self, kind, {"smallest": "plot_smallest", "correlation": "plot_correlation"})

    def _repr_html_(self) -> str:
        """The lead, then all faults, in a notebook."""
        marked = [n for n, one in enumerate(self.told) if one.how in ("open", "dead")]
        rows, grade = [one.cells for one in self.told], "changed" if marked else "healthy"
        return html(self.lead, HEADINGS, rows, self.obstacles, grade=grade, marked=marked)

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; infinite ones are null."""
        told = {
            "scenario": self.scenario.name, "duration": self.scenario.duration,
            "actuator": self.actuator.name, "weakest": self.weakest.name,
            "told": [one.as_dict() for one in self.told],
        }  # fmt: skip
        return plain({**vars(self), **told})


def identifiability(
    scenario: Scenario | str | Path | None = None,
    actuator: ParameterSet | str | Path | Any | None = None,
    *,
    faults: Mapping[str, float] | None = None,
    noise: Noise | None = None,
    exact: bool = False,
    false_alarm: float = FALSE_ALARM,
    miss: float = MISS,
    sample_rate: float | None = None,
    seed: int = 1,
    threads: int | None = None,
) -> Identifiability:
    """How well the faults of an actuator could be identified from its answer to a command.

    Parameters
    ----------
    scenario : the command: a `Scenario`, the name of a shipped one, a file, or a recording (.csv,
        .parquet) whose command is taken; None takes the kind's default
    actuator : a parameter set of any kind, its name or file; calibrated or not
    faults : values at which slopes are taken; all others deviate from healthy by
        `constants.SMALLEST` of its range, as a fault does that is only just one
    noise, exact, sample_rate, threads : as in `ematwin.design`
    false_alarm : probability that a healthy value is taken for a fault
    miss : probability that the smallest fault which counts as detectable is overlooked
    seed : of the noise

    Raises
    ------
    InputError
        If an argument cannot be used.
    """
    for name, rate in (("false_alarm", false_alarm), ("miss", miss)):
        if not 0.0 < rate < 0.5:
            raise InputError(f"{name} must lie between 0 and 0.5, received {rate:g}.")
    experiment = Experiment.of(
        actuator, exact=exact, noise=noise, sample_rate=sample_rate, seed=seed, threads=threads
    )
    model, chosen = experiment.model, experiment.actuator
    asked = model.load_scenario(scenario)
    values = model.values_of(chosen, {**_just_faulty(experiment), **(faults or {})})
    recording = experiment.record(asked, values)
    expected = experiment.expected(recording, values)
    needed = NormalDist().inv_cdf(1.0 - false_alarm) + NormalDist().inv_cdf(1.0 - miss)
    obstacles = tuple(model.excitation(recording, chosen))
    if obstacles:
        needed = math.inf  # no fault is named, however large
    problem = expected.problem
    return Identifiability(
        scenario=asked,
        actuator=chosen,
        faults={one.name: values[one.name] for one in problem.unknowns if one.role == "fault"},
        told=tuple(
            _identifiability(chosen, one, values[one.name], expected, needed)
            for one in experiment.magnitudes
        ),
        contrasts={
            one.name: expected.error_of(one.weights)
            for one in model.contrasts(chosen)
            if set(one.weights) <= set(problem.names)
        },
        names=problem.chart.names,
        correlation=expected.correlation,
        noise=problem.relative_misfit(expected.peak.cost),
        obstacles=obstacles,
        false_alarm=false_alarm,
        miss=miss,
    )


def ranked(found: Sequence[Identifiability]) -> list[Identifiability]:
    """Commands by their least identifiable fault, the best command first."""
    return sorted(found, key=lambda one: one.weakest.weakness)


def _just_faulty(experiment: Experiment) -> dict[str, float]:
    """Values off their healthy ones and bounds, so that slopes to both sides mean something."""
    found = {}
    for one in experiment.magnitudes:
        step = SMALLEST * one.width
        found[one.name] = one.healthy + (step if one.healthy + step < one.upper else -step)
    return found


def _identifiability(
    actuator: ParameterSet, one: Unknown, value: float, expected: Expected, needed: float
) -> FaultIdentifiability:
    """Identifiability of a fault; ``needed`` standard errors are a detectable deviation."""
    error, sharp_error = expected.errors[one.name], expected.sharp_errors[one.name]
    smallest = max(SMALLEST * one.width, needed * error)
    up, down = one.upper - one.healthy, one.healthy - one.lower
    physical = None
    if smallest > max(up, down) or error > ANYTHING * one.width:
        smallest = math.inf
    else:
        physical = one.physical_value(actuator, one.healthy + smallest * (1 if up >= down else -1))
    how = "traded" if error > TRADED * sharp_error else "pinned"
    if error > ANYTHING * one.width:
        how = "open"
    if sharp_error > ANYTHING * one.width:
        how = "dead"
    partners = _partners(expected, one.name) if how in ("open", "traded") else ()
    return FaultIdentifiability(
        one.name, one.meaning, value, one.width, error, sharp_error, smallest, physical, how,
        partners,
    )  # fmt: skip


def _partners(expected: Expected, name: str) -> tuple[tuple[str, float], ...]:
    """Unknowns correlated with one, those that are no faults first.

    Equal shorts move along with one another because each moves along with the torque constant.
    """
    problem = expected.problem
    n = problem.names.index(name)
    row = expected.correlation[n]
    along = [k for k in range(len(row)) if k != n and abs(row[k]) >= 0.5]
    along.sort(key=lambda k: (problem.unknowns[k].role == "fault", -abs(row[k])))
    return tuple((problem.chart.names[k], float(row[k])) for k in along[:PARTNERS])
