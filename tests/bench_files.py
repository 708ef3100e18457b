"""Files as test benches write them: MDF, text tables."""

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


def german_csv(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """As a bench program of a German PC writes: cp1252, semicolons, decimal comma, a preamble."""
    lines = ["Prüfstand 7;Datum: 21.11.2026;;", "Bediener: Müller;;;", "", ";".join(columns)]
    for row in np.column_stack(list(columns.values())):
        lines.append(";".join(f"{value:.7g}".replace(".", ",") for value in row))
    path.write_bytes("\r\n".join([*lines, ""]).encode("cp1252"))
    return path
