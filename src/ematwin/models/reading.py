"""`read` and `write`: recordings of any kind of actuator, in files of any known format."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, Protocol, TypedDict, Unpack, overload

from ematwin.errors import EmatwinError, FileError, InputError, ParameterError, RecordError
from ematwin.models.base import Model
from ematwin.models.parameter_set import DEFAULT_KIND, ParameterSet
from ematwin.models.registry import load_actuator, model_in, model_of, models
from ematwin.recordings.channel import Channel, ChannelMap, Columns
from ematwin.recordings.cleaning import Policy
from ematwin.recordings.collect import MissingChannelError, is_met, match
from ematwin.recordings.formats.base import Progress, open_file
from ematwin.recordings.read import Choice, read_file
from ematwin.recordings.recording import Recording
from ematwin.recordings.tables import write_recording, write_recordings
from ematwin.showing.results import is_frame

_LISTED = 5  # files that one message lists

Paths = list[str] | list[Path] | list[str | Path] | tuple[str | Path, ...]


class Frame(Protocol):
    """A table of pandas, which is optional; distinct from a list of paths."""

    columns: Any
    index: Any
    to_numpy: Any


class Options(TypedDict, total=False):
    """Options of `read` that do not change the type of its result."""

    actuator: Any
    resample_to: float | str | None
    gaps: Policy
    where: Choice | Sequence[Choice] | None
    progress: Progress | None


@overload
def read(
    path: str | Path | Frame, columns: Columns = ..., *,
    split: Literal[False] = ..., **options: Unpack[Options],
) -> Recording: ...  # fmt: skip


@overload
def read(
    path: Paths, columns: Columns = ..., *,
    split: bool = ..., **options: Unpack[Options],
) -> list[Recording]: ...  # fmt: skip


@overload
def read(
    path: str | Path | Frame | Paths, columns: Columns = ..., *,
    split: Literal[True], **options: Unpack[Options],
) -> list[Recording]: ...  # fmt: skip


def read(
    path: str | Path | Frame | Paths,
    columns: Columns = None,
    *,
    actuator: Any = None,
    resample_to: float | str | None = None,
    gaps: Policy = "refuse",
    split: bool = False,
    where: Choice | Sequence[Choice] | None = None,
    progress: Progress | None = None,
) -> Recording | list[Recording]:
    """Read recordings from files of ematwin or of a test bench.

    Parameters
    ----------
    path : a file of a known format (docs/formats.md), or a DataFrame of pandas;
        or several of them
    columns : which channel of the file is which: a mapping such as
        ``{"current_a": "Phase A [A]"}``, a TOML file, or a `ChannelMap`. All others are found by
        name or alias (``i_a``, ``t``), with or without a unit (``command_deg``, ``i_a [mA]``)
    actuator : kind of the recordings: an actuator, the name of a shipped one, a TOML
        file, or a kind. None takes the brushless one; a file that `write` made says itself which
        channels it has
    resample_to : float (Hz) or text such as ``"20 kHz"``; None keeps the recorded rate
    gaps : "refuse"; "longest" takes the longest stretch without holes; "mask" fills holes and
        lists them in ``provenance["masked_s"]``
    split : whether a table is cut into motions, where time falls back or a label changes: a
        column that stays as it is within a motion, such as run or condition
    where : labels with the values that are wanted, e.g. ``{"condition": ["normal"]}``, or several
        such choices, one of them has to fit
    progress : called with the share read, in [0, 1], now and then

    Returns
    -------
    Recording, or a list of them if ``split`` is true or several files are given
        A file that `write` made, read without a map, comes back bit for bit. Of others, the
        provenance holds the channel of each column (``columns``), assumptions (``assumed``, see
        `assumptions`) and changes (``changed``), with sentences to show (``warnings``).

    Raises
    ------
    InputError
        If the map or an option cannot be used, or a label that ``where`` names is not in the file.
    FileError
        If a file cannot be read.
    RecordError
        If a channel is missing or cannot be recorded so, if nothing fits ``where``, or if
        the file holds several motions and ``split`` is false.
    MissingExtraError
        If the library for a format is not installed.
    """
    single = isinstance(path, str | Path) or is_frame(path)
    if isinstance(path, Mapping) or not (single or isinstance(path, Iterable)):
        said = "Give the path of a file, a DataFrame, or a list of them"
        raise InputError(f"{said}; received {type(path).__name__}.")
    files: list[Any] = [path] if single else list(path)  # type: ignore[arg-type]
    model = _model(actuator)
    channel_map = ChannelMap.of(columns, model.channels) if columns is not None else None
    found: list[Recording] = []
    failed: list[tuple[Any, EmatwinError]] = []
    for n, file in enumerate(files):
        try:
            found += read_file(
                file, model.channels, channel_map, needs=model.required, inputs=model.inputs,
                own=actuator is None, resample_to=resample_to, gaps=gaps, split=split, where=where,
                progress=_share(progress, n, len(files)),
            )  # fmt: skip
        except (RecordError, FileError) as error:
            # the first one is told whole
            lacks = isinstance(error, MissingChannelError) and columns is None and not failed
            if kinds := _kinds_of(file, None) if lacks else []:
                error = RecordError(
                    f"{error} It has the channels of the kind {kinds[0]}: give an actuator of that "
                    "kind."
                )
            failed.append((file, error))
    if failed:
        raise _first_of(failed, len(files)) from None
    if split or not single:
        return found
    if len(found) > 1:
        what = path if isinstance(path, str | Path) else "The DataFrame"
        raise RecordError(
            f"{what} holds {len(found)} motions that fit the choice. Narrow it to one, or read "
            "them with split=True, which gives a recording for each."
        )
    return found[0]


def _first_of(failed: Sequence[tuple[Any, EmatwinError]], count: int) -> EmatwinError:
    """The first error of files, which names the others that cannot be read either."""
    (_, first), *others = failed
    if not others:
        return first
    names = ["a DataFrame" if is_frame(file) else Path(file).name for file, _ in others]
    listed = ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
    kind = FileError if isinstance(first, FileError) else RecordError
    return kind(f"{first} Of {count} files {len(names)} more cannot be read: {listed}.")


def write(recording: Recording | Sequence[Recording], path: str | Path) -> None:
    """Write one recording, or several as a table of motions, to a Parquet or CSV file.

    One is read back bit for bit, with labels, start and provenance. A table of several holds a
    column for each label and for each channel, with its unit in the name, and no provenance; it is
    read with ``split=True``.

    Raises `InputError` if the name has another ending, or there is nothing to write; `RecordError`
    if several recordings have different channels; `FileError` if the file cannot be written;
    nothing is left half-written.
    """
    if isinstance(recording, Recording):
        write_recording(recording, path, _channels_of(recording))
    else:
        first = recording[:1]
        write_recordings(recording, path, _channels_of(first[0]) if first else ())


def _model(actuator: Any) -> Model:
    if actuator is None:
        return model_of(DEFAULT_KIND)
    if not isinstance(actuator, str | Path):
        return model_of(getattr(actuator, "actuator", actuator))  # a calibration holds one
    kinds = {
        name for model in models().values() for name in (model.kind, *model.parameters.former_kinds)
    }
    return model_of(str(actuator)) if str(actuator) in kinds else model_in(actuator)


def actuator_for(recording: Any, columns: Columns = None) -> ParameterSet:
    """The actuator that is meant where none is named: the default one of the recording's kind.

    Parameters
    ----------
    recording : a `Recording`, the path of a file, or a DataFrame
    columns : as of `read`

    Returns
    -------
    ParameterSet : of a simulation the shipped one that was simulated; of other recordings the
        default of the only kind that has such channels; if there is none the default brushless one

    Raises
    ------
    InputError
        If several kinds have such channels.
    """
    if isinstance(recording, Recording):
        told = recording.provenance
    else:
        with open_file(recording) as file:
            told = file.metadata.get("provenance") or {}
    if told.get("source") == "simulated":
        with suppress(ParameterError):
            return load_actuator(str(told.get("actuator")))
    kinds = _kinds_of(recording, columns)
    if len(kinds) > 1:
        raise InputError(
            f"{getattr(recording, 'name', recording)} has channels of the kinds "
            f"{' and '.join(kinds)}. Name the actuator: "
            f'actuator="{models()[kinds[0]].parameters.default}", or your own file.'
        )
    return load_actuator(models()[kinds[0]].parameters.default if kinds else None)


def _kinds_of(recording: Any, columns: Columns) -> list[str]:
    """The kinds for which a recording or a file has all channels that are needed."""
    if isinstance(recording, Recording):
        return [
            kind
            for kind, model in models().items()
            if all(is_met(group, recording.channels) for group in model.required)
        ]
    kinds = []
    with open_file(recording) as file:
        for kind, model in models().items():
            with suppress(RecordError, InputError):
                match(file, ChannelMap.of(columns or {}, model.channels), model.required)
                kinds.append(kind)
    return kinds


def _channels_of(recording: Recording) -> Sequence[Channel]:
    """Channels of the kind that knows most channels of a recording."""

    def known(model: Model) -> int:
        return sum(channel.name in recording.channels for channel in model.channels)

    best = max(models().values(), key=known)
    return best.channels if known(best) else ()


def _share(progress: Progress | None, done: int, count: int) -> Progress | None:
    """The progress of one file as a share of all."""
    return None if progress is None else lambda share: progress((done + share) / count)
