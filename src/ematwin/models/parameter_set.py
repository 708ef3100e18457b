"""Parameter sets: validated, in SI, each value from a file that gives its unit and source.

Each kind of actuator is one subclass of `ParameterSet`; its shipped sets lie beside it.
`ematwin.models.parameter_file` has the form of the files.
"""

import hashlib
import json
import math
import re
from collections.abc import Collection, Iterator, Mapping
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Self, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
)
from pydantic.fields import FieldInfo

from ematwin.errors import InputError, ParameterError
from ematwin.files import write_text
from ematwin.models.parameter_file import (
    parameter_table,
    read_table,
    stated,
    template_of,
    tolerance_of,
    unit_of,
)
from ematwin.quantities import as_percent, parse_share
from ematwin.showing.results import frame, html
from ematwin.validation import all_at_once, findings, one_sentence

DEFAULT_KIND = "bldc"  # where none is named, as in older files


def quantity(
    unit: str,
    meaning: str,
    *,
    tolerance: float | None = None,
    drift: float | None = None,
    exact: bool = False,
    **limits: Any,
) -> Any:
    """A field of a section: a finite number with an SI unit.

    Parameters
    ----------
    unit : SI
    meaning : for people
    tolerance : how far a value taken from a data sheet may be off on one unit of the kind, as a
        share above 0 and at most 2: 95 % of such actuators lie between the value divided by and
        multiplied with 1 + tolerance. None is taken as exact unless a file says otherwise.
    drift : likewise, how far it may change later between recordings of one actuator (temperature,
        supply); None does not change
    exact : chosen or counted, never measured: no file may give it a tolerance
    limits : ``gt``, ``ge``, ``lt``, ``le``
    """
    for name, share in (("tolerance", tolerance), ("drift", drift)):
        if share is not None:
            parse_share(share, f"{name} of the quantity {meaning!r}")
    if exact and not tolerance is drift is None:
        raise ParameterError(
            f"The quantity {meaning!r} is exact, received tolerance={tolerance!r} and "
            f"drift={drift!r}; leave these out, or exact."
        )
    return Field(
        description=meaning,
        json_schema_extra={"unit": unit, "tolerance": tolerance, "drift": drift, "exact": exact},
        allow_inf_nan=False,
        **limits,
    )


def folder_of(module: str) -> Path:
    """The folder of a module; the current one where it comes from no file, as in a notebook."""
    file = getattr(import_module(module), "__file__", None)
    return Path.cwd() if file is None else Path(file).parent


def shipped_scenarios(module: str = "ematwin.models.bldc") -> dict[str, Path]:
    """Names and files of the scenarios in the folder ``scenarios`` beside a module."""
    folder = folder_of(module) / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def not_searchable(place: str) -> InputError:
    """The error that a parameter is fixed."""
    return InputError(
        f"{place} cannot be searched: it is chosen, not measured. Correct it in the parameter file."
    )


class Section(BaseModel):
    """A table of the parameter file.

    An optional one is declared as ``Kind | None = None``; left out, it has no parameters and is no
    part of the fingerprint.

    Attributes
    ----------
    example : values by name, SI, that templates show of a section that is left out
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    example: ClassVar[Mapping[str, float]] = {}


class ParameterSet(BaseModel):
    """One actuator of some kind, all values in SI.

    Load one with ``load("name")`` or ``load("mine.toml")``; make a variant with
    ``changed({"section.name": 2.3})``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    kind: ClassVar[str]  # as ``kind = "..."`` in the file
    former_kinds: ClassVar[tuple[str, ...]] = ()  # what older files call it
    default: ClassVar[str]  # the shipped set that is meant where none is named
    own_model: ClassVar[Any] = None  # the `Model`, where a file states it (`Model.of_file`)
    # tables of its files that are no parameters: what calibration adds
    beside: ClassVar[frozenset[str]] = frozenset({"baseline", "calibration", "signature"})

    name: str
    description: str
    _sources: dict[str, str] = PrivateAttr(default_factory=dict)
    # those that the file states; the kind's stand in its class
    _tolerances: dict[str, float] = PrivateAttr(default_factory=dict)

    @model_serializer(mode="wrap")
    def _without_what_is_left_out(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        dumped: dict[str, Any] = handler(self)
        return {key: value for key, value in dumped.items() if value is not None}

    @classmethod
    def load(cls, name_or_path: "str | Path | ParameterSet | None" = None) -> Self:
        """A shipped set by name, or a TOML file; the default of this kind if not given.

        Raises `ParameterError` if there is no such set, or a value is missing, impossible or of the
        wrong unit; the message lists all that is to be corrected; `FileError` if the file cannot be
        read.
        """
        if name_or_path is None:
            name_or_path = cls.default
        if isinstance(name_or_path, cls):
            return name_or_path
        if isinstance(name_or_path, ParameterSet):
            raise cls._wrong_kind(name_or_path.kind, name_or_path.name)
        return cls.from_dict(parameter_table(name_or_path, cls.shipped()), str(name_or_path))

    @classmethod
    def from_dict(cls, table: dict[str, Any], what: str = "actuator") -> Self:
        """An actuator from the content of a parameter file: values, units and sources."""
        kind = table.get("kind", DEFAULT_KIND)
        if kind not in (cls.kind, *cls.former_kinds):
            raise cls._wrong_kind(kind, what)
        own = {key: entry for key, entry in table.items() if key not in cls.beside}
        read = read_table(cls, own, what)
        problems = read.problems
        try:
            actuator = cls.model_validate(read.values)
        except ValidationError as error:
            problems += [one for one in findings(error, what) if one[0] not in read.unread]
        if problems:
            raise all_at_once(cls._in_order(problems), what)
        actuator._sources, actuator._tolerances = read.sources, read.tolerances
        return actuator

    @classmethod
    def _wrong_kind(cls, kind: object, what: str) -> ParameterError:
        return ParameterError(
            f"{what} describes an actuator of the kind {kind!r} where one of the kind "
            f"{cls.kind!r} is needed; give another file."
        )

    @classmethod
    @cache
    def section(cls, key: str) -> type[Section] | None:
        """The class of a section; None if there is none of that name."""
        field = cls.model_fields.get(key)
        kind = None if field is None else field.annotation
        for one in get_args(kind) or (kind,):  # one that may be left out is a union with None
            if isinstance(one, type) and issubclass(one, Section):
                return one
        return None

    @classmethod
    def _in_order(cls, problems: list[tuple[str, str]]) -> list[str]:
        """Sentences in the order of a file: unknown names, parameters, the actuator as a whole."""
        rank = {"": math.inf}
        for key in cls.model_fields:
            section = cls.section(key)
            names = [] if section is None else section.model_fields
            for place in (key, *(f"{key}.{name}" for name in names)):
                rank[place] = len(rank)
        return [text for _, text in sorted(problems, key=lambda one: rank.get(one[0], 0))]

    @classmethod
    def shipped(cls) -> dict[str, Path]:
        """Names and files of the sets of this kind that come with ematwin."""
        files = sorted(folder_of(cls.__module__).glob("*.toml"))
        if "." not in cls.__module__:  # a module in no package may lie beside anything
            own = re.compile(rf"""^kind\s*=\s*["']{re.escape(cls.kind)}["']""", re.MULTILINE)
            files = [
                f for f in files if own.search(f.read_text(encoding="utf-8", errors="replace"))
            ]
        return {path.stem: path for path in files}

    def changed(self, values: dict[str, float]) -> Self:
        """A variant with some values replaced, e.g. ``{"motor.resistance": 2.3}``, in SI.

        A section that was left out is there if all its values are given.
        """
        table: dict[str, Any] = {key: getattr(self, key) for key in type(self).model_fields}
        for place, value in values.items():
            self._field(place)
            key, _, name = place.partition(".")
            if not isinstance(table[key], dict):
                table[key] = dict(table[key] or {})  # sections that stay are validated already
            table[key][name] = value
        try:
            variant = type(self).model_validate(table)
        except ValidationError as error:
            raise one_sentence(error, self.name) from None
        variant._sources.update(self._sources)
        variant._tolerances.update(self._tolerances)
        return variant

    @classmethod
    @cache
    def _field(cls, place: str) -> FieldInfo:
        """The declaration of a parameter."""
        key, _, name = place.partition(".")
        section = cls.section(key)
        if section is None or name not in section.model_fields:
            raise ParameterError(
                f"{place!r} is not a parameter of an actuator; use section.name such as "
                "'motor.resistance'."
            )
        return section.model_fields[name]

    def tolerance(self, place: str) -> float | None:
        """How far a value may be off, relative: as its file says, else as usual for the kind.

        95 % of such actuators lie between the value divided by and multiplied with 1 + tolerance.
        None where the value is taken as exact. See `quantity`.
        """
        usual = stated(self._field(place)).get("tolerance")
        return self._tolerances.get(place, usual)

    def drift(self, place: str) -> float | None:
        """How far a value may change between recordings of one actuator; None if it does not."""
        return stated(self._field(place)).get("drift")

    def with_tolerances(self, tolerances: Mapping[str, float | str]) -> Self:
        """A variant with stated tolerances, e.g. ``{"motor.resistance": "5 %"}`` or 0.05.

        Raises `ParameterError` if a place is no parameter, or a tolerance not above 0 and at most
        200 %.
        """
        variant = self.model_copy()
        variant._tolerances = self._tolerances | {
            place: tolerance_of(given, self._field(place), place)
            for place, given in tolerances.items()
        }
        return variant

    def parameters(self) -> Iterator[tuple[str, float, str, str, str]]:
        """Yield place, value, SI unit, meaning and source of each parameter."""
        for key, section in self:
            fields = type(section).model_fields if isinstance(section, Section) else {}
            for name, field in fields.items():
                place, meaning = f"{key}.{name}", str(field.description)
                source = self._sources.get(place, "set by the user")
                yield place, getattr(section, name), unit_of(field), meaning, source

    def parameter(self, place: str) -> tuple[str, float, str, str, str] | None:
        """The same of one parameter; None if there is none at this place."""
        return next((row for row in self.parameters() if row[0] == place), None)

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each parameter, by its place; needs pandas."""
        names = ("place", "value", "unit", "meaning", "source")
        return frame((dict(zip(names, row, strict=True)) for row in self.parameters()), "place")

    to_dataframe = to_frame

    def _repr_html_(self) -> str:
        """Name, kind and parameters, in a notebook."""
        rows = [(place, f"{value:.6g}", *said) for place, value, *said in self.parameters()]
        title = f"{self.name} ({self.kind}): {self.description}"
        header = ("parameter", "value", "unit", "meaning", "source")
        return html(title, header, rows)

    def with_arrays(self, values: Mapping[str, Any]) -> Self:
        """A variant whose values at some places are arrays, for batches of candidates.

        Nothing is validated: the bounds of the unknowns see to that.
        """
        sections: dict[str, dict[str, Any]] = {}
        for place, value in values.items():
            section, _, name = place.partition(".")
            sections.setdefault(section, {})[name] = value
        own = {key: getattr(self, key).model_copy(update=new) for key, new in sections.items()}
        variant = self.model_copy(update=own)
        variant.__dict__.pop("fingerprint", None)  # of the values from before
        return variant

    def varied(self, candidates: Mapping[str, Any], fixed: Collection[str] = ()) -> Self:
        """The variant that candidates ask for by place, (B,) values each; itself if they name none.

        `InputError` for places that are ``fixed``; what else candidates hold is left alone.
        """
        places = {name: values for name, values in candidates.items() if "." in name}
        for place in fixed:
            if place in places:
                raise not_searchable(place)
        return self.with_arrays(places) if places else self

    def value(self, place: str) -> float:
        """The value at a place such as ``motor.resistance``, SI."""
        section, _, name = place.partition(".")
        return float(getattr(getattr(self, section), name))

    def limits(self, place: str) -> tuple[float, float]:
        """Least and largest value of a parameter, SI; infinite where there is no limit."""
        low, high = -math.inf, math.inf
        for rule in self._field(place).metadata:
            low = max(low, getattr(rule, "ge", low), getattr(rule, "gt", low))
            high = min(high, getattr(rule, "le", high), getattr(rule, "lt", high))
        return float(low), float(high)

    def as_table(self, sources: Mapping[str, str] | None = None) -> dict[str, Any]:
        """Content of its parameter file: kind, name, values with units and sources.

        Tolerances of the kind are not repeated.
        """
        given = sources or {}
        table: dict[str, Any] = dict(kind=self.kind, name=self.name, description=self.description)
        for place, value, unit, _, source in self.parameters():
            section, name = place.split(".")
            entry = {"value": value, "unit": unit, "source": given.get(place, source)}
            if place in self._tolerances:
                entry["tolerance"] = as_percent(self._tolerances[place])
            table.setdefault(section, {})[name] = entry
        return table

    def save(self, path: str | Path, sources: Mapping[str, str] | None = None) -> None:
        """Write a parameter file, whole or not at all; ``sources`` replace those given."""
        import tomli_w

        write_text(path, tomli_w.dumps(self.as_table(sources)))

    def template(self, written: Mapping[str, Any] | None = None) -> str:
        """Text of a parameter file with comments, to be edited; it reads back as this actuator.

        Each parameter comes with its meaning and, where there are any, its tolerance and drift.
        Values are in SI, or as in ``written``, the content of the file that this was loaded from:
        people edit mH and rpm more easily.
        """
        return template_of(self, written or {})

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all values: equal fingerprints simulate alike."""
        values = self.model_dump(exclude={"name", "description"})
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]
