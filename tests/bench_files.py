"""Files as test benches write them: MDF, TDMS, HDF5, text tables."""

from datetime import datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter


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


def write_tdms(path: Path, *segments: dict[str, Any]) -> Path:
    """Write channels ``group/name`` in segments: values (S,), or with their properties."""
    with TdmsWriter(path) as writer:
        for channels in segments:
            objects = []
            for name, given in channels.items():
                values, properties = given if isinstance(given, tuple) else (given, {})
                objects.append(ChannelObject(*name.split("/"), values, properties))
            writer.write_segment(objects)
    return path


def write_hdf5(path: Path, columns: dict[str, Any]) -> Path:
    """Write datasets by their path."""
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = values
    return path


def german_csv(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """As a bench program of a German PC writes: cp1252, semicolons, decimal comma, a preamble."""
    lines = ["Prüfstand 7;Datum: 21.11.2026;;", "Bediener: Müller;;;", "", ";".join(columns)]
    for row in np.column_stack(list(columns.values())):
        lines.append(";".join(f"{value:.7g}".replace(".", ",") for value in row))
    path.write_bytes("\r\n".join([*lines, ""]).encode("cp1252"))
    return path
