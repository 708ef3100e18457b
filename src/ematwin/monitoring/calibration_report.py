"""Result of a calibration: parameters, how well they are known, and warnings."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ematwin import __version__
from ematwin.estimation.baseline import Baseline, NominalParameter
from ematwin.estimation.forms import FoundForms
from ematwin.models.parameter_set import ParameterSet
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.recordings.recording import Recording
from ematwin.showing.results import drawn, frame_of_rows, html, page_written


@dataclass(frozen=True)
class Basis:
    """Template and recordings of a calibration, for its page."""

    template: ParameterSet
    recordings: Sequence[Recording]  # healthy ones that the parameters were fitted to
    nuisances: Sequence[Mapping[str, float]]  # load and sensors by name, of each recording
    forms: FoundForms | None  # that were looked for; None of kinds without


@dataclass(frozen=True)
class CalibrationReport:
    """Result of a calibration."""

    # with the healthy population, where there is one (`PopulationCalibration`)
    calibration: Calibration
    # fitted ones, with what could not be determined; none where runs were added
    parameters: list[NominalParameter]
    tied: list[tuple[str, ...]]  # groups of parameters, known only by their ratios or products
    learnt: list[str]  # names of the runs
    notes: tuple[str, ...] = ()  # sentences on what to be careful of
    basis: Basis | None = field(default=None, repr=False)  # None with a healthy population

    @property
    def actuator(self) -> ParameterSet:
        """With the values that were found."""
        return self.calibration.actuator

    @property
    def baseline(self) -> Baseline:
        """How well they are known."""
        return self.calibration.baseline

    @property
    def run_spread(self) -> dict[str, tuple[float, float]]:
        """Standard deviations within a run and between runs of each quantity of the population.

        Of logarithms for multiples of healthy, else SI.
        """
        known = self.calibration
        if not isinstance(known, PopulationCalibration):
            return {}
        spread = zip(known.reported.within.tolist(), known.reported.between.tolist(), strict=True)
        return {one.name: both for one, both in zip(known.quantities, spread, strict=True)}

    @property
    def sources(self) -> dict[str, str]:
        """Where the value of each parameter comes from that is not the template's, by place."""
        runs = ", ".join(self.learnt)
        template = self.actuator if self.basis is None else self.basis.template
        before = {place: value for place, value, *_ in template.parameters()}
        found = {
            place: f"found in healthy runs {runs} with ematwin {__version__}"
            for place, value, *_ in self.actuator.parameters()
            if before.get(place) != value
        }
        return found | {
            p.place: f"calibrated on healthy runs {runs} with ematwin {__version__}, standard "
            f"error {p.standard_error:.3g}"
            if p.determined
            else f"not determined by the healthy runs; template {p.template:.4g}"
            for p in self.parameters
        }

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each fitted parameter, by place; needs pandas."""
        shown = ("place", "value", "standard_error", "template", "determined")
        rows = ({name: getattr(p, name) for name in shown} for p in self.parameters)
        return frame_of_rows(rows, "place")

    to_dataframe = to_frame

    def __str__(self) -> str:
        lines = [f"{self.actuator.name}, calibrated on {len(self.learnt)} runs"]
        for p in self.parameters:
            error = f"standard error {p.standard_error:.2g}" if p.determined else "not determined"
            lines.append(f"{p.place:<34} {p.value:>10.4g}  {error}")
        return "\n".join([*lines, *self.notes])

    def _repr_html_(self) -> str:
        """From how many runs, then the fitted parameters, in a notebook."""
        rows = [
            (p.place, f"{p.value:.6g}" if p.determined else "not determined",
             f"{p.standard_error:.2g}", f"{p.template:.6g}")
            for p in self.parameters
        ]  # fmt: skip
        title = f"{self.actuator.name}, calibrated on {len(self.learnt)} runs"
        notes = filter(None, (self.baseline.forms, *self.notes))
        return html(title, ("parameter", "value", "standard error", "template"), rows, notes)

    def plot(self, kind: str = "parameters") -> Any:
        """A figure of plotly: "parameters", "fit" (before and after), or "residuals"."""
        return drawn(
            self, kind,
            {"parameters": "plot_learnt", "fit": "plot_before_and_after",
             "residuals": "plot_residuals"},
        )  # fmt: skip

    def report(self, path: str | Path) -> None:
        """Write its page (.html), which holds all that it shows."""
        page_written(self, path, "calibration:calibration_page")

    def save(self, path: str | Path) -> None:
        """Write the calibrated actuator as a TOML file, with the sources of its parameters."""
        self.calibration.save(path, self.sources)

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        learnt = self.calibration
        known = learnt.signatures if isinstance(learnt, PopulationCalibration) else ()
        return {
            "actuator": self.actuator.name,
            "kind": self.actuator.kind,
            "misfit": self.baseline.misfit if math.isfinite(self.baseline.misfit) else None,
            "forms": self.baseline.forms,
            "absent_forms": list(self.baseline.absent_forms),
            "tied": [list(group) for group in self.tied],
            "parameters": {p.place: vars(p).copy() for p in self.parameters},
            "spread": {k: {"within": a, "between": b} for k, (a, b) in self.run_spread.items()},
            "scatter": dict(self.baseline.scatter),
            "learnt": self.learnt,
            "notes": list(self.notes),
            "signatures": [one.fault for one in known],
        }
