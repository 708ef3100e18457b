"""Channel: a signal of the recordings of a kind of actuator; ChannelMap: which it is in a file."""

import difflib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import pydantic
from pydantic import BaseModel, ConfigDict, Field

from ematwin.errors import InputError, ParameterError
from ematwin.quantities import parse_quantity
from ematwin.validation import load_toml, one_sentence

NAMED: set[str] = set()  # every channel that some kind of actuator declares


@dataclass(frozen=True)
class Derivation:
    """How a channel follows from others, where a file has those and not the channel itself."""

    formula: str  # for the provenance, such as "set_point - position"
    sources: tuple[str, ...]  # names of the channels that it follows from
    compute: Callable[..., np.ndarray]  # from their values, (S,) in SI, to those of the channel


@dataclass(frozen=True)
class Channel:
    """One named signal.

    Parameters
    ----------
    name : as it is called in a `Recording`
    unit : SI unit
    meaning : for people
    aliases : other names under which files may have it, in lower case with underscores
    side : "motor" or "output", the shaft on which a recording holds it; None if it turns with none
    is_mean : a sample is the mean over the interval that ends at its time, as an integrating
        converter gives it; else the value at that time
    derived : how it follows from others; None if it has to be recorded
    may_rest : one value throughout is no sign of a dead sensor: a current that is held at zero
    refreshed : s, period at which the device samples; a host reads in between; 0 if each read is a
        sample
    stands_in_for : the channel that this one is only there to derive: files may have it instead,
        and recordings read from them hold the other
    """

    name: str
    unit: str
    meaning: str
    aliases: tuple[str, ...] = ()
    side: str | None = None
    is_mean: bool = False
    derived: Derivation | None = None
    stands_in_for: str | None = None
    may_rest: bool = False
    refreshed: float = 0.0

    def __post_init__(self) -> None:
        NAMED.add(self.name)

    def follows_from(self, present: Collection[str]) -> bool:
        """Whether it is none of the channels that are there, and follows from them."""
        sources = None if self.derived is None or self.name in present else self.derived.sources
        return sources is not None and all(source in present for source in sources)


TIME = Channel("time", "s", "time", aliases=("t",))


def with_time(channels: Sequence[Channel]) -> tuple[Channel, ...]:
    """The channels with time before them, if they have none."""
    if any(channel.name == TIME.name for channel in channels):
        return tuple(channels)
    return (TIME, *channels)


def plain(text: str) -> str:
    """A name as it is compared: lower case, underscores for spaces."""
    return text.strip().casefold().replace(" ", "_")


def channel_called(text: str, channels: Sequence[Channel]) -> Channel | None:
    """The channel that a name or alias means, or None."""
    key = plain(text)
    return next((one for one in channels if key in (one.name, *one.aliases)), None)


PHASES = ("current_a", "current_b", "current_c")
_OPTIONS = ("sample_rate", "phase_order", "gear_ratio", "without")


def _hertz(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        return parse_quantity(value, "Hz", "it")
    except ParameterError as error:
        raise ValueError(str(error)) from None


Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class MappedChannel(BaseModel):
    """One channel of a file: value in the unit = sign (scale x number in the file + offset)."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    channel: Annotated[str, Field(min_length=1)]  # name in the file
    unit: str | None = None  # None takes the unit in the file or the name, else SI
    sign: Literal[1, -1] = 1
    scale: Finite = 1.0  # such as A per V of a current probe
    offset: Finite = 0.0  # in the unit
    full_scale: Positive | None = None  # in the unit, where the converter saturates on both sides
    side: Literal["motor", "output"] | None = None  # the shaft; None: the recording's own
    unwrap: bool = False  # an angle that starts anew at each full turn is counted on

    @pydantic.model_validator(mode="after")
    def _scale_keeps_something(self) -> Self:
        if self.scale == 0.0:
            raise ValueError("scale must not be 0, received 0; every sample would be the offset")
        return self


class CsvOptions(BaseModel):
    """How a text table is written, where it is not recognised."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    skip_rows: Annotated[int, Field(ge=0)] | None = None  # lines before the header


class ChannelMap(BaseModel):
    """Channels of a file by channel of the recording, and what holds for the whole file.

    Made for ``channels`` of a kind of actuator, to which time is added. Columns and options may
    stand beside each other, or in tables of their own. Raises `InputError` if one is unknown or
    impossible.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    columns: dict[str, MappedChannel] = {}  # by name or alias (``i_a``, ``t``)
    # Hz, or text such as ``"20 kHz"``, in place of a time channel
    sample_rate: Annotated[Positive, pydantic.BeforeValidator(_hertz)] | None = None
    phase_order: str = "abc"  # the phases that the channels given for a, b, c really carry
    gear_ratio: Positive | None = None  # motor turns for one turn of the output
    without: tuple[str, ...] = ()  # left out although the file has them under their own names
    csv: CsvOptions = CsvOptions()
    _channels: tuple[Channel, ...] = pydantic.PrivateAttr(default=())

    def __init__(self, channels: Sequence[Channel], table: Mapping[Any, Any]) -> None:
        known = with_time(channels)
        values: dict[str, Any] = {"columns": {}, "csv": {}}
        for key, value in table.items():
            if key in _OPTIONS:
                values[key] = value
            elif key not in values:
                values["csv" if key in CsvOptions.model_fields else "columns"][key] = value
            elif isinstance(value, Mapping):
                values[key].update(value)
            else:
                advice = f"write [{key}] above it"
                raise InputError(f"{key} must be a table, received {value!r}; {advice}.")
        given, values["columns"] = values["columns"], {}
        for key, value in given.items():
            name = _column_name(str(key), known)
            if name in values["columns"]:
                raise InputError(f"The column map gives {name} twice; keep one of them.")
            values["columns"][name] = {"channel": value} if isinstance(value, str) else value
        left_out = values.get("without")
        if isinstance(left_out, str):
            left_out = left_out.split(",")
        if isinstance(left_out, Sequence):
            values["without"] = tuple(_column_name(str(name), known) for name in left_out)
        try:
            super().__init__(**values)
        except pydantic.ValidationError as error:
            raise one_sentence(error, "The column map") from None
        self._channels = known
        if problem := self._problem():
            raise ParameterError(f"The column map: {problem}.")

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that it is for, time first."""
        return self._channels

    def channel(self, name: str) -> Channel:
        """One of them by name."""
        return next(channel for channel in self._channels if channel.name == name)

    def _problem(self) -> str | None:
        """A sentence on entries that do not fit together, or None."""
        if sorted(self.phase_order) != list("abc"):
            said = f"phase_order must name a, b and c once each, received {self.phase_order!r}"
            return f"{said}; write for example acb"
        both = sorted({*self.without} & self.columns.keys())
        if both:
            return f"{', '.join(both)} is mapped and left out; do one of the two"
        names = {channel.name for channel in self._channels}
        if self.phase_order != "abc" and not names.issuperset(PHASES):
            return "phase_order is for actuators with three phases; remove it"
        if self.sample_rate is not None and "time" in self.columns:
            return "time comes from a channel or from sample_rate; give one of the two"
        for name, entry in self.columns.items():
            channel = self.channel(name)
            if entry.unwrap and channel.unit != "rad":
                return f"{name} is not an angle; remove its unwrap"
            if entry.side is None:
                continue
            if channel.side is None:
                return f"{name} belongs to no shaft; remove its side"
            if entry.side != channel.side and self.gear_ratio is None:
                said = f"{name} is given on the {entry.side} side, but a recording holds it on the"
                return f"{said} {channel.side} side; give gear_ratio"
        return None

    @classmethod
    def of(cls, given: "Columns", channels: Sequence[Channel]) -> "ChannelMap":
        """A map from a map, a mapping, a TOML file, or None: names as in a recording.

        A mapping is for example ``{"i_a": "Phase A [A]", "sample_rate": "20 kHz"}``.
        """
        if isinstance(given, ChannelMap):
            given = given.as_table()
        if given is None or isinstance(given, Mapping):
            return cls(channels, given or {})
        if isinstance(given, str | Path):
            table = load_toml(Path(given), "column map")
            try:
                return cls(channels, table)
            except InputError as error:
                raise InputError(f"{Path(given)}: {error}") from None
        said = "columns must be a mapping of columns to channel names, or the path of a TOML file"
        raise InputError(f"{said}; received {type(given).__name__}.")

    @classmethod
    def parse(
        cls, columns: Sequence[str], channels: Sequence[Channel], base: "ChannelMap | None" = None
    ) -> "ChannelMap":
        """A map from texts such as ``'i_a=Phase A [A]'``, put over another map.

        ``sample_rate=20 kHz``, ``phase_order=acb`` and the other options are written alike.
        """
        table: dict[str, Any] = {} if base is None else base.as_table()
        for text in columns:
            key, _, value = (part.strip() for part in text.partition("="))
            value = value.strip("\"'")
            if not key or not value:
                example = 'name="channel", such as i_a="Phase A [A]"'
                raise InputError(f"A column is written {example}; received {text!r}.")
            is_option = key in _OPTIONS or key in CsvOptions.model_fields
            table[key if is_option else _column_name(key, with_time(channels))] = value
        return cls(channels, table)

    def as_table(self) -> dict[str, Any]:
        """The map as plain values, as they would stand in a TOML file."""
        return self.model_dump(exclude_none=True, exclude_defaults=True)


Columns = ChannelMap | Mapping[str, Any] | str | Path | None


def _column_name(text: str, channels: Sequence[Channel]) -> str:
    """The name of the channel that a name or alias means, or `InputError` with the closest."""
    channel = channel_called(text, channels)
    if channel is None:
        names = [one.name for one in channels]
        known = [*names, *(alias for one in channels for alias in one.aliases)]
        near = difflib.get_close_matches(plain(text), known, n=3, cutoff=0.6)
        hint = f" The closest are {', '.join(near)}." if near else ""
        said = f"A recording has no column {text!r}; there are {', '.join(names)}.{hint}"
        raise InputError(f"{said} Correct the name.")
    return channel.name
