"""Parameter sets: validated, in SI, each value from a file that gives its unit and source.

A file holds a table for each section and, for each parameter, ``{ value, unit, source }``. Each
kind of actuator is one subclass of `ParameterSet`; its shipped sets lie beside it.
"""

import hashlib
import json
import math
import sys
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError
from pydantic.fields import FieldInfo

from ematwin.errors import InputError, ParameterError
from ematwin.files import written_whole
from ematwin.quantities import to_si
from ematwin.validation import load_toml, one_sentence

UNNAMED_KIND = "bldc"  # the kind of a file that names none


def quantity(unit: str, meaning: str, **limits: Any) -> Any:
    """A field of a section: a finite number with an SI unit."""
    return Field(
        description=meaning,
        json_schema_extra={"unit": unit},
        allow_inf_nan=False,
        **limits,
    )


def unit_of(field: FieldInfo) -> str:
    """SI unit of a parameter; the empty string for a ratio."""
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    return str(extra["unit"])


def parameter_file(name_or_path: str | Path, shipped: Mapping[str, Path]) -> Path:
    """A TOML file itself, or that of a shipped set."""
    path = Path(name_or_path)
    if path.suffix == ".toml":
        return path
    if str(name_or_path) not in shipped:
        raise ParameterError(
            f"There is no actuator {str(name_or_path)!r}. Shipped: {', '.join(shipped)}; "
            "or give the path of a TOML file (ending in .toml)."
        )
    return shipped[str(name_or_path)]


def not_searchable(place: str) -> InputError:
    """The error that a parameter is fixed."""
    return InputError(
        f"{place} cannot be searched: it is chosen, not measured. Correct it in the parameter file."
    )


class Section(BaseModel):
    """A table of the parameter file."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class ParameterSet(BaseModel):
    """One actuator of some kind, all values in SI.

    Load one with ``load("name")`` or ``load("mine.toml")``; make a variant with
    ``changed({"section.name": 2.3})``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: ClassVar[str]  # as ``kind = "..."`` in the file
    former_kinds: ClassVar[tuple[str, ...]] = ()  # what older files call it
    default: ClassVar[str]  # the shipped set that is meant where none is named
    # tables of its files that are no parameters: what calibration adds
    beside: ClassVar[frozenset[str]] = frozenset({"calibration", "signature"})

    name: str
    description: str
    _sources: dict[str, str] = PrivateAttr(default_factory=dict)

    @classmethod
    def load(cls, name_or_path: "str | Path | ParameterSet | None" = None) -> Self:
        """A shipped set by name, or a TOML file; the default of this kind if not given.

        Raises
        ------
        ParameterError
            If there is no such set, or a value is missing, impossible or of the wrong unit.
        FileError
            If the file cannot be read.
        """
        if name_or_path is None:
            name_or_path = cls.default
        if isinstance(name_or_path, cls):
            return name_or_path
        if isinstance(name_or_path, ParameterSet):
            raise cls._wrong_kind(name_or_path.name, name_or_path.kind)
        path = parameter_file(name_or_path, cls.shipped())
        return cls.from_dict(load_toml(path, "actuator"), str(name_or_path))

    @classmethod
    def from_dict(cls, table: dict[str, Any], what: str = "actuator") -> Self:
        """An actuator from the content of a parameter file: values, units and sources."""
        kind = table.get("kind", UNNAMED_KIND)
        if kind != cls.kind and kind not in cls.former_kinds:
            raise cls._wrong_kind(what, kind)
        table = {k: entry for k, entry in table.items() if k != "kind" and k not in cls.beside}
        plain: dict[str, Any] = {}
        sources: dict[str, str] = {}
        for key, entry in table.items():
            field = cls.model_fields.get(key)
            if field is None or not isinstance(entry, dict):
                plain[key] = entry
                continue
            section: Any = field.annotation
            plain[key] = {}
            for name, leaf in entry.items():
                place = f"{key}.{name}"
                if name not in section.model_fields:
                    plain[key][name] = leaf
                    continue
                if not (isinstance(leaf, dict) and {"value", "unit", "source"} == set(leaf)):
                    raise ParameterError(
                        f"{what}: {place} must be {{ value = ..., unit = ..., source = ... }}, "
                        f"received {leaf!r}; complete it."
                    )
                if isinstance(leaf["value"], bool) or not isinstance(leaf["value"], int | float):
                    raise ParameterError(
                        f"{what}: {place} must be a number, received {leaf['value']!r}; correct it."
                    )
                if not (isinstance(leaf["source"], str) and leaf["source"].strip()):
                    raise ParameterError(
                        f"{what}: {place} must name the source of its value, received "
                        f"{leaf['source']!r}; say where it comes from."
                    )
                unit = unit_of(section.model_fields[name])
                si = to_si(leaf["value"], leaf["unit"], unit, f"{what}: {place}")
                plain[key][name] = si
                sources[place] = leaf["source"]
        try:
            actuator = cls.model_validate(plain)
        except ValidationError as error:
            raise one_sentence(error, what) from None
        actuator._sources.update(sources)
        return actuator

    @classmethod
    def _wrong_kind(cls, what: str, kind: object) -> ParameterError:
        return ParameterError(
            f"{what} describes an actuator of the kind {kind!r} where one of the kind "
            f"{cls.kind!r} is needed; give another file."
        )

    @classmethod
    def shipped(cls) -> dict[str, Path]:
        """Names and files of the sets of this kind that come with ematwin."""
        folder = Path(str(sys.modules[cls.__module__].__file__)).parent
        return {path.stem: path for path in sorted(folder.glob("*.toml"))}

    def changed(self, values: dict[str, float]) -> Self:
        """A variant with some values replaced, e.g. ``{"motor.resistance": 2.3}``, in SI."""
        table = self.model_dump()
        for place, value in values.items():
            section, _, name = place.partition(".")
            if section not in table or name not in table[section]:
                raise ParameterError(
                    f"{place!r} is not a parameter of an actuator; use section.name such as "
                    "'motor.resistance'."
                )
            table[section][name] = value
        try:
            variant = type(self).model_validate(table)
        except ValidationError as error:
            raise one_sentence(error, self.name) from None
        variant._sources.update(self._sources)
        return variant

    def parameters(self) -> Iterator[tuple[str, float, str, str, str]]:
        """Yield place, value, SI unit, meaning and source of each parameter."""
        for key, section in self:
            if isinstance(section, Section):
                for name, field in type(section).model_fields.items():
                    place = f"{key}.{name}"
                    yield (
                        place,
                        getattr(section, name),
                        unit_of(field),
                        str(field.description),
                        self._sources.get(place, "set by the user"),
                    )

    def with_arrays(self, values: Mapping[str, Any]) -> Self:
        """A variant whose values at some places are arrays, for batches of candidates.

        Nothing is validated: the bounds of the unknowns see to that.
        """
        sections: dict[str, dict[str, Any]] = {}
        for place, value in values.items():
            section, _, name = place.partition(".")
            sections.setdefault(section, {})[name] = value
        variant = self.model_copy(
            update={
                key: getattr(self, key).model_copy(update=changed)
                for key, changed in sections.items()
            }
        )
        variant.__dict__.pop("fingerprint", None)  # of the values from before
        return variant

    def varied(self, candidates: Mapping[str, Any], fixed: Collection[str] = ()) -> Self:
        """The variant that candidates ask for by place, (B,) values each; itself if they name none.

        ``fixed`` are places that cannot differ between candidates; what else candidates hold is
        left alone.

        Raises
        ------
        InputError
            If a fixed parameter is named.
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
        """What a parameter may be at least and at most, SI; infinite where nothing is said."""
        section, _, name = place.partition(".")
        low, high = -math.inf, math.inf
        for rule in type(getattr(self, section)).model_fields[name].metadata:
            low = max(low, getattr(rule, "ge", low), getattr(rule, "gt", low))
            high = min(high, getattr(rule, "le", high), getattr(rule, "lt", high))
        return float(low), float(high)

    def as_table(self, sources: Mapping[str, str] | None = None) -> dict[str, Any]:
        """What a parameter file of it holds: kind, name, values with units and sources."""
        given = sources or {}
        table: dict[str, Any] = {
            "kind": self.kind, "name": self.name, "description": self.description,
        }  # fmt: skip
        for place, value, unit, _, source in self.parameters():
            section, name = place.split(".")
            table.setdefault(section, {})[name] = {
                "value": value, "unit": unit, "source": given.get(place, source),
            }  # fmt: skip
        return table

    def save(self, path: str | Path, sources: Mapping[str, str] | None = None) -> None:
        """Write a parameter file, whole or not at all; ``sources`` replace those of some places."""
        import tomli_w

        with written_whole(path) as draft:
            draft.write_text(tomli_w.dumps(self.as_table(sources)), encoding="utf-8")

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all values: equal fingerprints simulate alike."""
        values = self.model_dump(exclude={"name", "description"})
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]
