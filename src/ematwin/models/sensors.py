"""Gain and offset of each sensor, and how late the command was recorded, for any kind.

A sensor that is a few per cent off, or a command that was recorded late, looks like a fault. Where
whole traces are compared, the twin's side of each channel is gain times answer plus offset, and the
answer to a command that was recorded late is read as much later. Kinds that score candidates while
they simulate them state such nuisances among their unknowns.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from ematwin.models.unknown import Unknown, nuisance

SKEW = "skew"
# standard deviations: usual data sheets state sensors to 2 % and 1 % of their range, two sigma; the
# channels of a recorder are read within one cycle
_GAIN, _OFFSET = 0.01, 0.005
_REACH = 10.0  # standard deviations: bounds


def sensors_of(channels: Iterable[str], rate: float, stated: Iterable[str]) -> tuple[Unknown, ...]:
    """Nuisances of compared channels that are recorded at a ``rate``, Hz.

    An author who states marginal nuisances, by name, states those of sensors; all but when the
    command came. An offset is a share of the largest value recorded.
    """
    rows = [(SKEW, "s", "how late the command was recorded", 0.0, 1.0 / rate)]
    for name in () if (known := set(stated)) else channels:
        rows += [
            (f"{name}_gain", "", f"gain of the sensor of {name}", 1.0, _GAIN),
            (f"{name}_offset", "", f"offset of the sensor of {name}, over its largest value", 0.0,
             _OFFSET),
        ]  # fmt: skip
    return tuple(
        nuisance(name, unit, meaning, healthy, _REACH * spread, spread)
        for name, unit, meaning, healthy, spread in rows
        if name not in known
    )


def as_sensed(
    answer: Mapping[str, np.ndarray],
    values: Mapping[str, np.ndarray],
    sizes: Mapping[str, float],
    interval: float,
) -> dict[str, np.ndarray]:
    """Traces (B, S) by channel as sensors with ``values`` (B,) show them, by name of `sensors_of`.

    ``sizes`` are the largest values recorded, by channel.
    """
    late, found = values.get(SKEW), {}
    for name, trace in answer.items():
        seen = trace if late is None else _later(trace, late / interval)
        gain, offset = (values.get(f"{name}_{what}") for what in ("gain", "offset"))
        if gain is not None:
            seen = gain[:, None] * seen
        found[name] = seen if offset is None else seen + (offset * sizes[name])[:, None]
    return found


def _later(traces: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Traces (B, S) read by so many samples (B,) later; ends go on as they are."""
    from scipy.ndimage import shift

    if not samples.any():
        return traces
    found = traces.copy()
    for n in np.flatnonzero(samples):
        found[n] = shift(traces[n], -samples[n], order=3, mode="nearest")
    return found
