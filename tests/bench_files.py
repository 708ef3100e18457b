"""MDF files as test benches write them."""

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF, Signal


def write_mdf(
    path: Path,
    *groups: tuple[np.ndarray, dict[str, Any]],
    version: str = "4.10",
    start: datetime | None = None,
    **more: Any,
) -> Path:
    """Write groups of channels, each with its times (S,), s: values (S,) by name, or with a unit.

    ``more`` belongs to the first signal.
    """
    with MDF(version=version) as mdf:
        for time, channels in groups:
            signals = []
            for name, given in channels.items():
                values, unit = given if isinstance(given, tuple) else (given, "")
                signals.append(Signal(values, time, name=name, unit=unit, **more))
                more = {}
            mdf.append(signals)
        if start is not None:
            mdf.start_time = start
        mdf.save(path, overwrite=True)
    return path
