"""What an identification gives: a verdict, and values with their intervals."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ematwin.estimation.estimate import Estimate
from ematwin.estimation.findings import fault_cells
from ematwin.estimation.verdict import Verdict
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.models.unknown import PhysicalValue
from ematwin.recordings.recording import Recording
from ematwin.showing import markup
from ematwin.showing.results import drawn, frame_of_rows, page_written
from ematwin.showing.text import counted

if TYPE_CHECKING:
    from ematwin.estimation.uncertainty import Uncertainty


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
    physical_values : faults in their physical units: value, low and high end by name
    contrasts : combinations of faults, value and interval by name
    nuisances : load and sensors that are clearly not as recorded, value and interval by name
    others : other answers that explain the recording nearly as well, values by name
    fitted : values of parameters, load and sensors with which the twin answers, by name
    calibrated : whether the twin was fitted to healthy recordings of the actuator
    recording : the data, for figures; None where it was not kept
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
    provenance: dict[str, Any] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    physical_values: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    contrasts: dict[str, tuple[float, tuple[float, float]]] = field(default_factory=dict)
    nuisances: dict[str, tuple[float, tuple[float, float]]] = field(default_factory=dict)
    others: tuple[dict[str, float], ...] = ()
    fitted: dict[str, float] = field(default_factory=dict)
    calibrated: bool = False
    recording: Recording | None = field(default=None, repr=False, compare=False)
    uncertainty: "Uncertainty | None" = None
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
        return {
            "verdict": self.verdict.as_dict(),
            "intervals": {name: list(ends) for name, ends in self.intervals.items()},
            "calibrated": self.calibrated,
            "faults": self.values,
            "standard_error": {
                name: value if math.isfinite(value) else None
                for name, value in self.standard_error.items()
            },
            "probability": self.probabilities,
            "physical": {
                row.name: {
                    "value": row.value,
                    "healthy": row.healthy,
                    "unit": row.unit,
                    **self._physical_ends(row.name),
                }
                for row in self.physical
            },
            "contrasts": {
                name: {"value": value, "low": low, "high": high}
                for name, (value, (low, high)) in self.contrasts.items()
            },
            "nuisances": {
                name: {"value": value, "low": low, "high": high}
                for name, (value, (low, high)) in self.nuisances.items()
            },
            "other_answers": list(self.others),
            "present": list(self.present),
            "cost": self.cost,
            "relative_misfit": self.relative_misfit,
            "evaluations": self.evaluations,
            "reference_runs": self.reference_runs,
            "seconds": self.seconds,
            "algorithm": self.algorithm,
            "seed": self.seed,
            "stopped": self.stopped,
            "searched": list(self.searched),
            "warnings": self.warnings,
            "assumed": self.assumed,
            "actuator": self.actuator.name,
            "kind": self.estimate.kind,
            "estimate": self.estimate.as_dict(),
            "provenance": self.provenance,
            "uncertainty": None if self.uncertainty is None else self.uncertainty.as_dict(),
        }

    def _physical_ends(self, name: str) -> dict[str, float]:
        if name not in self.physical_values:
            return {}
        _, low, high = self.physical_values[name]
        return {"low": low, "high": high}

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each fault, by name; needs pandas."""
        return frame_of_rows(
            (
                {
                    "fault": row.name,
                    "value": row.value,
                    "low": self._physical_ends(row.name).get("low", math.nan),
                    "high": self._physical_ends(row.name).get("high", math.nan),
                    "healthy": row.healthy,
                    "unit": row.unit,
                    "k": row.normalised,
                    "k_low": self.intervals.get(row.name, (math.nan,) * 2)[0],
                    "k_high": self.intervals.get(row.name, (math.nan,) * 2)[1],
                    "present": row.name in self.present,
                    "meaning": row.meaning,
                }
                for row in self.physical
            ),
            "fault",
        )

    to_dataframe = to_frame

    def plot(self, kind: str = "faults") -> Any:
        """A figure of plotly: "faults" (deviations from healthy), "fit" or "convergence"."""
        return drawn(
            self,
            kind,
            {"faults": "plot_faults", "fit": "plot_fit", "convergence": "plot_convergence"},
        )

    def report(self, path: str | Path) -> None:
        """Write its page (.html), which holds all that it shows."""
        page_written(self, path, "identification:identification_page")

    def _repr_html_(self) -> str:
        """The verdict, then the faults, in a notebook."""
        rows = [
            (row.name, row.value, row.interval, row.healthy, row.meaning)
            for row in fault_cells(self)
        ]
        marked = [n for n, row in enumerate(self.physical) if row.name in self.present]
        return "".join(
            [
                markup.verdict(self.verdict.sentence, self.verdict.grade),
                markup.table(("fault", "value", "95 %", "healthy", "meaning"), rows, marked),
                markup.note(
                    f"{self.actuator.name}, misfit {100.0 * self.relative_misfit:.2f} %, "
                    f"{self.effort}"
                ),
                *(markup.note(f"Assumed: {sentence}") for sentence in self.assumed),
                *(markup.note(f"Warning: {warning}") for warning in self.warnings),
            ]
        )

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
        lines += [f"Assumed: {sentence}" for sentence in self.assumed]
        lines += [f"Warning: {warning}" for warning in self.warnings]
        if self.uncertainty is not None:
            lines += ["", str(self.uncertainty)]
        return "\n".join(lines)
