"""From the channels of a file to columns in SI: matched, read once, converted in place."""

from copy import deepcopy
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.channel import Channel, channel_called, derivable
from ematwin.recordings.channel_map import PHASES, ChannelMap, MappedChannel
from ematwin.recordings.formats.base import Progress, RecordedFile
from ematwin.recordings.matching import Needs, match
from ematwin.recordings.names import last_part
from ematwin.recordings.sampling import ABSURD
from ematwin.recordings.units import (
    bare,
    unit_factor,
    unit_in_brackets,
    unit_in_name,
)


@dataclass
class Collected:
    """Columns in SI on their time bases, and the account of their conversion.

    Attributes
    ----------
    columns : dict of channel to (S,) array, SI
    bases : dict of channel to the key of its time base
    times : dict of time base to (S,) array, s
    channels : dict of channel to its account for the provenance
    full_scales : dict of channel to the lowest and highest value that the converter gives
    names : full names in the file of the channels that were used
    start : datetime or None, the moment from which time is counted
    assumed, changed, warnings : sentences for the provenance
    """

    columns: dict[str, np.ndarray] = field(default_factory=dict)
    bases: dict[str, str] = field(default_factory=dict)
    times: dict[str, np.ndarray] = field(default_factory=dict)
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    full_scales: dict[str, tuple[float, float]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    start: datetime | None = None
    assumed: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def part(self, rows: slice) -> "Collected":
        """Some rows of it; all its channels have one time base."""
        rest = deepcopy(replace(self, columns={}, times={}))
        rest.columns = {name: values[rows] for name, values in self.columns.items()}
        rest.times = {key: time[rows] for key, time in self.times.items()}
        return rest


def collect(
    file: RecordedFile, channel_map: ChannelMap, needs: Needs, progress: Progress | None = None
) -> Collected:
    """Read the channels of a file that are mapped or found by name (see `match`).

    Raises
    ------
    RecordError
        If a channel is missing or ambiguous, holds no numbers, or its unit does not fit.
    """
    matched = match(file, channel_map, needs)
    uses = [name for name, _ in matched.channels.values()]
    result = Collected(names=list(dict.fromkeys(uses)), warnings=matched.warnings)
    raw = file.read(result.names, progress)
    result.assumed += [*file.assumed, *matched.assumed]  # reading may add to the file's
    for column, (name, entry) in matched.channels.items():
        values = raw[name].copy() if uses.count(name) > 1 else raw.pop(name)
        result.columns[column] = _in_si(column, name, entry, values, file, channel_map, result)
        result.bases[column] = file.time_base(name)
    silent = [
        f"{column} in {account['unit']}"
        for column, account in result.channels.items()
        if account["unit_from"] == "assumed"
    ]
    if silent:
        result.assumed.append(
            f"neither the map nor the file states a unit, so SI was taken: {', '.join(silent)}"
        )
    _put_phases_in_order(result, channel_map.phase_order)
    _find_times(file, channel_map, result)
    derive(result, channel_map)
    return result


def derive(found: Collected, channel_map: ChannelMap, time: np.ndarray | None = None) -> None:
    """Add the channels that follow from others of one time base; drop those that stood in.

    ``time`` (S,) belongs to all columns, once they have one: channels may follow from it.

    Raises
    ------
    RecordError
        If means over different intervals would be combined.
    """
    columns = found.columns if time is None else found.columns | {"time": time}
    for channel in derivable(channel_map.channels, columns):
        derivation = channel.derived
        assert derivation is not None
        sources = derivation.sources
        keys = [found.bases.get(source, next(iter(found.bases.values()))) for source in sources]
        if len(set(keys)) > 1:
            if channel.is_mean:
                raise RecordError(
                    f"{' and '.join(sources)} were sampled at different times "
                    f"({' and '.join(keys)}), so {channel.name} cannot be derived from them. "
                    f"Give {channel.name} as well."
                )
            continue  # until all are on one base
        found.columns[channel.name] = derivation.compute(*(columns[s] for s in sources))
        found.bases[channel.name] = keys[0]
        found.channels[channel.name] = {"derived": derivation.formula}
        found.changed.append(f"{channel.name} was derived as {derivation.formula}")
    for channel in channel_map.channels:
        if channel.stands_in_for in found.columns:
            found.columns.pop(channel.name, None)
            found.bases.pop(channel.name, None)


def _in_si(
    column: str,
    name: str,
    entry: MappedChannel,
    values: np.ndarray,
    file: RecordedFile,
    channel_map: ChannelMap,
    result: Collected,
) -> np.ndarray:
    """Values converted in place, and their account."""
    channel = channel_map.channel(column)
    unit, source = _unit(name, entry, file, channel_map, channel, result)
    factor = unit_factor(unit, channel.unit, f"{column} (channel {name!r} of {file.path})")
    if entry.unwrap:
        values = np.unwrap(values, period=2.0 * np.pi / (factor * abs(entry.scale)))
    if entry.side is not None and entry.side != channel.side:
        assert channel_map.gear_ratio is not None
        # angles and speeds of the output are smaller than the motor's, a torque larger
        up = (entry.side == "output") != (channel.unit == "N*m")
        factor *= channel_map.gear_ratio if up else 1.0 / channel_map.gear_ratio
    if entry.full_scale is not None:
        ends = [
            entry.sign * factor * (side * entry.full_scale + entry.offset) for side in (-1.0, 1.0)
        ]
        result.full_scales[column] = (min(ends), max(ends))
    gain = entry.sign * factor * entry.scale
    if gain != 1.0:
        values *= gain
    if entry.offset != 0.0:
        values += entry.sign * factor * entry.offset
    absurd = np.flatnonzero(np.isfinite(values) & (np.abs(values) > ABSURD))
    if absurd.size:
        raise RecordError(
            f"{column} (channel {name!r} of {file.path}) reaches {values[absurd[0]]:.3g} "
            f"{channel.unit} at sample {absurd[0]}, which nothing does. The file is damaged, or "
            "another channel was meant."
        )
    account: dict[str, Any] = {"channel": name, "unit": unit, "unit_from": source}
    account |= entry.model_dump(exclude={"channel", "unit"}, exclude_defaults=True)
    result.channels[column] = account
    return values


def _unit(
    name: str,
    entry: MappedChannel,
    file: RecordedFile,
    channel_map: ChannelMap,
    channel: Channel,
    result: Collected,
) -> tuple[str, str]:
    """The unit of a channel and who states it: map, file, name, or nobody (SI is assumed)."""
    stated = file.stated_unit(name)
    chosen = entry.unit
    if chosen is None and entry.channel != name:
        # "Phase A [mA]" in the map for the channel "Phase A"
        chosen = unit_in_brackets(entry.channel, channel.unit)
    if chosen is not None:
        if stated and stated != chosen:
            result.warnings.append(
                f"The map gives {channel.name} in {chosen}, the file in {stated}; the map was "
                "followed."
            )
        return chosen, "map"
    if stated:
        # a scale leads from the unit of the file (volts of a probe) to another one
        return (stated, "file") if entry.scale == 1.0 else (channel.unit, "scale")
    if channel_called(bare(last_part(name)), channel_map.channels) is not None:
        in_name = unit_in_brackets(name, channel.unit)  # current_a is phase a, no current in A
    else:
        in_name = unit_in_name(name, channel.unit, file.names)
    return (channel.unit, "assumed") if in_name is None else (in_name, "name")


def _put_phases_in_order(result: Collected, order: str) -> None:
    if order == "abc":
        return
    renamed = dict(zip(PHASES, (f"current_{letter}" for letter in order), strict=True))
    parts: tuple[dict[str, Any], ...] = (
        result.columns, result.bases, result.channels, result.full_scales,
    )  # fmt: skip
    for part in parts:
        part |= {new: part.pop(old) for old, new in renamed.items() if old in part}
    result.changed.append(
        f"phase order {order}: "
        + ", ".join(f"the channel mapped as {old} is {new}" for old, new in renamed.items())
    )


def _find_times(file: RecordedFile, channel_map: ChannelMap, result: Collected) -> None:
    """Times of each base: from the sample rate, the time channel, or the file's own base."""
    time = result.columns.pop("time", None)
    key_of_time = result.bases.pop("time", None)
    rate = channel_map.sample_rate
    for column, key in result.bases.items():
        if key in result.times:
            continue
        length = result.columns[column].size
        if rate is not None:
            result.times[key] = np.arange(length) / rate
        elif time is not None and (key == key_of_time or file.base_time(key) is None):
            if time.size != length:
                raise RecordError(
                    f"{column} of {file.path} has {length} samples, time has {time.size}. "
                    "Map channels that were sampled together."
                )
            result.times[key] = time
            result.start = file.clocks.get(result.channels["time"]["channel"])
        else:
            own = file.base_time(key)
            if own is None:
                raise RecordError(
                    f"{file.path} has no channel for time, and its format gives none for "
                    f"{column}; it has {', '.join(file.names[:12])}. "
                    'Map it, such as time="t [ms]", or give sample_rate.'
                )
            result.times[key] = own
            result.start = file.start
    if rate is not None:
        lengths = {name: values.size for name, values in result.columns.items()}
        if len(set(lengths.values())) > 1:
            raise RecordError(
                f"With sample_rate all channels of {file.path} must be equally long; they "
                f"have {', '.join(f'{name} {size}' for name, size in lengths.items())} samples."
            )
        result.changed.append(f"time was counted from a rate of {rate:g} Hz")
    if any(length.size == 0 for length in result.times.values()):
        raise RecordError(f"{file.path} holds no rows; nothing was recorded. Leave it out.")
