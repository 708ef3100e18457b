"""Recording: evenly sampled named channels of one actuator, measured or simulated.

One type for every kind of actuator, which states the channels that it must have. Identification
cannot tell a measurement from a simulation, except by the provenance that is kept for the report.
"""

import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.channel import NAMED
from ematwin.showing.results import drawn, frame, html

_RESERVED = {"time", "channels", "units", "labels", "start", "source", "provenance"}


class Recording:
    """Evenly sampled named channels in SI.

    A channel that the recording does not have reads as None: ``recording.motor_position``.

    Parameters
    ----------
    time : (S,) array, s
    channels : mapping of names to (S,) arrays, SI
    units : mapping of channels to their SI units, for files and figures
    labels : facts about it, as texts, e.g. ``{"condition": "normal", "run": "1"}``
    start : the moment at which its time is zero, if known
    source : the file that it comes from
    provenance : mapping of JSON values, its source and changes
    **more : further channels by name; None leaves one out

    Raises
    ------
    RecordError
        If lengths differ, a value is not finite, time is not regular, or the provenance is not
        JSON.
    """

    def __init__(
        self,
        time: Any,
        channels: Mapping[str, Any] | None = None,
        *,
        units: Mapping[str, str] | None = None,
        labels: Mapping[str, str] | None = None,
        start: datetime | None = None,
        source: str = "",
        provenance: Mapping[str, Any] | None = None,
        **more: Any,
    ) -> None:
        self.labels: dict[str, str] = dict(labels or {})
        self.start = start
        self.source = source
        self.provenance: dict[str, Any] = dict(provenance or {})
        self.channels: dict[str, np.ndarray] = {}
        self.time = _numbers(time, "time")
        for name, values in {**(channels or {}), **more}.items():
            if values is None:
                continue
            if name in _RESERVED:
                raise RecordError(f"A channel cannot be called {name!r}; choose another name.")
            self.channels[name] = _numbers(values, name)
        self.units = {name: unit for name, unit in (units or {}).items() if name in self.channels}
        self._check()

    def _check(self) -> None:
        time, what = self.time, self._heading
        _check_time(time, what)
        for name, column in self.channels.items():
            if column.shape != time.shape:
                said = f"{what}Column {name} has shape {column.shape} but time has {time.shape}"
                raise RecordError(f"{said}; all columns must be equally long.")
            bad = np.flatnonzero(~np.isfinite(column))
            if bad.size:
                raise RecordError(
                    f"{what}Column {name} holds {bad.size} NaN or infinite values, the first at "
                    f"sample {bad[0]} ({time[bad[0]]:g} s). Remove that stretch of the record."
                )
        try:
            json.dumps(self.provenance)
        except (TypeError, ValueError) as error:
            said = f"The provenance must hold JSON values, so that files can keep it: {error}"
            raise RecordError(f"{said}. Convert them.") from None

    def __getattr__(self, name: str) -> Any:
        """A channel by name; None for one that kinds of actuators know and this one has not."""
        channels: dict[str, np.ndarray] = self.__dict__.get("channels", {})
        if name in channels:
            return channels[name]
        if name in NAMED:
            return None
        there = ", ".join(channels) or "none"
        raise AttributeError(f"The recording has no channel {name!r}; it has {there}.")

    @property
    def sample_rate(self) -> float:
        """Samples per second, Hz."""
        return float((self.time.size - 1) / (self.time[-1] - self.time[0]))

    @property
    def interval(self) -> float:
        """Sampling interval, s."""
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def measured(self) -> np.ndarray:
        """Which samples, (S,), were measured: a reader fills what it masks."""
        found = np.ones(len(self), dtype=bool)
        for start, stop in self.provenance.get("masked_s", []):
            found &= (self.time < start) | (stop < self.time)
        return found

    @property
    def first_sample(self) -> float:
        """First sample of a drive's loops, s after the start; 0 if unknown."""
        return float(self.provenance.get("first_sample_s", 0.0))

    def with_first_sample(self, instant: float) -> "Recording":
        """A recording with a known first sample of the drive's loops, s after the start."""
        return self.changed(provenance={**self.provenance, "first_sample_s": instant})

    @property
    def name(self) -> str:
        """File and labels, for messages and tables."""
        said = label_text(self.labels)
        return " ".join(part for part in (self.source, said) if part) or "the record"

    @property
    def _heading(self) -> str:
        return f"{self.name}: " if self.labels or self.source else ""

    @property
    def run(self) -> str:
        """The run that it belongs to: its label ``run``, else its file."""
        return self.labels.get("run", self.source)

    @property
    def together(self) -> tuple[str, ...]:
        """File and all labels but ``motion``: alike in a run under one condition."""
        return (self.source, *(v for key, v in self.labels.items() if key != "motion"))

    def columns(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield name and values of time and of each channel."""
        yield "time", self.time
        yield from self.channels.items()

    def changed(self, **values: Any) -> "Recording":
        """A recording with some channels, labels or other parts replaced; None drops a channel."""
        parts: dict[str, Any] = {name: getattr(self, name) for name in _RESERVED - {"channels"}}
        parts |= {name: values.pop(name) for name in list(values) if name in parts}
        return Recording(channels={**self.channels, **values}, **parts)

    def save(self, path: str | Path) -> None:
        """Write it to a Parquet or CSV file, as `ematwin.write` does."""
        import_module("ematwin.models.reading").write(self, path)  # it knows the kinds' units

    def between(self, start: float, stop: float) -> "Recording":
        """The part from ``start`` to ``stop``, s, both included."""
        inside = (self.time >= start) & (self.time <= stop)
        if inside.sum() < 2:
            said = f"The record has fewer than two samples between {start:g} and {stop:g} s"
            raise RecordError(f"{said}; it runs from {self.time[0]:g} to {self.time[-1]:g} s.")
        return self.changed(**{name: value[inside] for name, value in self.columns()})

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a column for each signal, SI; needs pandas.

        ``frame.attrs`` holds the units, so that `ematwin.read` gives the recording back.
        """
        made = frame(dict(self.columns()))
        made.attrs["units"] = {"time": "s", **self.units}
        made.attrs["source"] = self.source
        return made

    to_frame = to_dataframe

    @classmethod
    def from_dataframe(
        cls,
        table: Any,
        *,
        labels: Mapping[str, str] | None = None,
        start: datetime | None = None,
        source: str = "DataFrame",
    ) -> "Recording":
        """A recording from a DataFrame whose columns are channels by name, in SI.

        Times (s) stand in a column ``time`` or are the index; moments are counted from the first,
        which is then the start. Other names and units: `ematwin.read` takes a DataFrame as well.

        Raises
        ------
        RecordError
            If there are no times, or a column is none that a recording can hold.
        """
        from ematwin.recordings.formats.base import FrameFile

        file = FrameFile(table)
        columns = file.read(file.names)
        times = columns.pop("time", columns.pop("t", None))
        if times is None:
            there = ", ".join(columns) or "no columns"
            raise RecordError(
                "The DataFrame has no column time, and its index is not one of times; it has "
                f"{there}. Add the column, in s, or call the index time."
            )
        began = start or next(iter(file.clocks.values()), None)
        units = {name: unit for name in columns if (unit := file.unit(name))}
        return cls(times, columns, units=units, labels=labels, start=began, source=source)

    def __len__(self) -> int:
        return int(self.time.size)

    def __repr__(self) -> str:
        names = ", ".join(name for name, _ in self.columns())
        return f"Recording({self._heading}{self._extent}: {names})"

    @property
    def _extent(self) -> str:
        reach = f"{self.time[0]:g} to {self.time[-1]:g} s"
        return f"{len(self)} samples, {reach} at {self.sample_rate:.6g} Hz"

    def _repr_html_(self) -> str:
        """Length, rate and channels with their ranges, in a notebook."""
        rows = [
            (name, f"{values.min():.4g}", f"{values.max():.4g}", self.units.get(name, ""))
            for name, values in self.channels.items()
        ]
        notes = [f"Warning: {text}" for text in self.provenance.get("warnings", [])]
        if self.provenance.get("source") == "simulated":
            faults = self.provenance.get("faults") or {}
            told = ", ".join(f"{name} {value:g}" for name, value in faults.items())
            notes.insert(0, f"Simulated with {told}")
        title = f"{self._heading or 'Recording: '}{self._extent}"
        return html(title, ("channel", "least", "largest", "unit"), rows, notes)

    def plot(self) -> Any:
        """Every channel over time, a figure of plotly."""
        return drawn(self, "channels", {"channels": "plot_recording"})


def label_text(labels: Mapping[str, str]) -> str:
    """Labels for messages and tables: ``condition normal, run 1``."""
    return ", ".join(f"{key} {value}" for key, value in labels.items())


def _numbers(values: Any, name: str) -> np.ndarray:
    try:
        return np.ascontiguousarray(values, dtype=float)
    except (TypeError, ValueError):
        raise RecordError(f"Column {name} must hold numbers; it does not.") from None


def _check_time(time: np.ndarray, what: str) -> None:
    if time.ndim != 1 or time.size < 2:
        least = "A record needs at least two samples in time"
        raise RecordError(f"{what}{least}, received {time.size}.")
    check_finite(time, what)
    check_increasing(time, what)
    if not is_regular(time):
        steps = np.diff(time)
        usual = float(np.median(steps))
        odd = np.abs(steps - usual)
        n = int(np.argmax(odd > 0.9 * odd.max())) + 1  # the first, where several are alike
        raise RecordError(
            f"{what}time must be regular: the step to sample {n} ({time[n]:.6g} s) is "
            f"{steps[n - 1]:.6g} s where {usual:.6g} s is usual. "
            "Resample the record to a constant rate."
        )


def check_finite(time: np.ndarray, what: str) -> None:
    """Raise `RecordError` unless times (S,) are numbers."""
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        raise RecordError(
            f"{what}time is NaN or infinite in {bad.size} samples, the first is sample {bad[0]}. "
            "Remove those rows, or give sample_rate in place of the time channel of a file."
        )


def check_increasing(time: np.ndarray, what: str) -> None:
    """Raise `RecordError` unless times (S,) increase."""
    falls = np.flatnonzero(np.diff(time) <= 0.0)
    if falls.size:
        n = int(falls[0]) + 1
        raise RecordError(
            f"{what}time must increase: sample {n} ({time[n]:.6g} s) follows {time[n - 1]:.6g} s, "
            f"the first of {falls.size} such places. Sort the record, drop duplicates, or give "
            "sample_rate in place of the time channel of a file."
        )


def is_regular(time: np.ndarray) -> bool:
    """Whether times (S,), s, increase in equal steps, but for the rounding of the times."""
    steps = np.diff(time)
    mean = (time[-1] - time[0]) / (time.size - 1)
    slack = 1e-3 * mean + 4.0 * float(np.spacing(np.abs(time).max()))  # more jitter is resampled
    return bool(mean > 0.0 and steps.min() >= mean - slack and steps.max() <= mean + slack)
