"""TDMS files, through npTDMS, lazily: only the wanted channels are read."""

from datetime import UTC
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError
from ematwin.recordings.formats.base import RecordedFile, complaints, load_library, moment


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
            self._file = library.TdmsFile.open(path)
        self.channels = {
            f"{group.name}/{channel.name}": channel
            for group in self._file.groups()
            for channel in group.channels()
        }
        if found or self._file.file_status.incomplete_final_segment or not self.channels:
            self._file.close()
            raise FileError(
                f"Cannot read {path} as TDMS: "
                + ("its last segment is incomplete" if self.channels else "it holds no channels")
                + ". It may be truncated; copy it again or close it in the recording program."
            )
        for name, channel in self.channels.items():
            wave = channel.properties
            if unit := wave.get("unit_string") or wave.get("NI_UnitDescription"):
                self.units[name] = str(unit)
            self.bases[name] = f"{len(channel)} samples"
            if wave.get("wf_increment"):
                self.bases[name] += (
                    f" each {wave['wf_increment']!r} s from {wave.get('wf_start_offset', 0.0)!r} s "
                    f"after {wave.get('wf_start_time')}"
                )
        starts = [one.properties.get("wf_start_time") for one in self.channels.values()]
        stamps = [start for start in starts if isinstance(start, np.datetime64)]
        self._first = min(stamps, default=None)
        self.start = None if self._first is None else moment(self._first, UTC)  # as LabVIEW counts

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        channel = next(self.channels[name] for name, base in self.bases.items() if base == key)
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

    def close(self) -> None:  # noqa: D102
        self._file.close()
