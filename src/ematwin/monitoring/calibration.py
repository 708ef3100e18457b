"""Calibration: an actuator and its prior, as `calibrate` makes and `detect` takes it; its report.

It is one TOML file: a parameter file of the actuator with the table ``baseline`` (how well its
parameters are known). Where a healthy population judges, the file also has the tables
``calibration`` (the population and its runs) and ``signature`` (known faults).
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from ematwin import __version__
from ematwin.errors import EmatwinError, ParameterError
from ematwin.estimation.baseline import (
    ANEW,
    Baseline,
    NominalParameter,
    baseline_of,
    frees_parameters,
)
from ematwin.files import write_text
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import actuator_in, load_actuator, model_of, shipped_actuators
from ematwin.recordings.recording import Recording
from ematwin.showing.results import drawn, frame, html, page_written
from ematwin.validation import checksum_of, damage_said, load_toml, refuse_newer

if TYPE_CHECKING:
    from ematwin.estimation.forms import FoundForms

FORMAT = 4  # 3, of 0.2, repeated what follows from the healthy runs; 2 and 1 did not keep these
_OLDEST = 3


@dataclass(frozen=True)
class Calibration:
    """An actuator, and how well its parameters are known.

    Attributes
    ----------
    actuator : of any kind
    baseline : Baseline
    """

    actuator: ParameterSet
    baseline: Baseline

    @property
    def model(self) -> Model:
        """The kind of its actuator."""
        return model_of(self.actuator)

    @classmethod
    def of(cls, given: Any) -> "Calibration":
        """Calibration of anything that `ematwin.identify` takes as an actuator.

        A parameter set without recordings is known to within its tolerances.
        """
        held = getattr(given, "calibration", given)  # a report holds one
        if isinstance(held, Calibration):
            return held
        if str(given).endswith(".toml") and isinstance(given, str | Path):
            path = Path(given)
            return _in_table(load_toml(path, "actuator"), path)
        actuator = load_actuator(given)
        return Calibration(actuator, baseline_of(given, actuator))

    @classmethod
    def load(cls, path: str | Path) -> "Calibration":
        """Read what `save` wrote.

        Raises
        ------
        ParameterError
            If the file holds no calibration, one of a newer version, or a damaged one.
        FileError
            If it cannot be read.
        """
        path = Path(path)
        table = {} if str(path) in shipped_actuators() else load_toml(path, "calibration")
        if not {"baseline", "calibration"} & set(table):
            raise ParameterError(
                f"{path} holds an actuator but no calibration; make one with ematwin calibrate "
                "from healthy recordings."
            )
        return _in_table(table, path)

    def save(self, path: str | Path, sources: Mapping[str, str] | None = None) -> None:
        """Write the TOML file, whole or not at all.

        ``sources`` says where the values of parameters come from, by place, where that is not known
        to the actuator.
        """
        table = self._table(sources)
        table["baseline"]["checksum"] = checksum_of(tomllib.loads(tomli_w.dumps(table)))
        write_text(path, tomli_w.dumps(table))

    def _table(self, sources: Mapping[str, str] | None) -> dict[str, Any]:
        return {**self.actuator.as_table(sources), "baseline": self.baseline.as_table()}


def is_as_written(path: Path) -> bool:
    """Whether a file holds a calibration that nobody changed since `calibrate` wrote it."""
    try:
        table = load_toml(path, "calibration")
        return _stated_checksum(table, path) is not None
    except EmatwinError:
        return False


def _stated_checksum(table: dict[str, Any], path: Path) -> str | None:
    """Take the checksum out of the content of a file; None if it has none, as in 0.2."""
    known = table.get("baseline")
    stated = known.pop("checksum", None) if isinstance(known, dict) else None
    if stated is not None and stated != checksum_of(table):
        raise ParameterError(
            f"{path} was changed after ematwin calibrate wrote it: its values differ from their "
            "checksum. If that was on purpose, delete the line with the checksum in [baseline]; "
            "else calibrate again."
        )
    return stated


def _in_table(table: dict[str, Any], path: Path) -> Calibration:
    """The calibration in the content of a file; tolerances, where it holds an actuator alone."""
    _stated_checksum(table, path)
    learnt, signatures = table.pop("calibration", None), table.pop("signature", [])
    known = table.pop("baseline", None)
    actuator = actuator_in(table, path)
    model = model_of(actuator)
    baseline = None if known is None else Baseline.from_table(known, str(path))
    if learnt is None:
        return Calibration(actuator, baseline or Baseline.of_template(model, actuator))
    written = learnt.get("format", FORMAT) if isinstance(learnt, dict) else None
    refuse_newer(str(path), written, FORMAT)
    if (isinstance(written, int) and written < _OLDEST) or baseline is None:
        raise ParameterError(
            f"{path} was written by a version before 0.2, which kept no healthy runs; calibrate "
            "anew with ematwin calibrate."
        )
    from ematwin.monitoring.population_calibration import population_in

    with damage_said(f"{path}: its calibration", ANEW):
        if not isinstance(written, int):
            raise ValueError(f"its format is {written!r}")
        if frees_parameters(model):  # versions up to 0.2 wrote a population, which judges no more
            return Calibration(actuator, baseline)
        return population_in(actuator, baseline, learnt, signatures)


@dataclass(frozen=True)
class Basis:
    """Template and recordings of a calibration, for its page."""

    template: ParameterSet
    recordings: Sequence[Recording]  # healthy ones that the parameters were fitted to
    nuisances: Sequence[Mapping[str, float]]  # load and sensors by name, of each recording
    forms: "FoundForms | None"  # that were looked for; None of kinds without


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
        return getattr(self.calibration, "run_spread", {})

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
        return frame({x: [getattr(p, x) for p in self.parameters] for x in shown}, "place")

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
        page_written(self, path, "report.calibration:calibration_page")

    def save(self, path: str | Path) -> None:
        """Write the calibrated actuator as a TOML file, with the sources of its parameters."""
        self.calibration.save(path, self.sources)

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
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
            "signatures": [one.fault for one in getattr(self.calibration, "signatures", ())],
        }
