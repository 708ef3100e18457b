"""From the channels of a file to columns in SI: matched, read once, converted in place."""

from copy import deepcopy
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.channel import Channel, channel_called, derivable
from ematwin.recordings.channel_map import PHASES, ChannelMap, MappedChannel
from ematwin.recordings.formats.base import Progress, RecordedFile
from ematwin.recordings.matching import Needs, match
from ematwin.recordings.names import last_part, listed
from ematwin.recordings.recording import label_text
from ematwin.recordings.sampling import ABSURD
from ematwin.recordings.units import bare, beside, fits, unit_factor, unit_in_name


@dataclass
class Collected:
    """Columns in SI on their time bases, and the account of their conversion.

    Attributes
    ----------
    path : of the file
    labels : of the motion that it is, in a table of motions
    columns : dict of channel to (S,) array, SI
    bases : dict of channel to the key of its time base
    times : dict of time base to (S,) array, s
    time : (S,) array, s, of all columns, once they are on one base
    channels : dict of channel to its account for the provenance
    full_scales : dict of channel to the lowest and highest value that the converter gives
    names : full names in the file of the channels that were used
    start : datetime or None, the moment from which time is counted
    masked : [start, stop], s, of stretches that were filled by straight lines
    assumed, changed, warnings : sentences for the provenance
    """

    path: Path
    labels: dict[str, str] = field(default_factory=dict)
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    bases: dict[str, str] = field(default_factory=dict)
    times: dict[str, np.ndarray] = field(default_factory=dict)
    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    full_scales: dict[str, tuple[float, float]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    start: datetime | None = None
    masked: list[list[float]] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def source(self) -> str:
        """Name of the file."""
        return self.path.name

    @property
    def name(self) -> str:
        """File and labels, for messages."""
        return f"{self.path} {label_text(self.labels)}".strip()

    def part(self, rows: slice, labels: dict[str, str]) -> "Collected":
        """Some rows of it; all its channels have one time base."""
        rest = deepcopy(replace(self, columns={}, times={}, labels=labels))
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
    result = Collected(file.given, names=list(dict.fromkeys(uses)), warnings=matched.warnings)
    raw = file.read(result.names, progress)
    result.assumed += [*file.assumed, *matched.assumed]  # reading may add to the file's
    for column, (name, entry) in matched.channels.items():
        values = raw[name].copy() if uses.count(name) > 1 else raw.pop(name)
        channel = channel_map.channel(column)
        result.columns[column] = _in_si(channel, name, entry, values, file, channel_map, result)
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
    channel: Channel,
    name: str,
    entry: MappedChannel,
    values: np.ndarray,
    file: RecordedFile,
    channel_map: ChannelMap,
    result: Collected,
) -> np.ndarray:
    """Values converted in place, and their account."""
    unit, source = _unit(channel, name, entry, file, channel_map, result)
    what = f"{channel.name} (channel {name!r} of {file.path})"
    factor = unit_factor(unit, channel.unit, what)
    if entry.unwrap:
        values = np.unwrap(values, period=2.0 * np.pi / (factor * abs(entry.scale)))
    if entry.side is not None and entry.side != channel.side:
        assert channel_map.gear_ratio is not None
        # angles and speeds of the output are smaller than the motor's, a torque larger
        up = (entry.side == "output") != (channel.unit == "N*m")
        factor *= channel_map.gear_ratio if up else 1.0 / channel_map.gear_ratio
    factor *= entry.sign
    if entry.full_scale is not None:
        ends = sorted(
            factor * (end + entry.offset) for end in (-entry.full_scale, entry.full_scale)
        )
        result.full_scales[channel.name] = (ends[0], ends[1])
    if factor * entry.scale != 1.0:
        values *= factor * entry.scale
    if entry.offset != 0.0:
        values += factor * entry.offset
    absurd = np.flatnonzero(np.isfinite(values) & (np.abs(values) > ABSURD))
    if absurd.size:
        raise RecordError(
            f"{what} reaches {values[absurd[0]]:.3g} {channel.unit} at sample {absurd[0]}, which "
            "nothing does. The file is damaged, or another channel was meant."
        )
    account: dict[str, Any] = {"channel": name, "unit": unit, "unit_from": source}
    account |= entry.model_dump(exclude={"channel", "unit"}, exclude_defaults=True)
    result.channels[channel.name] = account
    return values


def _unit(
    channel: Channel,
    name: str,
    entry: MappedChannel,
    file: RecordedFile,
    channel_map: ChannelMap,
    result: Collected,
) -> tuple[str, str]:
    """The unit of a channel and who states it: map, file, name, or nobody (SI is assumed)."""
    stated, chosen = file.stated_unit(name), entry.unit
    if chosen is None and entry.channel != name and fits(beside(entry.channel)[1], channel.unit):
        chosen = beside(entry.channel)[1]  # "Phase A [mA]" in the map for the channel "Phase A"
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
    if fits(beside(name)[1], channel.unit):
        return beside(name)[1], "name"
    is_own = channel_called(bare(last_part(name)), channel_map.channels) is not None
    # current_a is phase a, no current in A
    unit = "" if is_own else unit_in_name(name, channel.unit, file.names)[1]
    return (unit, "name") if unit else (channel.unit, "assumed")


def _put_phases_in_order(result: Collected, order: str) -> None:
    if order == "abc":
        return
    renamed = {old: f"current_{letter}" for old, letter in zip(PHASES, order, strict=True)}
    parts: tuple[dict[str, Any], ...] = (
        result.columns, result.bases, result.channels, result.full_scales,
    )  # fmt: skip
    for part in parts:
        part |= {new: part.pop(old) for old, new in renamed.items() if old in part}
    said = ", ".join(f"the channel mapped as {old} is {new}" for old, new in renamed.items())
    result.changed.append(f"phase order {order}: {said}")


def _find_times(file: RecordedFile, channel_map: ChannelMap, result: Collected) -> None:
    """Times of each base: from the sample rate, the time channel, or the file's own base."""
    time = result.columns.pop("time", None)
    key_of_time = result.bases.pop("time", None)
    lengths = {name: values.size for name, values in result.columns.items()}
    rate = channel_map.sample_rate
    if rate is not None:
        if len(set(lengths.values())) > 1:
            raise RecordError(
                f"With sample_rate all channels of {file.path} must be equally long; they "
                f"have {', '.join(f'{name} {size}' for name, size in lengths.items())} samples."
            )
        result.changed.append(f"time was counted from a rate of {rate:g} Hz")
    for column, key in result.bases.items():
        if key in result.times:
            continue
        is_given = rate is not None or (time is not None and key == key_of_time)
        own = None if is_given else file.base_time(key)
        if rate is not None:
            result.times[key] = np.arange(lengths[column]) / rate
        elif time is not None and own is None:
            if time.size != lengths[column]:
                raise RecordError(
                    f"{column} of {file.path} has {lengths[column]} samples, time has "
                    f"{time.size}. Map channels that were sampled together."
                )
            result.times[key] = time
            result.start = file.clocks.get(result.channels["time"]["channel"])
        elif own is None:
            raise RecordError(
                f"{file.path} has no channel for time, and its format gives none for "
                f"{column}; it has {listed(file.names)}. "
                'Map it, such as time="t [ms]", or give sample_rate.'
            )
        else:
            result.times[key] = own
            result.start = file.start
    if any(length.size == 0 for length in result.times.values()):
        raise RecordError(f"{file.path} holds no rows; nothing was recorded. Leave it out.")
