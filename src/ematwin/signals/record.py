"""Record: one type for measured and simulated responses.

Identification cannot tell the two apart, except by the provenance that is kept for the report.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ematwin.errors import RecordError

# Columns, their unit and meaning, in the order of files.
COLUMNS = {
    "time": ("s", "time"),
    "command": ("rad", "commanded output position"),
    "load": ("N*m", "load on the output, against positive motion"),
    "current_a": ("A", "current into phase a"),
    "current_b": ("A", "current into phase b"),
    "current_c": ("A", "current into phase c"),
    "current": ("A", "equivalent current"),
    "motor_position": ("rad", "motor shaft angle"),
    "motor_speed": ("rad/s", "motor shaft speed"),
    "output_position": ("rad", "output angle"),
    "output_speed": ("rad/s", "output speed"),
}
UNITS = {name: unit for name, (unit, _) in COLUMNS.items()}
PHASES = ("current_a", "current_b", "current_c")
REGULARITY = 1e-3  # of the sampling interval: more jitter than this needs resampling


@dataclass(frozen=True, eq=False)
class Record:
    """A response of an actuator, sampled at a constant rate, in SI.

    A current of a simulated record is the mean over the sampling interval that ends at its time,
    as an integrating converter gives it; positions and speeds are values at that time.

    Parameters
    ----------
    time : (S,) array, s
    command : (S,) array, rad on the output
    current_a, current_b, current_c : (S,) arrays, A, positive into the motor; all three or none
    current : (S,) array, A, equivalent current; needed where the phases are not known
    load : (S,) array, N m on the output, optional
    motor_position, motor_speed, output_position, output_speed : (S,) arrays, optional
    provenance : dict, where the record comes from; JSON values

    Raises
    ------
    RecordError
        If lengths differ, a value is not finite, time is not regular, there is no current, or the
        provenance is not JSON.
    """

    time: np.ndarray
    command: np.ndarray
    load: np.ndarray | None = None
    current_a: np.ndarray | None = None
    current_b: np.ndarray | None = None
    current_c: np.ndarray | None = None
    current: np.ndarray | None = None
    motor_position: np.ndarray | None = None
    motor_speed: np.ndarray | None = None
    output_position: np.ndarray | None = None
    output_speed: np.ndarray | None = None
    provenance: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in COLUMNS:
            value = getattr(self, name)
            if value is None:
                continue
            try:
                array = np.ascontiguousarray(value, dtype=float)
            except (TypeError, ValueError):
                raise RecordError(f"Column {name} must hold numbers; it does not.") from None
            object.__setattr__(self, name, array)
        check_time(self.time)
        for name, column in self.columns():
            if column.shape != self.time.shape:
                raise RecordError(
                    f"Column {name} has shape {column.shape} but time has {self.time.shape}; "
                    "all columns must be equally long."
                )
            bad = np.flatnonzero(~np.isfinite(column))
            if bad.size:
                raise RecordError(
                    f"Column {name} holds {bad.size} NaN or infinite values, the first at sample "
                    f"{bad[0]} ({self.time[bad[0]]:g} s). Remove that stretch of the record."
                )
        _check_provenance(self.provenance)
        phases = [name for name in PHASES if getattr(self, name) is not None]
        if phases and len(phases) < 3:
            missing = sorted(set(PHASES) - set(phases))
            raise RecordError(
                f"The record has {', '.join(phases)} but not {', '.join(missing)}; "
                "all three phases are needed, or the column current in their place."
            )
        if not phases and self.current is None:
            raise RecordError(
                "The record has no current; give current_a, current_b and current_c, or current."
            )

    @property
    def sample_rate(self) -> float:
        """Samples per second, Hz."""
        return float((self.time.size - 1) / (self.time[-1] - self.time[0]))

    @property
    def interval(self) -> float:
        """Sampling interval, s."""
        return 1.0 / self.sample_rate

    @property
    def phase_currents(self) -> np.ndarray | None:
        """(S, 3) array of the phase currents, A, or None."""
        if self.current_a is None or self.current_b is None or self.current_c is None:
            return None
        return np.column_stack([self.current_a, self.current_b, self.current_c])

    def columns(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield name and values of the columns that the record has, in the order of files."""
        for name in COLUMNS:
            value = getattr(self, name)
            if value is not None:
                yield name, value

    def changed(self, **values: Any) -> "Record":
        """A record with some columns or the provenance replaced."""
        return replace(self, **values)

    def between(self, start: float, stop: float) -> "Record":
        """The part from ``start`` to ``stop``, s, both included."""
        inside = (self.time >= start) & (self.time <= stop)
        if inside.sum() < 2:
            raise RecordError(
                f"The record has no two samples between {start:g} and {stop:g} s; it runs from "
                f"{self.time[0]:g} to {self.time[-1]:g} s."
            )
        return self.changed(**{name: value[inside] for name, value in self.columns()})

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a column for each signal; needs pandas."""
        try:
            import pandas as pd
        except ImportError:
            raise ImportError("to_dataframe needs pandas. Run: pip install pandas.") from None
        return pd.DataFrame(dict(self.columns()))

    def __len__(self) -> int:
        return int(self.time.size)

    def __repr__(self) -> str:
        names = ", ".join(name for name, _ in self.columns())
        return (
            f"Record({len(self)} samples, {self.time[0]:g} to {self.time[-1]:g} s at "
            f"{self.sample_rate:.6g} Hz: {names})"
        )


def _check_provenance(provenance: dict[str, Any]) -> None:
    try:
        json.dumps(provenance)
    except (TypeError, ValueError) as error:
        raise RecordError(
            f"The provenance must hold JSON values, so that files can keep it: {error}. "
            "Convert them."
        ) from None


def check_time(time: np.ndarray) -> None:
    """Raise `RecordError` unless times (S,) increase in equal steps."""
    if time.ndim != 1 or time.size < 2:
        raise RecordError(f"A record needs at least two samples in time, received {time.size}.")
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        raise RecordError(f"time is NaN or infinite at sample {bad[0]}; remove those rows.")
    steps = np.diff(time)
    falls = np.flatnonzero(steps <= 0.0)
    if falls.size:
        n = int(falls[0]) + 1
        raise RecordError(
            f"time must increase: sample {n} ({time[n]:.6g} s) follows {time[n - 1]:.6g} s. "
            "Sort the record or drop duplicates."
        )
    mean = (time[-1] - time[0]) / (time.size - 1)
    # rounding of the times themselves is no irregularity
    slack = REGULARITY * mean + 4.0 * np.spacing(np.abs(time).max())
    if np.abs(steps - mean).max() > slack:
        usual = float(np.median(steps))
        odd = np.abs(steps - usual)
        n = int(np.argmax(odd > 0.9 * odd.max())) + 1  # the first, where several are alike
        raise RecordError(
            f"time must be regular: the step to sample {n} ({time[n]:.6g} s) is "
            f"{steps[n - 1]:.6g} s where {usual:.6g} s is usual. "
            "Resample the record to a constant rate."
        )
