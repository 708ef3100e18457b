"""What an identification gives: a verdict, and values with their intervals."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ematwin.estimation.estimate import Estimate
from ematwin.estimation.uncertainty import Uncertainty
from ematwin.estimation.verdict import Verdict
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.models.unknown import PhysicalValue
from ematwin.recordings.recording import Recording
from ematwin.showing.results import drawn, frame, html, page_written, plain
from ematwin.showing.text import counted, number_of, said, said_between, with_interval


@dataclass(frozen=True)
class Identification:
    """Result of an identification from a recording.

    Attributes
    ----------
    verdict : Verdict: healthy, changed, the faults by name, or none with the reason
    estimate : Estimate, the values with their covariance
    faults : values with which the twin answers as the recording does: `Faults` for the brushless
        actuator, else a dict
    cost : float, misfit over the whole recording at the end of the search, before parameters and
        sensors are freed; for the brushless actuator eq. 2 of the paper, A s
    evaluations : int, simulations that the search took
    reference_runs : int, answers of the reference model by which these were corrected; 0 where the
        kind has none
    seconds : float, wall time of the search and of the intervals
    history : (B, 2) array, evaluations and best cost so far
    algorithm, seed : what searched, and from which seed
    stopped : why it ended
    searched : names of the searched unknowns; the others were held
    warnings : sentences on doubts
    assumed : sentences on assumptions made in reading the recording
    actuator : its parameters
    provenance : where the recording comes from
    intervals : by name, low and high end of what holds the true value in 95 %
    physical_values : what was searched, in physical units: value, low and high end by name
    contrasts : combinations of faults, value and interval by name
    nuisances : load and sensors that are clearly not as recorded, value and interval by name
    others : other answers that explain the recording nearly as well, values by name
    fitted : values of parameters, load and sensors with which the twin answers, by name
    calibrated : whether the twin was fitted to healthy recordings of the actuator
    recording : the data, for figures
    uncertainty : of the estimate, where that was asked for; None after an interruption
    probabilities : by searched fault, that it is as large as matters; none after an interruption
    """

    verdict: Verdict
    estimate: Estimate
    faults: Any
    cost: float
    evaluations: int
    seconds: float
    history: np.ndarray
    algorithm: str
    seed: int
    stopped: str
    searched: tuple[str, ...]
    warnings: list[str]
    assumed: list[str]
    actuator: ParameterSet
    recording: Recording = field(repr=False, compare=False)
    provenance: dict[str, Any] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    physical_values: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    contrasts: Mapping[str, tuple[float, tuple[float, float]]] = field(default_factory=dict)
    nuisances: Mapping[str, tuple[float, tuple[float, float]]] = field(default_factory=dict)
    others: tuple[dict[str, float], ...] = ()
    fitted: dict[str, float] = field(default_factory=dict)
    calibrated: bool = False
    uncertainty: Uncertainty | None = None
    reference_runs: int = 0
    probabilities: dict[str, float] = field(default_factory=dict)

    @property
    def model(self) -> Model:
        """The kind of its actuator."""
        return model_of(self.actuator)

    @property
    def values(self) -> dict[str, float]:
        """All values by name, searched and held."""
        here = {*self.estimate.held, *self.estimate.names}
        own = [one.name for one in self.model.unknowns(self.actuator) if one.name in here]
        return {name: self.estimate[name] for name in (*own, *sorted(here - set(own)))}

    @property
    def standard_error(self) -> dict[str, float]:
        """Name to standard error of each searched unknown; see `ematwin.estimation.assess`."""
        return self.estimate.standard_errors

    @property
    def relative_misfit(self) -> float:
        """Root of the ratio of the cost to the cost of an unresponsive twin; 0 is perfect."""
        return self.estimate.misfit

    @property
    def present(self) -> tuple[str, ...]:
        """Names of the faults that the verdict names."""
        return self.verdict.faults

    @property
    def physical(self) -> list[PhysicalValue]:
        """What each value means on the actuator, parameters that were searched included."""
        values, actuator = self.values, self.actuator
        rows = [
            row._replace(value=self.physical_values[row.name][0])
            if row.name in self.physical_values
            else row
            for row in self.model.describe(actuator, values)
        ]
        known = {row.name for row in rows}
        places = [name for name in values if name not in known and "." in name]
        return rows + [
            self.model.unknown(actuator, place).physical_value(actuator, values[place])
            for place in places
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as ``ematwin identify --json`` prints them."""
        return plain({
            "verdict": self.verdict,
            "intervals": self.intervals,
            "calibrated": self.calibrated,
            "faults": self.values,
            "standard_error": self.standard_error,
            "probability": self.probabilities,
            "physical": {
                row.name: {
                    "value": row.value, "healthy": row.healthy, "unit": row.unit,
                    **dict(zip(("low", "high"), self._physical_ends(row.name), strict=False)),
                }
                for row in self.physical
            },
            "contrasts": _spans(self.contrasts),
            "nuisances": _spans(self.nuisances),
            "other_answers": self.others,
            "present": self.present,
            **{
                name: getattr(self, name)
                for name in (
                    "cost", "relative_misfit", "evaluations", "reference_runs", "seconds",
                    "algorithm", "seed", "stopped", "searched", "warnings", "assumed",
                )
            },
            "actuator": self.actuator.name,
            "kind": self.estimate.kind,
            "estimate": self.estimate.as_dict(),
            "provenance": self.provenance,
            "uncertainty": None if self.uncertainty is None else self.uncertainty.as_dict(),
        })  # fmt: skip

    def _physical_ends(self, name: str) -> tuple[float, ...]:
        """Low and high end; none where there is no interval."""
        return self.physical_values.get(name, ())[1:]

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each fault, by name; needs pandas."""
        rows = []
        for row in self.physical:
            low, high = self._physical_ends(row.name) or (math.nan, math.nan)
            k_low, k_high = self.intervals.get(row.name, (math.nan, math.nan))
            rows.append({
                "fault": row.name, "value": row.value, "low": low, "high": high,
                "healthy": row.healthy, "unit": row.unit, "k": row.normalised, "k_low": k_low,
                "k_high": k_high, "present": row.name in self.present, "meaning": row.meaning,
            })  # fmt: skip
        return frame(rows, "fault")

    to_dataframe = to_frame

    def plot(self, kind: str = "faults") -> Any:
        """A figure of plotly: "faults" (deviations from healthy), "fit" or "convergence"."""
        return drawn(self, kind, {one: f"plot_{one}" for one in ("faults", "fit", "convergence")})

    def report(self, path: str | Path) -> None:
        """Write its page (.html), which holds all that it shows."""
        page_written(self, path, "report.identification:identification_page")

    def _repr_html_(self) -> str:
        """The verdict, then the faults, in a notebook."""
        rows = [
            (row.name, row.value, row.interval, row.healthy, row.meaning)
            for row in fault_cells(self)
        ]
        marked = [n for n, row in enumerate(self.physical) if row.name in self.present]
        misfit = f"{self.actuator.name}, misfit {100.0 * self.relative_misfit:.2f} %, {self.effort}"
        return html(
            self.verdict.sentence, ("fault", "value", "95 %", "healthy", "meaning"), rows,
            [misfit, *self._notes], grade=self.verdict.grade, marked=marked,
        )  # fmt: skip

    @property
    def _notes(self) -> list[str]:
        assumed = [f"Assumed: {sentence}" for sentence in self.assumed]
        return [*assumed, *(f"Warning: {warning}" for warning in self.warnings)]

    @property
    def effort(self) -> str:
        """Effort of the search, in words."""
        spent = counted(self.evaluations, "simulation")
        return f"{spent} in {self.seconds:.2f} s with {self.algorithm}"

    def __str__(self) -> str:
        lines = [self.verdict.sentence, ""]
        lines += [
            f"{row.name:<19} {row.value:>14}  {row.interval:>20}  {row.meaning}"
            + ("  <" if row.name in self.present else "")
            for row in fault_cells(self)
        ]
        lines.append(
            f"misfit {100.0 * self.relative_misfit:.2f} %, {self.effort}; stopped: {self.stopped}"
        )
        lines += self._notes
        if self.uncertainty is not None:
            lines += ["", str(self.uncertainty)]
        return "\n".join(lines)


def _spans(found: Mapping[str, tuple[float, tuple[float, float]]]) -> dict[str, dict[str, float]]:
    return {
        name: {"value": value, "low": low, "high": high}
        for name, (value, (low, high)) in found.items()
    }


class FaultCells(NamedTuple):
    """A fault as a row of a table; ``interval`` and ``k_interval`` are "held" without one."""

    name: str
    value: str  # with its unit
    interval: str
    healthy: str
    k: str
    k_interval: str
    meaning: str


def fault_cells(found: Identification) -> list[FaultCells]:
    """Values of an identification for people, with the digits that their intervals deserve."""
    rows = []
    for row in found.physical:
        value, between = said(row.value, row.unit), "held"
        if row.name in found.physical_values:
            value, between = said_between(*found.physical_values[row.name], row.unit)
        k, ends = number_of(row.normalised, ""), "held"
        if row.name in found.intervals:
            k, ends = with_interval(row.normalised, *found.intervals[row.name])
        healthy = number_of(row.healthy, row.unit)
        rows.append(FaultCells(row.name, value, between, healthy, k, ends, row.meaning))
    return rows
