"""Estimate of an actuator from one or several recordings, as plain values.

Verdicts, monitoring, trends and reports are functions of estimates; they need neither the
recordings nor the twin. An estimate travels as JSON.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np

from ematwin.errors import InputError
from ematwin.showing.results import frame, html, plain
from ematwin.validation import damage_said, refuse_newer

FORMAT = 1


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values of unknowns with their covariance, and where they come from.

    Attributes
    ----------
    names : of the d unknowns that were estimated
    values : (d,) array
    covariance : (d, d) array; an infinite variance where the recordings do not determine a value
    units, healthy : by name
    ranges : by name, upper less lower bound
    directions : by name of a direction, the name of its magnitude
    held : values that were held, by name
    misfit : float, relative: root of the ratio of the cost to the cost of an unresponsive twin
    actuator, kind, fingerprint : name, kind and hash of the parameters of the twin
    labels : of the recording, as texts
    source : file or other origin of the recording
    when : time at which the recording began, ISO 8601, or None
    statistics : numbers measured on the recording beside the values, by name
    warnings : sentences on doubts
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    units: Mapping[str, str]
    healthy: Mapping[str, float]
    ranges: Mapping[str, float]
    misfit: float
    actuator: str
    kind: str
    fingerprint: str
    directions: Mapping[str, str] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    source: str = ""
    when: str | None = None
    statistics: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        d = len(self.names)
        if self.values.shape != (d,) or self.covariance.shape != (d, d):
            raise InputError(
                f"An estimate of {d} unknowns needs {d} values and a covariance ({d}, {d}); "
                f"received {self.values.shape} and {self.covariance.shape}."
            )

    @property
    def standard_errors(self) -> dict[str, float]:
        """By name; infinite where undetermined."""
        errors = np.sqrt(np.diag(self.covariance))
        return dict(zip(self.names, errors.tolist(), strict=True))

    def __getitem__(self, name: str) -> float:
        """The value of an unknown, estimated or held."""
        if name in self.names:
            return float(self.values[self.names.index(name)])
        return float(self.held[name])

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each unknown, by name; needs pandas."""
        return frame(
            {
                "unknown": list(self.names),
                "value": self.values,
                "standard_error": list(self.standard_errors.values()),
                "healthy": [self.healthy[name] for name in self.names],
                "range": [self.ranges[name] for name in self.names],
                "unit": [self.units[name] for name in self.names],
            },
            "unknown",
        )

    to_dataframe = to_frame

    def _repr_html_(self) -> str:
        """The values with their errors, in a notebook."""
        errors = self.standard_errors
        rows = [
            (name, f"{self[name]:.4g}", f"{errors[name]:.2g}", f"{self.healthy[name]:.4g}",
             self.units[name])
            for name in self.names
        ]  # fmt: skip
        of = f" from {self.source}" if self.source else ""
        title = f"Estimate of {self.actuator}{of}, misfit {100.0 * self.misfit:.2f} %"
        header = ("unknown", "value", "standard error", "healthy", "unit")
        return html(title, header, rows, [f"Warning: {text}" for text in self.warnings])

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; infinite ones are null."""
        return {"format": FORMAT, **plain(vars(self))}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Self:
        """Rebuild an estimate from the result of `as_dict`.

        Raises
        ------
        InputError
            If something is missing, or it is of a newer ematwin.
        """
        what = "This is not an estimate of ematwin, or"
        with damage_said(what, "Make it again with ematwin identify.", InputError):
            refuse_newer("The estimate", int(table["format"]), FORMAT, InputError)
            known = {one.name: table[one.name] for one in fields(cls)}
            covariance = [[math.inf if x is None else x for x in r] for r in known["covariance"]]
            d = len(known["names"])
            known["names"], known["warnings"] = tuple(known["names"]), tuple(known["warnings"])
            known["values"] = np.array(known["values"], dtype=float).reshape(d)
            known["covariance"] = np.array(covariance, dtype=float).reshape(d, d)
            return cls(**known)
