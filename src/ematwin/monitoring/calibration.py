"""Calibration: an actuator and its prior, as `calibrate` makes and `detect` takes it.

It is one TOML file: a parameter file of the actuator with the table ``baseline`` (how well its
parameters are known). Where a healthy population judges, the file also has the tables
``calibration`` (the population and its runs) and ``signature`` (known faults).
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from ematwin.errors import EmatwinError, ParameterError
from ematwin.estimation.baseline import Baseline, baseline_of, frees_parameters
from ematwin.files import written_whole
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import actuator_in, load_actuator, model_of
from ematwin.validation import checksum_of, load_toml

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
        table = load_toml(path, "calibration")
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
        with written_whole(path) as draft:
            draft.write_text(tomli_w.dumps(table), encoding="utf-8")

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
    if isinstance(written, int) and written > FORMAT:
        raise ParameterError(
            f"{path} was written by a newer ematwin (format {written}, this one knows "
            f"{FORMAT}). Update ematwin."
        )
    if (isinstance(written, int) and written < _OLDEST) or baseline is None:
        raise ParameterError(
            f"{path} was written by a version before 0.2, which kept no healthy runs; calibrate "
            "anew with ematwin calibrate."
        )
    from ematwin.monitoring.population_calibration import population_in

    try:
        if not isinstance(written, int):
            raise ValueError(f"its format is {written!r}")
        if frees_parameters(model):  # versions up to 0.2 wrote a population, which judges no more
            return Calibration(actuator, baseline)
        return population_in(actuator, baseline, learnt, signatures)
    except (
        KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError
    ) as error:  # fmt: skip
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(
            f"{path}: its calibration is damaged ({type(error).__name__}: {error}). Make it "
            "anew with ematwin calibrate."
        ) from None
