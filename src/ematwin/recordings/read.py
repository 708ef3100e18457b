"""Recordings in files, for the channels of a given kind of actuator.

`ematwin.models.reading` gives the public `read`, which knows the kinds.
"""

from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from ematwin.errors import InputError, ParameterError, RecordError
from ematwin.quantities import parse_quantity
from ematwin.recordings.channel import Channel, with_time
from ematwin.recordings.channel_map import ChannelMap
from ematwin.recordings.clean import cleaned
from ematwin.recordings.collect import collect
from ematwin.recordings.formats.base import Progress, RecordedFile, open_file
from ematwin.recordings.formats.csv_dialect import ROUTINE
from ematwin.recordings.gaps import Policy, check_policy
from ematwin.recordings.match import Needs
from ematwin.recordings.recording import Recording
from ematwin.recordings.resample import check_rate, to_constant_rate
from ematwin.recordings.sealed import FORMAT
from ematwin.recordings.split import Choice, check_single, fitting_any, pieces

Columns = ChannelMap | Mapping[str, Any] | str | Path | None


def read_file(
    path: Any,
    channels: Sequence[Channel],
    columns: Columns = None,
    *,
    needs: Needs = (),
    inputs: Collection[str] = (),
    own: bool = False,
    resample_to: float | str | None = None,
    gaps: Policy = "refuse",
    split: bool = False,
    where: Choice | Sequence[Choice] | None = None,
    progress: Progress | None = None,
) -> list[Recording]:
    """Read the recordings in a file of ematwin or of a test bench.

    Parameters
    ----------
    path : a file of a known format, or a DataFrame
    channels : those of the kind of actuator
    columns : which channel of the file is which: a `ChannelMap`, a mapping or a TOML file; None
        finds them by name
    needs : groups of channels; of each group at least one whole alternative must be there
    inputs : channels that drive the model
    own : whether a file that ematwin wrote is read as it is, whatever its channels; else it is if
        it has what is needed
    resample_to : float (Hz) or text such as ``"20 kHz"``; None keeps the recorded rate
    gaps : what to do about holes, see `ematwin.recordings.gaps`
    split : whether a table is cut into motions
    where : labels with the values that are wanted, or several such choices; cuts as well
    progress : called with the share read, in [0, 1], now and then

    Returns
    -------
    list of Recording, one unless the file was cut into several motions; only what was chosen has to
        be sound

    Raises
    ------
    InputError
        If the map or an option cannot be used.
    FileError
        If the file cannot be read.
    RecordError
        If a channel is missing or holds what a recording cannot.
    MissingExtraError
        If the library for this format is not installed.
    """
    channel_map = ChannelMap.of(columns, channels)
    check_policy(gaps)
    rate = hertz(resample_to)
    with open_file(path, **channel_map.csv.model_dump(exclude_none=True)) as file:
        _check_format(file)
        if file.metadata and columns is None and (own or _has(file, needs)):
            written = _as_written(file, channel_map.channels, rate, progress)
            return fitting_any([written], where)
        found = collect(file, channel_map, needs, progress)
        if not split and where is None:
            check_single(found, file)
            return [cleaned(found, file, channel_map, inputs=inputs, rate=rate, gaps=gaps)]
        motions = []
        for piece in fitting_any(pieces(found, file), where):
            piece.check_length()
            motions.append(
                cleaned(
                    piece.found, file, channel_map,
                    inputs=inputs, rate=rate, gaps=gaps, labels=piece.labels,
                )
            )  # fmt: skip
        return motions


def assumptions(recording: Recording) -> list[str]:
    """What was assumed when a recording was read, as sentences that its user must see.

    Units that nobody stated above all; only how an ordinary text table was recognised is left out.
    """
    said = recording.provenance.get("assumed", [])
    return [f"{text[0].upper()}{text[1:]}." for text in said if not text.startswith(ROUTINE)]


def hertz(rate: float | str | None) -> float | None:
    """A rate as a number of Hz.

    Raises
    ------
    InputError
        If it is none.
    """
    if isinstance(rate, str):
        try:
            rate = parse_quantity(rate, "Hz", "resample_to")
        except ParameterError as error:
            raise InputError(str(error)) from None
    check_rate(rate)
    return rate


def _has(file: RecordedFile, needs: Needs) -> bool:
    return all(
        any(all(name in file.names for name in alternative) for alternative in group)
        for group in needs
    )


def _as_written(
    file: RecordedFile,
    channels: Sequence[Channel],
    rate: float | None,
    progress: Progress | None,
) -> Recording:
    """What ematwin wrote, bit for bit; only the rate is changed, if that is asked for."""
    units: dict[str, str] = dict(file.metadata.get("units", {}))
    if "time" not in file.names:
        raise RecordError(
            f"{file.path} has no channel for time; it has {', '.join(file.names)}. "
            "Rename or add the column."
        )
    known = {channel.name: channel for channel in with_time(channels)}
    # another kind may mean something else by a name
    checked = file.names if set(file.names) <= set(known) else ("time",)
    for name in checked:
        unit, si_unit = units.get(name, known[name].unit), known[name].unit
        if unit != si_unit:
            raise RecordError(
                f"{file.path} gives {name} in {unit}; a recording holds it in {si_unit}. "
                "Convert it."
            )
    values = file.read(file.names, progress)
    time = values.pop("time")
    provenance = dict(file.metadata.get("provenance") or {"source": "file", "file": file.path.name})
    if rate is not None:
        means = file.metadata.get("means", [one.name for one in channels if one.is_mean])
        time, values, changed = to_constant_rate(time, values, rate, file.path, means)
        provenance["changed"] = [*provenance.get("changed", []), *changed]
    start = file.metadata.get("start")
    return Recording(
        time,
        values,
        units=units,
        labels=file.metadata.get("labels"),
        start=None if start is None else datetime.fromisoformat(start),
        source=file.path.name,
        provenance=provenance,
    )


def _check_format(file: RecordedFile) -> None:
    found = file.metadata.get("format", FORMAT)
    if found > FORMAT:
        raise RecordError(
            f"{file.path} was written by a newer ematwin (format {found}, this one knows "
            f"{FORMAT}). Update ematwin."
        )
