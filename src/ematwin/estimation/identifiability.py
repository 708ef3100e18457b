"""What a command can tell of the faults of an actuator, before anything is recorded.

The twin answers the command, and the width of the posterior at the true values
(`ematwin.estimation.expected`) is the covariance that `identify` would find, without a search.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.baseline import Baseline, baseline_of
from ematwin.estimation.constants import ANYTHING, PARTNERS, SIGMAS, SMALLEST, TRADED
from ematwin.estimation.expected import width_of
from ematwin.estimation.laplace import sharp_errors, standard_errors
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import PhysicalValue, Unknown
from ematwin.recordings.noise import Noise
from ematwin.showing import markup
from ematwin.showing.drawing import drawn
from ematwin.showing.frames import frame_of_rows

FALSE_ALARM, MISS = 1.0 - NormalDist().cdf(SIGMAS), 0.1
HEADINGS = (
    "fault", "standard error", "all else known", "smallest found", "that is", "",
)  # fmt: skip
_PARTNER = 0.5  # correlation from which another is named


@dataclass(frozen=True)
class Told:
    """What a command tells of one fault.

    Attributes
    ----------
    name, meaning : of the fault
    value, range : where it was looked at, and upper less lower bound
    error : standard error, with parameters, load and sensors as uncertain as they are
    sharp_error : standard error if all of them were known exactly
    smallest : float, least deviation from healthy that is found with the rates that were asked for;
        infinite if none within the range is
    physical : the value that deviates so much, in physical units; None if there is none
    how : "pinned"; "traded" (others widen its error `TRADED` times or more); "open" (it may be
        anything); "dead" (it hardly shows, even if all else is known)
    partners : what widens it, with the correlation, the strongest first
    """

    name: str
    meaning: str
    value: float
    range: float
    error: float
    sharp_error: float
    smallest: float
    physical: PhysicalValue | None
    how: str
    partners: tuple[tuple[str, float], ...]

    @property
    def sentence(self) -> str:
        """How well it is told, in words."""
        against = " and ".join(f"{name} ({r:+.2f})" for name, r in self.partners)
        if self.how == "dead":
            return "does not show"
        if self.how == "open":
            return f"may be anything: {against}" if against else "may be anything"
        if self.how == "traded":
            return f"traded off against {against}" if against else "widened by many others"
        return "well told"

    @property
    def weakness(self) -> tuple[float, float]:
        """What faults are ordered by: the smallest that is found, then the error, as shares."""
        return self.smallest / self.range, self.error / self.range

    @property
    def cells(self) -> list[str]:
        """Its row in a table for people, below `HEADINGS`."""
        shown = self.physical
        return [
            self.name,
            f"{self.error:.2g}",
            f"{self.sharp_error:.2g}",
            f"{self.smallest:.2g}" if math.isfinite(self.smallest) else "none",
            "" if shown is None else f"{shown.value:.4g} {shown.unit}".rstrip(),
            self.sentence,
        ]


@dataclass(frozen=True)
class Identifiability:
    """What a command tells of all faults of an actuator.

    Attributes
    ----------
    scenario, actuator : of the command, and of the twin
    faults : values by name at which slopes were taken
    told : one for each fault but directions
    contrasts : standard errors of combinations of faults, by name
    names, correlation : of all that is unknown, and (d, d) array; vectors by component
    noise : relative misfit that noise and the twin's own error leave
    obstacles : sentences on why no verdict would be given on such a recording
    false_alarm, miss : rates to which ``smallest`` belongs
    """

    scenario: Scenario
    actuator: ParameterSet
    faults: dict[str, float]
    told: tuple[Told, ...]
    contrasts: dict[str, float]
    names: tuple[str, ...]
    correlation: np.ndarray
    noise: float
    obstacles: tuple[str, ...]
    false_alarm: float
    miss: float

    @property
    def weakest(self) -> Told:
        """The fault of which least can be told, as a share of its range."""
        return max(self.told, key=lambda one: one.weakness)

    def __getitem__(self, fault: str) -> Told:
        for one in self.told:
            if one.name == fault:
                return one
        raise KeyError(fault)

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each fault, by name; needs pandas."""
        return frame_of_rows(
            (
                {
                    "fault": one.name, "standard_error": one.error, "sharp_error": one.sharp_error,
                    "smallest": one.smallest, "range": one.range, "how": one.how,
                    "sentence": one.sentence,
                }
                for one in self.told
            ),
            "fault",
        )  # fmt: skip

    to_dataframe = to_frame

    def plot(self, kind: str = "smallest") -> Any:
        """A figure of plotly: "smallest" (fault that is found) or "correlation"."""
        return drawn(self, kind, {"smallest": "plot_smallest", "correlation": "plot_correlation"})

    def _repr_html_(self) -> str:
        """What is told least, then all of it, in a notebook."""
        weak = self.weakest
        lead = f"{self.scenario.name}: {weak.name} {weak.sentence}."
        if all(one.how == "pinned" for one in self.told):
            lead = f"{self.scenario.name} tells all faults."
        marked = [n for n, one in enumerate(self.told) if one.how in ("open", "dead")]
        return "".join(
            [
                markup.verdict(lead, "changed" if marked else "healthy"),
                markup.table(HEADINGS, (one.cells for one in self.told), marked),
                *(markup.note(sentence) for sentence in self.obstacles),
            ]
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; what is infinite is null."""
        return {
            "scenario": self.scenario.name,
            "duration": self.scenario.duration,
            "actuator": self.actuator.name,
            "faults": self.faults,
            "noise": self.noise,
            "obstacles": list(self.obstacles),
            "false_alarm": self.false_alarm,
            "miss": self.miss,
            "weakest": self.weakest.name,
            "told": [_told_as_dict(one) for one in self.told],
            "contrasts": self.contrasts,
            "names": list(self.names),
            "correlation": self.correlation.tolist(),
        }


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
    faults : values at which slopes are taken; what is not named deviates from healthy by
        `significance.SMALLEST` of its range, as a fault does that is only just one
    noise : of the sensors; None for that which the kind simulates by itself
    exact : parameters, load and sensors are known exactly
    false_alarm : probability that a healthy value is taken for a fault
    miss : probability that the smallest fault which counts as detectable is overlooked
    sample_rate : float, Hz; None takes the kind's
    seed : of the noise
    threads : that share a batch; None takes one for each core

    Raises
    ------
    InputError
        If an argument cannot be used.
    """
    for name, rate in (("false_alarm", false_alarm), ("miss", miss)):
        if not 0.0 < rate < 0.5:
            raise InputError(f"{name} must lie between 0 and 0.5, received {rate:g}.")
    chosen = load_actuator(actuator)
    model = model_of(chosen)
    asked = model.load_scenario(scenario)
    values = model.values_of(chosen, {**_just_faulty(model, chosen), **(faults or {})})
    recording = model.simulate(
        chosen, asked, values, noise=noise, seed=seed, sample_rate=sample_rate
    )  # fmt: skip
    baseline = Baseline.of_simulation() if exact else baseline_of(actuator, chosen)
    peak = width_of(model, chosen, baseline, recording, values, threads=threads)
    full, factor = peak.problem, peak.problem.model_error
    covariance = peak.widened(factor)
    errors = standard_errors(full.chart, peak.z, covariance)
    searched = sum(o.role in ("fault", "nuisance") and not o.marginal for o in full.unknowns)
    sharp = sharp_errors(peak, searched, factor)
    spread = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(spread, spread)
    needed = NormalDist().inv_cdf(1.0 - false_alarm) + NormalDist().inv_cdf(1.0 - miss)
    obstacles = tuple(model.excitation(recording, chosen))
    if obstacles:
        needed = math.inf  # no fault is named, however large
    told = []
    for n, one in enumerate(full.unknowns):
        if one.role == "fault" and one.direction_of is None:
            others = _partners(full, n, correlation[n])
            pair = float(errors[n]), float(sharp[n])
            told.append(_told(chosen, one, values[one.name], pair, needed, others))
    return Identifiability(
        scenario=asked,
        actuator=chosen,
        faults={one.name: values[one.name] for one in full.unknowns if one.role == "fault"},
        told=tuple(told),
        contrasts=_contrasts(model, chosen, full, covariance),
        names=full.chart.names,
        correlation=correlation,
        noise=full.relative_misfit(peak.cost),
        obstacles=obstacles,
        false_alarm=false_alarm,
        miss=miss,
    )


def ranked(found: Sequence[Identifiability]) -> list[Identifiability]:
    """Commands by the fault of which each tells least, the most telling command first."""
    return sorted(found, key=lambda one: one.weakest.weakness)


def _just_faulty(model: Model, actuator: ParameterSet) -> dict[str, float]:
    """Values off their healthy ones and bounds, so that slopes to both sides mean something."""
    found = {}
    for one in model.faults(actuator):
        if one.direction_of is None:
            step = SMALLEST * one.width
            found[one.name] = one.healthy + (step if one.healthy + step < one.upper else -step)
    return found


def _told(
    actuator: ParameterSet,
    one: Unknown,
    value: float,
    errors: tuple[float, float],
    needed: float,
    others: tuple[tuple[str, float], ...],
) -> Told:
    """What errors mean for a fault: the standard error, and that if all else were known.

    ``needed`` of the first are a detectable deviation.
    """
    error, sharp_error = errors
    smallest = max(SMALLEST * one.width, needed * error)
    up, down = one.upper - one.healthy, one.healthy - one.lower
    physical = None
    if smallest > max(up, down) or error > ANYTHING * one.width:
        smallest = math.inf
    else:
        physical = one.physical_value(actuator, one.healthy + smallest * (1 if up >= down else -1))
    if sharp_error > ANYTHING * one.width:
        how = "dead"
    elif error > ANYTHING * one.width:
        how = "open"
    else:
        how = "traded" if error > TRADED * sharp_error else "pinned"
    return Told(
        one.name, one.meaning, value, one.width, error, sharp_error, smallest, physical,
        how, others if how in ("open", "traded") else (),
    )  # fmt: skip


def _partners(full: Problem, n: int, correlation: np.ndarray) -> tuple[tuple[str, float], ...]:
    """What moves along with an unknown, by the correlation (d,); what is no fault comes first.

    Equal shorts move along with one another because each moves along with the torque constant.
    """
    along = [k for k in range(len(correlation)) if k != n and abs(correlation[k]) >= _PARTNER]
    along.sort(key=lambda k: (full.unknowns[k].role == "fault", -abs(correlation[k])))
    return tuple((full.chart.names[k], float(correlation[k])) for k in along[:PARTNERS])


def _contrasts(
    model: Model, actuator: ParameterSet, full: Problem, covariance: np.ndarray
) -> dict[str, float]:
    """Standard errors of the combinations of faults that a kind reports."""
    found = {}
    for one in model.contrasts(actuator):
        if set(one.weights) <= set(full.names):
            way = np.zeros(len(full.names))
            for name, weight in one.weights.items():
                n = full.names.index(name)
                way[n] = weight * full.chart.widths[n]
            found[one.name] = float(np.sqrt(way @ covariance @ way))
    return found


def _told_as_dict(one: Told) -> dict[str, Any]:
    finite = {
        name: value if math.isfinite(value) else None
        for name, value in (
            ("error", one.error), ("sharp_error", one.sharp_error), ("smallest", one.smallest),
        )
    }  # fmt: skip
    shown = None
    if one.physical is not None:
        shown = {"value": one.physical.value, "unit": one.physical.unit}
    return {
        "name": one.name, "meaning": one.meaning, "value": one.value, **finite,
        "smallest_physical": shown, "how": one.how, "sentence": one.sentence,
        "partners": dict(one.partners),
    }  # fmt: skip
