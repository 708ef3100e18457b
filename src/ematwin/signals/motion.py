"""Motion: one run of an actuator through a commanded movement, as a condition monitor records it.

A slow recording (25 Hz will do) of where the actuator should be, how far off it is, and what the
drive draws. It has no phase currents and no rotor angle; for those there is `Record`.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.signals.record import check_time

# Columns, their unit and meaning. Of position and position_error one is enough.
MOTION_COLUMNS = {
    "time": ("s", "time from the start of the motion"),
    "set_point": ("m", "commanded position of the nut"),
    "position": ("m", "position of the nut"),
    "position_error": ("m", "set point less position"),
    "current": ("A", "current of the drive, a magnitude"),
}


def label_text(labels: dict[str, str]) -> str:
    """Labels for messages and tables: ``condition normal, run 1``."""
    return ", ".join(f"{key} {value}" for key, value in labels.items())


@dataclass(frozen=True, eq=False)
class Motion:
    """One motion, sampled at a constant rate, in SI.

    Parameters
    ----------
    time : (S,) array, s
    set_point : (S,) array, m
    position_error : (S,) array, m, set point less position
    current : (S,) array, A, of the drive, a magnitude
    labels : what is known of it, as texts, e.g. ``{"condition": "normal", "run": "1"}``
    source : the file that it comes from

    Raises
    ------
    RecordError
        If lengths differ, a value is not finite, or time is not regular.
    """

    time: np.ndarray
    set_point: np.ndarray
    position_error: np.ndarray
    current: np.ndarray
    labels: dict[str, str] = field(default_factory=dict)
    source: str = ""

    def __post_init__(self) -> None:
        try:
            check_time(self.time)
        except RecordError as error:
            raise RecordError(f"{self.name}: {error}") from None
        for name in ("set_point", "position_error", "current"):
            column: Any = getattr(self, name)
            if column.shape != self.time.shape:
                raise RecordError(
                    f"{self.name}: {name} has {column.size} samples but time has "
                    f"{self.time.size}; all must be equally long."
                )
            bad = np.flatnonzero(~np.isfinite(column))
            if bad.size:
                raise RecordError(
                    f"{self.name}: {name} holds {bad.size} NaN or infinite values, the first at "
                    f"{self.time[bad[0]]:g} s. Remove this motion or repair it."
                )

    @property
    def interval(self) -> float:
        """Sampling interval, s."""
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    @property
    def name(self) -> str:
        """File and labels, for messages and tables."""
        said = label_text(self.labels)
        return " ".join(part for part in (self.source, said) if part) or "the motion"

    @property
    def run(self) -> str:
        """The run that it belongs to: its label ``run``, else its file."""
        return self.labels.get("run", self.source)

    @property
    def together(self) -> tuple[str, ...]:
        """What the motions of one run under one condition share: all labels but ``motion``."""
        return (self.source, *(v for key, v in self.labels.items() if key != "motion"))

    def __repr__(self) -> str:
        return f"Motion({self.name}: {self.time.size} samples, each {self.interval:g} s)"
