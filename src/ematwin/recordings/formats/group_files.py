"""Files with groups of channels: MDF 3 and 4, through asammdf, and TDMS, through npTDMS.

Only the wanted channels are read.
"""

import gc
import logging
import sys
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError
from ematwin.recordings.formats import base
from ematwin.recordings.formats.base import RecordedFile, complaints, load_library


class MdfFile(RecordedFile):
    """An MDF file: each channel group has its time base."""

    kind: ClassVar[str] = "MDF"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        library = load_library("asammdf", "asammdf", "Reading MDF files")
        self.handle = _open(library, path)
        self.start = _start_of(self.handle)
        places = [
            (channel.name, group, index)
            for group, content in enumerate(self.handle.groups)
            for index, channel in enumerate(content.channels)
            if index != self.handle.masters_db.get(group)
        ]
        times = Counter(name for name, _, _ in places)
        for name, group, index in places:
            full = name if times[name] == 1 else f"group {group}/{name}"
            self.channels.setdefault(full, (group, index))
            self.bases.setdefault(full, f"group {group}")

    def unit(self, name: str) -> str | None:  # noqa: D102
        group, index = self.channels[name]
        with base.refusing(self.path, self.kind):
            return self.handle.get_channel_unit(group=group, index=index) or None

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        group = int(key.removeprefix("group "))
        if group not in self.handle.masters_db:
            return None
        with base.refusing(self.path, self.kind):
            return base.as_float(self.handle.get_master(group), f"time of {key}", self.path)

    def values(self, name: str) -> Any:
        """Samples of a channel, NaN where the file marks them as invalid."""
        group, index = self.channels[name]
        self._check_place(name, group, index)
        with complaints("asammdf", level=logging.ERROR) as found:
            samples, invalid = self.handle.get(
                group=group, index=index, samples_only=True, ignore_invalidation_bits=True
            )
        if found:
            raise ValueError(found[0])
        promised = self.handle.groups[group].channel_group.cycles_nr
        if len(samples) != promised:
            said = f"{self.path} promises {promised} samples of {name!r} and holds {len(samples)}"
            raise FileError(f"{said}. It was truncated; copy it again.")
        if invalid is None:
            return samples
        values = base.as_float(samples, name, self.path)
        values[np.asarray(invalid, dtype=bool)] = np.nan
        return values

    def _check_place(self, name: str, group: int, index: int) -> None:
        """Refuse a channel that lies outside its records: asammdf would read foreign memory."""
        channel = self.handle.groups[group].channels[index]
        if getattr(channel, "channel_type", 0) in (3, 6):
            return  # of version 4, without bytes in the record
        if hasattr(channel, "byte_offset"):  # version 4
            bits = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
        else:
            extra = getattr(channel, "additional_byte_offset", 0)
            bits = 8 * extra + channel.start_offset + channel.bit_count
        room = 8 * self.handle.groups[group].channel_group.samples_byte_nr
        if bits > room:
            raise FileError(
                f"Cannot read {self.path} as MDF: {name!r} ends at bit {bits} of a record of "
                f"{room} bits. The file is damaged; copy it again."
            )


def _start_of(file: Any) -> datetime | None:
    try:
        start: datetime = file.start_time
        aware = start if start.tzinfo is not None else start.replace(tzinfo=UTC)
    except (AttributeError, OverflowError, ValueError, OSError):  # a date that there is not
        return None
    # asammdf gives 1980 where a file says nothing
    return aware if aware > datetime(1980, 1, 1, tzinfo=UTC) else None


def _open(library: Any, path: Path) -> Any:
    """An `asammdf.MDF`; quiet where it cannot be opened.

    The destructor of the half-made object complains on stderr, and dies with the exception.
    """

    before, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        try:
            with complaints("asammdf", level=logging.ERROR) as found:
                opened = library.MDF(path)
            if not found:
                return opened
            opened.close()
            reason = found[0]
        except Exception as error:
            reason = str(error) or type(error).__name__
        gc.collect()  # it may be part of a cycle
    finally:
        sys.unraisablehook = before
    raise ValueError(reason)


class TdmsFile(RecordedFile):
    """A TDMS file; channels are named ``group/channel``.

    Time comes from the waveform properties of a channel (``wf_increment``) where it has them.
    """

    kind: ClassVar[str] = "TDMS"
    zone = UTC

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        library = load_library("nptdms", "npTDMS", "Reading TDMS files")
        loggers = [f"nptdms.{part}" for part in ("reader", "tdms_segment", "base_segment", "tdms")]
        # that of types complains of names in another encoding, which are read all the same
        with complaints("nptdms.types"), complaints(*loggers) as found:
            self.handle = library.TdmsFile.open(path)
        channels = (one for group in self.handle.groups() for one in group.channels())
        self.channels = {f"{one.group_name}/{one.name}": one for one in channels}
        if found or self.handle.file_status.incomplete_final_segment or not self.channels:
            self.close()
            why = "its last segment is incomplete" if self.channels else "it holds no channels"
            said = f"Cannot read {path} as TDMS: {why}. It may be truncated"
            raise FileError(f"{said}; copy it again or close it in the recording program.")
        for name, channel in self.channels.items():
            wave = channel.properties
            if unit := wave.get("unit_string") or wave.get("NI_UnitDescription"):
                self.units[name] = str(unit)
            self.bases[name] = f"{len(channel)} samples"
            if wave.get("wf_increment"):
                start = f"{wave.get('wf_start_offset', 0.0)!r} s after {wave.get('wf_start_time')}"
                self.bases[name] += f" each {wave['wf_increment']!r} s from {start}"
        starts = [one.properties.get("wf_start_time") for one in self.channels.values()]
        stamps = [start for start in starts if isinstance(start, np.datetime64)]
        self._first = min(stamps, default=None)
        if self._first is not None:
            self.start = base.moment(self._first, UTC)  # as LabVIEW counts

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        channel = next(self.channels[name] for name, own in self.bases.items() if own == key)
        wave = channel.properties
        step, began = wave.get("wf_increment"), wave.get("wf_start_time")
        if not step:
            return None
        delay = 0.0
        if began is not None and self._first is not None:
            stamps = np.array([self._first, began], dtype="datetime64[ns]").astype(np.int64)
            delay = float(stamps[1] - stamps[0]) * 1e-9
        start = float(wave.get("wf_start_offset", 0.0)) + delay
        return start + float(step) * np.arange(len(channel))

    def values(self, name: str) -> Any:  # noqa: D102
        return self.channels[name][:]
