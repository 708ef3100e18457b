"""From the channels of a file to columns in SI: matched, read once, converted in place."""

from copy import deepcopy
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.channel import Channel, channel_called, derivable
from ematwin.recordings.channel_map import PHASES, ChannelMap, MappedChannel
from ematwin.recordings.formats.base import Progress, RecordedFile
from ematwin.recordings.matching import Needs, match
from ematwin.recordings.names import first_names, last_part
from ematwin.recordings.recording import label_text
from ematwin.recordings.sampling import ABSURD
from ematwin.recordings.units import bare, beside, fits, unit_factor, unit_in_name


@dataclass
class Collected:
    """Columns in SI on their time bases, and the account of their conversion."""

    file: RecordedFile
    map: ChannelMap
    names: list[str]  # of the channels of the file that were used
    assumed: list[str]  # sentences for the provenance, as `changed` and `warnings`
    warnings: list[str]
    changed: list[str] = field(default_factory=list)
    labels: dict[str, str] = field(default_factory=dict)  # of a motion in a table of motions
    columns: dict[str, np.ndarray] = field(default_factory=dict)  # (S,), SI, by channel
    bases: dict[str, str] = field(default_factory=dict)  # key of the time base, by channel
    times: dict[str, np.ndarray] = field(default_factory=dict)  # (S,), s, by time base
    # (S,), s, of all columns, once they are on one base
    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)  # account, by channel
    # lowest and highest value that the converter gives, by channel
    full_scales: dict[str, tuple[float, float]] = field(default_factory=dict)
    start: datetime | None = None  # the moment from which time is counted
    masked: list[list[float]] = field(default_factory=list)  # [start, stop], s, of filled stretches

    @property
    def source(self) -> str:
        """Name of the file."""
        return self.file.given.name

    @property
    def name(self) -> str:
        """File and labels, for messages."""
        return f"{self.file.given} {label_text(self.labels)}".strip()

    def part(self, rows: slice, labels: dict[str, str]) -> "Collected":
        """Some rows of it; all its channels have one time base."""
        shared = ("file", "map", "columns", "times")
        rest = {name: deepcopy(one) for name, one in vars(self).items() if name not in shared}
        return Collected(**rest | {
            "file": self.file, "map": self.map, "labels": labels,
            "columns": {name: values[rows] for name, values in self.columns.items()},
            "times": {key: time[rows] for key, time in self.times.items()},
        })  # fmt: skip


def collect(
    file: RecordedFile, channel_map: ChannelMap, needs: Needs, progress: Progress | None = None
) -> Collected:
    """Read the channels of a file that are mapped or found by name (see `match`).

    Raises `RecordError` if one is missing or ambiguous, holds no numbers, or has another unit.
    """
    matched = match(file, channel_map, needs)
    uses = [name for name, _ in matched.channels.values()]
    result = Collected(file, channel_map, list(dict.fromkeys(uses)), [], matched.warnings)
    raw = file.read(result.names, progress)
    result.assumed += [*file.assumed, *matched.assumed]  # reading may add to the file's
    carried = dict(zip(PHASES, (f"current_{one}" for one in channel_map.phase_order), strict=True))
    for column, (name, entry) in matched.channels.items():
        values = raw[name].copy() if uses.count(name) > 1 else raw.pop(name)
        _add(result, channel_map.channel(carried.get(column, column)), name, entry, values)
    if channel_map.phase_order != "abc":
        said = ", ".join(f"the channel mapped as {old} is {new}" for old, new in carried.items())
        result.changed.append(f"phase order {channel_map.phase_order}: {said}")
    silent = [
        f"{column} in {account['unit']}"
        for column, account in result.channels.items()
        if account["unit_from"] == "assumed"
    ]
    if silent:
        result.assumed.append(
            f"neither the map nor the file states a unit, so SI was taken: {', '.join(silent)}"
        )
    _find_times(result)
    derive(result)
    return result


def derive(found: Collected, time: np.ndarray | None = None) -> None:
    """Add the channels that follow from others of one time base; drop those that stood in.

    ``time`` (S,) belongs to all columns, once they have one: channels may follow from it.
    """
    channels = found.map.channels
    columns = found.columns if time is None else found.columns | {"time": time}
    for channel in derivable(channels, columns):
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
    for channel in channels:
        if channel.stands_in_for in found.columns:
            found.columns.pop(channel.name, None)
            found.bases.pop(channel.name, None)


def _add(
    found: Collected, channel: Channel, name: str, entry: MappedChannel, values: np.ndarray
) -> None:
    """Convert the values of a channel in place, and add them with their account."""
    unit, source = _unit(found, channel, name, entry)
    what = f"{channel.name} (channel {name!r} of {found.file.path})"
    factor = unit_factor(unit, channel.unit, what)
    if entry.unwrap:
        values = np.unwrap(values, period=2.0 * np.pi / (factor * abs(entry.scale)))
    if entry.side is not None and entry.side != channel.side:
        assert found.map.gear_ratio is not None
        # angles and speeds of the output are smaller than the motor's, a torque larger
        up = (entry.side == "output") != (channel.unit == "N*m")
        factor *= found.map.gear_ratio if up else 1.0 / found.map.gear_ratio
    factor *= entry.sign
    if (most := entry.full_scale) is not None:
        low, high = sorted(factor * (end + entry.offset) for end in (-most, most))
        found.full_scales[channel.name] = (low, high)
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
    account = entry.model_dump(exclude={"channel", "unit"}, exclude_defaults=True)
    found.channels[channel.name] = {"channel": name, "unit": unit, "unit_from": source} | account
    found.columns[channel.name] = values
    found.bases[channel.name] = found.file.time_base(name)


def _unit(found: Collected, channel: Channel, name: str, entry: MappedChannel) -> tuple[str, str]:
    """The unit of a channel and who states it: map, file, name, or nobody (SI is assumed)."""
    file, stated, chosen = found.file, found.file.stated_unit(name), entry.unit
    if chosen is None and entry.channel != name and fits(beside(entry.channel)[1], channel.unit):
        chosen = beside(entry.channel)[1]  # "Phase A [mA]" in the map for the channel "Phase A"
    if chosen is not None:
        if stated and stated != chosen:
            found.warnings.append(
                f"The map gives {channel.name} in {chosen}, the file in {stated}; the map was "
                "followed."
            )
        return chosen, "map"
    if stated:
        # a scale leads from the unit of the file (volts of a probe) to another one
        return (stated, "file") if entry.scale == 1.0 else (channel.unit, "scale")
    is_own = channel_called(bare(last_part(name)), found.map.channels) is not None
    # current_a is phase a, no current in A
    unit = (beside(name) if is_own else unit_in_name(name, channel.unit, file.names))[1]
    return (unit, "name") if fits(unit, channel.unit) else (channel.unit, "assumed")


def _find_times(found: Collected) -> None:
    """Times of each base: from the sample rate, the time channel, or the file's own base."""
    file, rate = found.file, found.map.sample_rate
    time, key_of_time = found.columns.pop("time", None), found.bases.pop("time", None)
    lengths = {name: values.size for name, values in found.columns.items()}
    if rate is not None:
        if len(set(lengths.values())) > 1:
            raise RecordError(
                f"With sample_rate all channels of {file.path} must be equally long; they "
                f"have {', '.join(f'{name} {size}' for name, size in lengths.items())} samples."
            )
        found.changed.append(f"time was counted from a rate of {rate:g} Hz")
    for column, key in found.bases.items():
        if key in found.times:
            continue
        if rate is not None:
            found.times[key] = np.arange(lengths[column]) / rate
        elif key != key_of_time and (own := file.base_time(key)) is not None:
            found.times[key], found.start = own, file.start
        elif time is None:
            raise RecordError(
                f"{file.path} has no channel for time, and its format gives none for "
                f"{column}; it has {first_names(file.names)}. "
                'Map it, such as time="t [ms]", or give sample_rate.'
            )
        elif time.size != lengths[column]:
            raise RecordError(
                f"{column} of {file.path} has {lengths[column]} samples, time has "
                f"{time.size}. Map channels that were sampled together."
            )
        else:
            found.times[key] = time
            found.start = file.clocks.get(found.channels["time"]["channel"])
    if any(length.size == 0 for length in found.times.values()):
        raise RecordError(f"{file.path} holds no rows; nothing was recorded. Leave it out.")
