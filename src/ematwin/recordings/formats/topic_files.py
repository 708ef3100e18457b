"""Files with topics of messages, whose fields are ``topic/field``: ULog and MCAP."""

from collections.abc import Iterator
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


class McapFile(RecordedFile):
    """An MCAP file; arrays give ``field[k]``, a joint state ``field[joint]``.

    Times come from the header of a message where it has one, else from the log.
    """

    kind: ClassVar[str] = "MCAP"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        reader = load_library("mcap_ros2.reader", "mcap-ros2-support", "Reading MCAP files")
        found: dict[str, list[float]] = {}
        self._times: dict[str, list[float]] = {}
        for one in reader.read_ros2_messages(str(path)):
            topic, message = one.channel.topic, one.ros_msg
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            logged = one.log_time_ns * 1e-9
            told = logged if stamp is None else stamp.sec + 1e-9 * stamp.nanosec
            self._times.setdefault(topic, []).append(told or logged)
            for field, value in _numbers(message):
                found.setdefault(f"{topic}/{field}", []).append(value)
        for name, values in found.items():
            topic = max((one for one in self._times if name.startswith(f"{one}/")), key=len)
            if len(values) == len(self._times[topic]):
                self.channels[name], self.bases[name] = values, topic
        if not found:
            raise FileError(
                f"{path} holds no numbers in messages of ROS 2. Messages of other kinds, and bags "
                "in SQLite (.db3), are converted by ros2 bag convert."
            )

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        times = np.array(self._times[key])
        return times - times[0] if times[0] > 1e8 else times  # a moment, not a time of a run

    def values(self, name: str) -> Any:  # noqa: D102
        return np.array(self.channels[name])


def _numbers(message: Any, before: str = "") -> Iterator[tuple[str, float]]:
    """Yield name and value of each number in a message, but for its header."""
    joints = getattr(message, "name", None)
    for field in getattr(message, "__slots__", ()):
        value = getattr(message, field)
        if field == "header":
            continue
        if isinstance(value, bool | int | float):
            yield f"{before}{field}", float(value)
        # a short array is channels side by side
        elif isinstance(value, list | tuple) and len(value) <= 64:
            named = isinstance(joints, list) and len(joints) == len(value)
            for n, one in enumerate(value):
                if isinstance(one, bool | int | float):
                    key = joints[n] if named and joints is not None else n
                    yield f"{before}{field}[{key}]", float(one)
        elif hasattr(value, "__slots__"):
            yield from _numbers(value, f"{before}{field}/")
