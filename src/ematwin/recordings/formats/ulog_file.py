"""ULog files of PX4, through pyulog: fields of messages as ``topic/field``."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError
from ematwin.recordings.formats.base import RecordedFile, load_library


class ULogFile(RecordedFile):
    """A ULog file; instances of a topic after the first are ``topic.1/field``."""

    kind: ClassVar[str] = "ULog"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        library = load_library("pyulog", "pyulog", "Reading ULog files")
        log = library.ULog(str(path))
        self._topics: dict[str, dict[str, np.ndarray]] = {}
        for one in log.data_list:
            topic = f"{one.name}.{one.multi_id}" if one.multi_id else one.name
            self._topics[topic] = one.data
        self.channels = {
            f"{topic}/{field}": (topic, field)
            for topic, data in self._topics.items()
            for field in data
            if field != "timestamp"
        }
        self.bases = {name: topic for name, (topic, _) in self.channels.items()}
        if log.file_corruption or not self.channels:
            why = "it is damaged" if log.file_corruption else "it holds no messages"
            raise FileError(f"Cannot read {path} as ULog: {why}. Copy it from the vehicle again.")
        if not _ends_with_a_message(path):
            last = max(float(data["timestamp"][-1]) for data in self._topics.values())
            self.assumed.append(
                f"the log {path.name} ends within a message, as after a loss of power: it was "
                f"read up to {1e-6 * last:.6g} s of the system's clock"
            )

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        # us since the start of the system
        return np.asarray(self._topics[key]["timestamp"], dtype=np.float64) * 1e-6

    def values(self, name: str) -> Any:  # noqa: D102
        topic, field = self.channels[name]
        return self._topics[topic][field]


def _ends_with_a_message(path: Path) -> bool:
    """Whether the last message is whole: 16 bytes, then size (2 bytes), kind (1) and content."""
    place, size = 16, path.stat().st_size  # behind the header
    with path.open("rb") as file:
        while place + 3 <= size:
            file.seek(place)
            place += 3 + int.from_bytes(file.read(2), "little")
    return place == size
