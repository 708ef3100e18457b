"""ColumnMap: which channel of a file is which column of a record, and what its numbers mean.

In a TOML file::

    sample_rate = "20 kHz"          # in place of a time channel
    phase_order = "acb"
    gear_ratio = 500

    [columns]
    command = { channel = "Setpoint", unit = "deg", side = "motor" }
    current_a = "Phase A [mA]"
    current_b = { channel = "Phase B", unit = "mA", sign = -1 }

    [csv]
    delimiter = ";"
    decimal = ","
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from ematwin.errors import InputError, ParameterError
from ematwin.quantities import parse_quantity
from ematwin.readers.recording import closest
from ematwin.signals.record import COLUMNS
from ematwin.validation import load_toml, one_sentence

ALIASES = {
    "t": "time", "cmd": "command", "setpoint": "command",
    "i_a": "current_a", "i_b": "current_b", "i_c": "current_c",
    "ia": "current_a", "ib": "current_b", "ic": "current_c", "i": "current", "i_eq": "current",
    "theta_m": "motor_position", "omega_m": "motor_speed",
    "theta_o": "output_position", "omega_o": "output_speed",
    "load_torque": "load", "t_load": "load",
}  # fmt: skip
_OPTIONS = ("sample_rate", "phase_order", "gear_ratio")
_CSV_OPTIONS = ("delimiter", "decimal", "skip_rows")
# On which shaft a record holds a column that turns with a shaft.
SIDES = {
    "command": "output", "output_position": "output", "output_speed": "output", "load": "output",
    "motor_position": "motor", "motor_speed": "motor",
}  # fmt: skip


def _hertz(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        return parse_quantity(value, "Hz", "it")
    except ParameterError as error:
        raise ValueError(str(error)) from None


Hertz = Annotated[float, BeforeValidator(_hertz), Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Channel(BaseModel):
    """One channel of a file: value in the unit = sign (scale x number in the file + offset).

    Parameters
    ----------
    channel : name in the file
    unit : of ``scale x number + offset``; None takes what the file or the name states, else SI
    sign : +1 or -1
    scale : factor on the number in the file, such as A per V of a current probe
    offset : in the unit, added after the scale
    full_scale : in the unit, where the converter saturates at plus and minus; None: unknown
    side : "motor" or "output", the shaft on which it was measured; None: the record's own
    unwrap : whether an angle starts anew at each full turn and is to be counted on
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    channel: Annotated[str, Field(min_length=1)]
    unit: str | None = None
    sign: Literal[1, -1] = 1
    scale: Finite = 1.0
    offset: Finite = 0.0
    full_scale: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    side: Literal["motor", "output"] | None = None
    unwrap: bool = False

    @model_validator(mode="after")
    def _scale_keeps_something(self) -> Self:
        if self.scale == 0.0:
            raise ValueError("scale must not be 0, received 0; every sample would be the offset")
        return self


class CsvOptions(BaseModel):
    """How a text table is written, where it is not recognised."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    skip_rows: Annotated[int, Field(ge=0)] | None = None  # lines before the header


class ColumnMap(BaseModel):
    """Channels by record column, and what holds for the whole file.

    Parameters
    ----------
    columns : mapping of record column or alias (``i_a``, ``t``) to `Channel`, name or table
    sample_rate : float (Hz) or text such as ``"20 kHz"``, in place of a time channel
    phase_order : the phases that the channels given for a, b, c really carry, such as ``"acb"``
    gear_ratio : motor turns for one turn of the output, needed for channels of the other side
    csv : `CsvOptions`
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    columns: dict[str, Channel] = {}
    sample_rate: Hertz | None = None
    phase_order: str = "abc"
    gear_ratio: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    csv: CsvOptions = CsvOptions()

    def __init__(self, **values: Any) -> None:
        if isinstance(values.get("columns"), Mapping):
            values["columns"] = _named(values["columns"])
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise one_sentence(error, "The column map") from None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if sorted(self.phase_order) != ["a", "b", "c"]:
            raise ValueError(
                "phase_order must name a, b and c once each, "
                f"received {self.phase_order!r}; write for example acb"
            )
        if self.sample_rate is not None and "time" in self.columns:
            raise ValueError("time comes from a channel or from sample_rate; give one of the two")
        for name, entry in self.columns.items():
            if entry.unwrap and COLUMNS[name][0] != "rad":
                raise ValueError(f"{name} is no angle; remove its unwrap")
            if entry.side is None:
                continue
            if name not in SIDES:
                raise ValueError(f"{name} belongs to no shaft; remove its side")
            if entry.side != SIDES[name] and self.gear_ratio is None:
                raise ValueError(
                    f"{name} is given on the {entry.side} side, but a record holds it on the "
                    f"{SIDES[name]} side; give gear_ratio"
                )
        return self

    @classmethod
    def of(cls, given: "ColumnMap | Mapping[str, Any] | str | Path | None") -> "ColumnMap":
        """A map from a map, a mapping, a TOML file, or None for names as in a record.

        A flat mapping may hold the options beside the columns:
        ``{"i_a": "Phase A [A]", "sample_rate": "20 kHz"}``.

        Raises
        ------
        InputError
            If a column or option is unknown or impossible.
        FileError
            If the file cannot be read.
        """
        if given is None:
            return cls()
        if isinstance(given, ColumnMap):
            return given
        if isinstance(given, str | Path):
            path = Path(given)
            table = load_toml(path, "column map")
            try:
                return cls._from_table(table)
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
        if isinstance(given, Mapping):
            return cls._from_table(given)
        raise InputError(
            "columns must be a mapping of record columns to channel names, or the path of a TOML "
            f"file; received {type(given).__name__}."
        )

    @classmethod
    def parse(cls, columns: Sequence[str], base: "ColumnMap | None" = None) -> "ColumnMap":
        """A map from texts such as ``'i_a=Phase A [A]'``, put over another map.

        ``sample_rate=20 kHz``, ``phase_order=acb`` and the other options are written alike.
        """
        table: dict[str, Any] = {} if base is None else base.as_table()
        for text in columns:
            name, mark, value = text.partition("=")
            if not mark or not name.strip() or not value.strip():
                raise InputError(
                    f'A column is written name="channel", such as i_a="Phase A [A]"; '
                    f"received {text!r}."
                )
            key, value = name.strip(), value.strip().strip("\"'")
            if key in _CSV_OPTIONS:
                table.setdefault("csv", {})[key] = int(value) if value.isdigit() else value
            elif key in _OPTIONS:
                table[key] = value
            else:
                table.setdefault("columns", {})[column_name(key)] = value
        return cls._from_table(table)

    def as_table(self) -> dict[str, Any]:
        """The map as plain values, as they would stand in a TOML file."""
        return self.model_dump(exclude_none=True, exclude_defaults=True)

    @classmethod
    def _from_table(cls, table: Mapping[str, Any]) -> "ColumnMap":
        sections = {"columns", "csv", *_OPTIONS}
        values: dict[str, Any] = {key: table[key] for key in table if key in sections}
        flat = {key: table[key] for key in table if key not in sections}
        csv = {key: flat.pop(key) for key in _CSV_OPTIONS if key in flat}
        if csv:
            values["csv"] = {**_table(values.get("csv", {}), "csv"), **csv}
        if flat:
            values["columns"] = {**_table(values.get("columns", {}), "columns"), **flat}
        return cls(**values)


def _table(value: Any, name: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{name} must be a table, received {value!r}; write [{name}] above it.")
    return dict(value)


def column_name(text: str) -> str:
    """The record column that a name or alias means.

    Raises
    ------
    InputError
        If there is none; the message names the closest.
    """
    name = record_column(text)
    if name is None:
        known = [*COLUMNS, *ALIASES]
        near = closest(known, text)
        hint = f"the closest are {', '.join(near)}" if near else f"there are {', '.join(COLUMNS)}"
        raise InputError(f"A record has no column {text!r}; {hint}. Correct the name.")
    return name


def record_column(text: str) -> str | None:
    """The record column that a name or alias means, or None."""
    key = text.strip().casefold().replace(" ", "_")
    key = ALIASES.get(key, key)
    return key if key in COLUMNS else None


def _named(columns: Mapping[str, Any]) -> dict[str, Any]:
    named: dict[str, Any] = {}
    for key, value in columns.items():
        name = column_name(str(key))
        if name in named:
            raise InputError(f"The column map gives {name} twice; keep one of them.")
        named[name] = {"channel": value} if isinstance(value, str) else value
    return named
