"""Refuse recordings that are too short, do not move, or have sizes that no actuator has."""

from collections.abc import Iterable, Mapping

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.recording import Recording

FEWEST = 100  # samples


def check_sizes(
    traces: Mapping[str, np.ndarray],
    names: Iterable[str],
    limit: float,
    unit: str,
    said: str,
    times: float = 3.0,
) -> None:
    """Raise `RecordError` if one of some traces (S,), SI, by name, is ever ``times`` its limit.

    No fault does that. ``said`` names the actuator and its limit.
    """
    smaller, factor = {"A": ("mA", 1e-3), "V": ("mV", 1e-3), "rad/s": ("rpm", np.pi / 30.0)}[unit]
    for name in (name for name in names if name in traces):
        largest = float(np.abs(traces[name]).max())
        if largest <= times * limit:
            continue
        hint = (
            f'It looks like {smaller}: give unit = "{smaller}" in the map.'
            if largest * factor <= times * limit
            else "Check its unit and scale, or the actuator."
        )
        raise RecordError(f"{name} reaches {largest:.4g} {unit}; {said}. {hint}")


def check_enough(recording: Recording) -> None:
    """Raise `RecordError` unless a recording has samples enough to tell faults apart."""
    if len(recording) < FEWEST:
        raise RecordError(
            f"The record has {len(recording)} samples; at least {FEWEST} are needed to tell "
            "faults apart. Record longer or faster."
        )


def check_moves(current: np.ndarray) -> None:
    """Raise `RecordError` if a current (S,), A, never changes."""
    if np.ptp(current) == 0.0:
        raise RecordError(
            f"The current of the record is constant ({current[0]:g} A): nothing moved. Check the "
            "channel, or record a motion."
        )


def check_travel_of(recording: Recording, name: str) -> None:
    """Raise `RecordError` if a channel, m, spans more than anything travels."""
    span = float(np.ptp(recording.channels[name]))
    if span > 100.0:
        raise RecordError(
            f"{recording.name}: {name} spans {span:.4g} m, which no actuator travels; its unit is "
            f"probably mm. Name it {name}_mm or put [mm] into the name."
        )
