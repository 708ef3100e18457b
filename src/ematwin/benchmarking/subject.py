"""Subject: the actuator of a study and its searched unknowns.

Runs carry their actuator as plain values, so that neither a worker nor a report needs its file. Its
faults and nuisances are searched; vectors hold their values in the order of its unknowns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import ValidationError

from ematwin.errors import InputError, ParameterError
from ematwin.estimation.free_unknowns import unknowns_of
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import DEFAULT_KIND, load_actuator, model_of
from ematwin.models.unknown import HasUnknowns, Unknown
from ematwin.validation import one_sentence


@dataclass(frozen=True)
class Subject(HasUnknowns):
    """An actuator and its searched unknowns."""

    model: Model
    actuator: ParameterSet
    unknowns: tuple[Unknown, ...]  # (d,), faults and nuisances

    @classmethod
    def of(cls, actuator: ParameterSet | str | None = None) -> "Subject":
        """The subject that an actuator, or the name of one, is; the default one if not given."""
        chosen = load_actuator(
            model_of(DEFAULT_KIND).parameters.default if actuator is None else actuator
        )
        model = model_of(chosen)
        return cls(model, chosen, tuple(unknowns_of(model, chosen, None, None)[0]))

    def cases(self) -> dict[str, dict[str, float]]:
        """Named faults of the kind's own."""
        return self.model.study.cases(self.model.faults(self.actuator))

    def error_percent(
        self, found: Mapping[str, float], injected: Mapping[str, float], *, wrapped: bool = False
    ) -> float:
        """How far values are from those injected; ``wrapped`` takes directions as angles."""
        faults = self.model.faults(self.actuator)
        return self.model.study.error_percent(faults, found, injected, wrapped=wrapped)

    @classmethod
    def stored(cls, values: Mapping[str, Any]) -> "Subject":
        """The subject of plain values (`plain`); without ``kind`` they are of the default kind."""
        kind = values.get("kind", DEFAULT_KIND)
        try:
            parameters = model_of(kind).of_file(values, "the study").parameters
        except ParameterError as error:
            raise InputError(
                f"{error} The study is of an actuator of that kind: install the package that "
                "brings it."
            ) from None
        if parameters.own_model is not None:
            return cls.of(parameters.from_dict(dict(values)))
        given = {name: value for name, value in values.items() if name != "kind"}
        try:
            return cls.of(parameters.model_validate(given))
        except ValidationError as error:
            raise one_sentence(error, f"actuator {values.get('name', '')} of the study") from None

    def plain(self) -> dict[str, Any]:
        """The actuator as values for JSON; the kind is named unless it is the default.

        Where a file states the kind they are the content of that file.
        """
        if self.actuator.own_model is not None:
            return self.actuator.as_table()
        values = self.actuator.model_dump(mode="json")
        return values if self.kind == DEFAULT_KIND else {"kind": self.kind, **values}

    @property
    def kind(self) -> str:
        """Name of the kind of actuator."""
        return self.model.kind

    @cached_property
    def magnitudes(self) -> list[int]:
        """Places of the faults that a diagnosis names: all but directions."""
        unknowns = enumerate(self.unknowns)
        return [n for n, one in unknowns if one.role == "fault" and one.direction_of is None]

    @cached_property
    def directions(self) -> list[tuple[int, int]]:
        """Places of each magnitude that has a direction, and of that direction."""
        return [
            (self.names.index(one.direction_of), n)
            for n, one in enumerate(self.unknowns)
            if one.direction_of in self.names
        ]

    def vector(self, given: Any) -> tuple[float, ...]:
        """(d,) tuple of values given by name; missing ones are healthy."""
        values = self.model.values_of(self.actuator, given)
        for name in dict(given) if isinstance(given, Mapping) else ():
            if name not in self.names:
                raise InputError(
                    f"{name} is derived from what the twin leaves unexplained and is not searched; "
                    "leave it out of the case."
                )
        return tuple(float(values[name]) for name in self.names)

    def values(self, vector: Sequence[float] | np.ndarray) -> dict[str, float]:
        """All unknowns by name of a vector (d,); those not searched are healthy."""
        found = self.model.healthy(self.actuator)
        found.update(zip(self.names, map(float, vector), strict=True))
        return found
