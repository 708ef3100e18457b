"""MCAP files with messages of ROS 2, through mcap-ros2-support: fields as ``/topic/field``."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError
from ematwin.recordings.formats.base import RecordedFile, load_library


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
