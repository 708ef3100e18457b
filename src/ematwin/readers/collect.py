"""From the channels of a recording to columns in SI: resolve, read once, convert in place."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.readers.column_map import SIDES, Channel, ColumnMap, record_column
from ematwin.readers.recording import Progress, Recording, bare, find_channel, last_part
from ematwin.readers.timing import ABSURD
from ematwin.readers.units import says_nothing, unit_factor, unit_in_name
from ematwin.signals.record import COLUMNS, PHASES, UNITS


@dataclass
class Collected:
    """Columns in SI on their own time bases, and what was done to get them.

    Attributes
    ----------
    columns : dict of record column to (S,) array, SI
    bases : dict of record column to the key of its time base
    times : dict of time base to (S,) array, s
    channels : dict of record column to its account for the provenance
    full_scales : dict of record column to the lowest and highest value that the converter gives
    assumed, changed, warnings : sentences for the provenance
    """

    columns: dict[str, np.ndarray] = field(default_factory=dict)
    bases: dict[str, str] = field(default_factory=dict)
    times: dict[str, np.ndarray] = field(default_factory=dict)
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    full_scales: dict[str, tuple[float, float]] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def collect(
    recording: Recording, column_map: ColumnMap, progress: Progress | None = None
) -> Collected:
    """Read the mapped channels of a recording.

    Columns that the map does not name are found by their own name or alias: all of them if the
    map names none, else only time and command.

    Raises
    ------
    RecordError
        If a channel is missing or ambiguous, holds no numbers, or its unit does not fit.
    """
    found = _resolve(recording, column_map)
    _check_complete(recording, column_map, found)
    result = Collected(assumed=recording.assumed)
    names = list(dict.fromkeys(name for name, _ in found.values()))
    raw = recording.read(names, progress)
    uses = [name for name, _ in found.values()]
    for column, (name, entry) in found.items():
        values = raw[name].copy() if uses.count(name) > 1 else raw.pop(name)
        result.columns[column] = _in_si(column, name, entry, values, recording, column_map, result)
        result.bases[column] = recording.time_base(name)
    silent = [
        f"{column} in {account['unit']}"
        for column, account in result.channels.items()
        if account["unit_from"] == "assumed"
    ]
    if silent:
        result.assumed.append(f"{', '.join(silent)}: neither the map nor the file names a unit")
    _put_phases_in_order(result, column_map.phase_order)
    _derive_third_phase(result)
    _find_times(recording, column_map, result)
    return result


def _resolve(recording: Recording, column_map: ColumnMap) -> dict[str, tuple[str, Channel]]:
    """Record column -> full channel name and entry of the map."""
    found = {
        column: (find_channel(recording.names, entry.channel, recording.path), entry)
        for column, entry in column_map.columns.items()
    }
    by_itself = ("time", "command") if column_map.columns else tuple(COLUMNS)
    for name in recording.names:
        column = record_column(bare(last_part(name))) or record_column(bare(name))
        if column not in by_itself or column in column_map.columns:
            continue
        if column == "time" and column_map.sample_rate is not None:
            continue
        if column in found:
            if name == column:  # the plain name wins over an alias or a unit in brackets
                found[column] = (name, Channel(channel=name))
            elif found[column][0] != column:
                raise RecordError(
                    f"{recording.path} has two channels for {column}: {found[column][0]!r} and "
                    f"{name!r}. Map one of them."
                )
            continue
        found[column] = (name, Channel(channel=name))
    return {column: found[column] for column in COLUMNS if column in found}


def _check_complete(
    recording: Recording, column_map: ColumnMap, found: Mapping[str, tuple[str, Channel]]
) -> None:
    listed = ", ".join(repr(name) for name in recording.names[:12])
    more = f" and {len(recording.names) - 12} more" if len(recording.names) > 12 else ""
    if "command" not in found:
        raise RecordError(
            f"{recording.path} has no column 'command', the commanded output position; it has "
            f'{listed}{more}. Map it, such as command="Setpoint [deg]".'
        )
    phases = [name for name in PHASES if name in found]
    if len(phases) < 2 and "current" not in found:
        raise RecordError(
            f"{recording.path} has no current: give at least two of current_a, current_b and "
            f"current_c, or current; it has {listed}{more}."
        )


def _in_si(
    column: str,
    name: str,
    entry: Channel,
    values: np.ndarray,
    recording: Recording,
    column_map: ColumnMap,
    result: Collected,
) -> np.ndarray:
    """Values converted in place, and their account."""
    unit, source = _unit(column, name, entry, recording, result)
    factor = unit_factor(unit, UNITS[column], f"{column} (channel {name!r} of {recording.path})")
    if entry.unwrap:
        turn = 2.0 * np.pi / (factor * abs(entry.scale))
        values = np.unwrap(values, period=turn)
    if entry.side is not None and entry.side != SIDES[column]:
        assert column_map.gear_ratio is not None
        # angles and speeds of the output are smaller than the motor's, a load larger
        up = (entry.side == "output") != (column == "load")
        factor *= column_map.gear_ratio if up else 1.0 / column_map.gear_ratio
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
            f"{column} (channel {name!r} of {recording.path}) reaches {values[absurd[0]]:.3g} "
            f"{UNITS[column]} at sample {absurd[0]}, which nothing does. The file is damaged, or "
            "another channel was meant."
        )
    account: dict[str, Any] = {"channel": name, "unit": unit, "unit_from": source}
    account |= entry.model_dump(exclude={"channel", "unit"}, exclude_defaults=True)
    result.channels[column] = account
    return values


def _unit(
    column: str, name: str, entry: Channel, recording: Recording, result: Collected
) -> tuple[str, str]:
    """The unit of a channel and who says so: map, file, name, or nobody (SI is assumed)."""
    si_unit = UNITS[column]
    stated = recording.unit(name)
    stated = None if says_nothing(stated) else stated
    in_map = unit_in_name(entry.channel, si_unit)
    chosen = entry.unit
    if chosen is None and in_map is not None and entry.channel != name:
        chosen = in_map  # "Phase A [mA]" in the map for the channel "Phase A"
    if chosen is not None:
        if stated is not None and stated != chosen:
            result.warnings.append(
                f"The map gives {column} in {chosen}, the file in {stated}; the map was followed."
            )
        return chosen, "map"
    if stated is not None:
        if entry.scale == 1.0:
            return stated, "file"
        # a scale leads from what the file holds (volts of a probe) to something else
        return si_unit, "scale"
    in_name = unit_in_name(name, si_unit)
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


def _rename(part: dict[str, Any], renamed: dict[str, str]) -> None:
    moved = {new: part.pop(old) for old, new in renamed.items() if old in part}
    part.update(moved)


def _derive_third_phase(result: Collected) -> None:
    given = [name for name in PHASES if name in result.columns]
    if len(given) != 2:
        return
    first, second = given
    missing = next(name for name in PHASES if name not in given)
    if result.bases[first] != result.bases[second]:
        raise RecordError(
            f"{first} and {second} were sampled at different times ({result.bases[first]} and "
            f"{result.bases[second]}), so that {missing} cannot be derived from them. "
            f"Give {missing} as well."
        )
    result.columns[missing] = -(result.columns[first] + result.columns[second])
    result.bases[missing] = result.bases[first]
    result.channels[missing] = {"derived": f"-({first} + {second})"}
    result.changed.append(f"{missing} was derived as minus the sum of {first} and {second}")


def _find_times(recording: Recording, column_map: ColumnMap, result: Collected) -> None:
    """Times of each base: from the sample rate, the time channel, or the file's own base."""
    time = result.columns.pop("time", None)
    key_of_time = result.bases.pop("time", None)
    for column, key in result.bases.items():
        if key in result.times:
            continue
        length = result.columns[column].size
        if column_map.sample_rate is not None:
            result.times[key] = np.arange(length) / column_map.sample_rate
        elif time is not None and (key == key_of_time or recording.base_time(key) is None):
            if time.size != length:
                raise RecordError(
                    f"{column} of {recording.path} has {length} samples, time has {time.size}. "
                    "Map channels that were sampled together."
                )
            result.times[key] = time
        else:
            own = recording.base_time(key)
            if own is None:
                raise RecordError(
                    f"{recording.path} has no column 'time', and its format gives none for "
                    f"{column}; it has {', '.join(recording.names[:12])}. "
                    'Map it, such as time="t [ms]", or give sample_rate.'
                )
            result.times[key] = own
    if column_map.sample_rate is not None:
        lengths = {name: values.size for name, values in result.columns.items()}
        if len(set(lengths.values())) > 1:
            raise RecordError(
                f"With sample_rate all channels of {recording.path} must be equally long; they "
                f"have {', '.join(f'{name} {size}' for name, size in lengths.items())} samples."
            )
        result.changed.append(f"time was counted from a rate of {column_map.sample_rate:g} Hz")
