"""Options ``--column`` and ``--map``: which channel of a file is what."""

from pathlib import Path
from typing import Any


def map_of(column: list[str] | None, map_file: Path | None, actuator: Any) -> Any:
    """The channel map of the options for recordings of an actuator, or None without any."""
    if not column and map_file is None:
        return None
    from ematwin.models.registry import model_of
    from ematwin.recordings.channel_map import ChannelMap

    channels = model_of(actuator).channels
    base = None if map_file is None else ChannelMap.of(map_file, channels)
    return ChannelMap.parse(column or [], channels, base)
