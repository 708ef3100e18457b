"""From the channels of a file to columns in SI: matched, read once, converted in place."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.channel import Channel, channel_called, derivable
from ematwin.recordings.channel_map import PHASES, ChannelMap, MappedChannel
from ematwin.recordings.formats.base import Progress, RecordedFile, last_part
from ematwin.recordings.match import Needs, match
from ematwin.recordings.timing import ABSURD
from ematwin.recordings.units import (
    bare,
    says_nothing,
    unit_factor,
    unit_in_brackets,
    unit_in_name,
)


@dataclass
class Collected:
    """Columns in SI on their own time bases, and what was done to get them.

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
        return Collected(
            {name: values[rows] for name, values in self.columns.items()},
            dict(self.bases),
            {key: time[rows] for key, time in self.times.items()},
            deepcopy(self.channels),
            dict(self.full_scales),
            list(self.names),
            self.start,
            list(self.assumed),
            list(self.changed),
            list(self.warnings),
        )


def collect(
    file: RecordedFile, channel_map: ChannelMap, needs: Needs, progress: Progress | None = None
) -> Collected:
    """Read the channels of a file that are mapped or found by name (see `match`).

    Raises
    ------
    RecordError
        If a channel is missing or ambiguous, holds no numbers, or its unit does not fit.
    """
    found = match(file, channel_map, needs)
    result = Collected(names=list(dict.fromkeys(name for name, _ in found.values())))
    raw = file.read(result.names, progress)
    result.assumed += file.assumed  # reading may add to them
    uses = [name for name, _ in found.values()]
    for column, (name, entry) in found.items():
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


def derive(found: Collected, channel_map: ChannelMap) -> None:
    """Add the channels that follow from others of one time base; drop those that stood in.

    Raises
    ------
    RecordError
        If means over different intervals would be combined.
    """
    for channel in derivable(channel_map.channels, found.columns):
        derivation = channel.derived
        assert derivation is not None
        sources = derivation.sources
        keys = [found.bases[source] for source in sources]
        if len(set(keys)) > 1:
            if channel.is_mean:
                raise RecordError(
                    f"{' and '.join(sources)} were sampled at different times "
                    f"({' and '.join(keys)}), so {channel.name} cannot be derived from them. "
                    f"Give {channel.name} as well."
                )
            continue  # until all are on one base
        found.columns[channel.name] = derivation.compute(*(found.columns[s] for s in sources))
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
        turn = 2.0 * np.pi / (factor * abs(entry.scale))
        values = np.unwrap(values, period=turn)
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
    """The unit of a channel and who says so: map, file, name, or nobody (SI is assumed)."""
    si_unit = channel.unit
    stated = file.unit(name)
    stated = None if says_nothing(stated) else stated
    in_map = unit_in_brackets(entry.channel, si_unit)
    chosen = entry.unit
    if chosen is None and in_map is not None and entry.channel != name:
        chosen = in_map  # "Phase A [mA]" in the map for the channel "Phase A"
    if chosen is not None:
        if stated is not None and stated != chosen:
            result.warnings.append(
                f"The map gives {channel.name} in {chosen}, the file in {stated}; the map was "
                "followed."
            )
        return chosen, "map"
    if stated is not None:
        if entry.scale == 1.0:
            return stated, "file"
        # a scale leads from what the file holds (volts of a probe) to something else
        return si_unit, "scale"
    whole = bare(last_part(name))
    if channel_called(whole, channel_map.channels) is not None:
        in_name = unit_in_brackets(name, si_unit)  # current_a is phase a, and no current in A
    else:
        in_name = unit_in_name(name, si_unit, file.names)
    if in_name is not None:
        return in_name, "name"
    return si_unit, "assumed"


def _put_phases_in_order(result: Collected, order: str) -> None:
    if order == "abc":
        return
    renamed = dict(zip(PHASES, (f"current_{letter}" for letter in order), strict=True))
    for part in (result.columns, result.bases, result.channels, result.full_scales):
        _rename(part, renamed)
    result.changed.append(
        f"phase order {order}: "
        + ", ".join(f"the channel mapped as {old} is {new}" for old, new in renamed.items())
    )


def _rename(part: dict[str, Any], renamed: Mapping[str, str]) -> None:
    moved = {new: part.pop(old) for old, new in renamed.items() if old in part}
    part.update(moved)


def _find_times(file: RecordedFile, channel_map: ChannelMap, result: Collected) -> None:
    """Times of each base: from the sample rate, the time channel, or the file's own base."""
    time = result.columns.pop("time", None)
    key_of_time = result.bases.pop("time", None)
    for column, key in result.bases.items():
        if key in result.times:
            continue
        length = result.columns[column].size
        if channel_map.sample_rate is not None:
            result.times[key] = np.arange(length) / channel_map.sample_rate
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
    if channel_map.sample_rate is not None:
        lengths = {name: values.size for name, values in result.columns.items()}
        if len(set(lengths.values())) > 1:
            raise RecordError(
                f"With sample_rate all channels of {file.path} must be equally long; they "
                f"have {', '.join(f'{name} {size}' for name, size in lengths.items())} samples."
            )
        result.changed.append(f"time was counted from a rate of {channel_map.sample_rate:g} Hz")
    if any(length.size == 0 for length in result.times.values()):
        raise RecordError(f"{file.path} holds no rows; nothing was recorded. Leave it out.")
