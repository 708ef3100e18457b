"""Subject: the actuator of a study, its searched unknowns, and the cases of a study.

Runs carry their actuator as plain values, so that neither a worker nor a report needs its file. Its
faults and nuisances are searched; vectors hold their values in the order of its unknowns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from ematwin.errors import InputError, ParameterError, whole_number
from ematwin.estimation.free_unknowns import unknowns_of
from ematwin.models.base import Model
from ematwin.models.parameter_set import DEFAULT_KIND, ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.unknown import HasUnknowns, Unknown
from ematwin.validation import load_toml, one_sentence

Cases = dict[str, tuple[float, ...]]

PAPER_KIND = "bldc"  # whose own cases are Table 1 of the paper (ESREL 2020)


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
        kind = self.model.kind
        return values if kind == DEFAULT_KIND else {"kind": kind, **values}

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


def cases_of(
    given: str | Mapping[str, Any] = "own",
    actuator: ParameterSet | str | None = None,
    *,
    count: int | None = None,
    seed: int = 1,
) -> Cases:
    """Give the cases of ``--cases``, or of a mapping.

    Parameters
    ----------
    given : "own" (the cases of the kind of actuator), "paper" (Table 1 of the paper, for the
        brushless actuator), "multi" (random vectors with two to four faults), a TOML file with a
        table ``[cases."name"]`` of values for each case, or a mapping of names to such values
    count, seed : of random cases; more of them leave the first ones as they were
    """
    subject = Subject.of(actuator)
    if not isinstance(given, str):
        return _checked(given, subject)
    if count is not None and given != "multi":
        raise InputError(f"--count belongs to --cases multi, received --cases {given}.")
    if given == "paper" and subject.model.kind != PAPER_KIND:
        raise InputError(
            f"--cases paper is for the kind {PAPER_KIND}, and {subject.actuator.name} is of the "
            f"kind {subject.model.kind}; choose own, multi or a TOML file."
        )
    if given in ("own", "paper"):
        return _checked(subject.cases(), subject)
    if given == "multi":
        count = whole_number(50 if count is None else count, "The number of cases", 1)
        return {f"Multi {n + 1:03d}": _random_vector(subject, seed, n) for n in range(count)}
    path = Path(given)
    if not (given.lower().endswith(".toml") or path.is_file()):
        raise InputError(f"There are no cases {given!r}; choose own, paper, multi or a TOML file.")
    table = load_toml(path, "cases")
    found = table.get("cases")
    extra = [key for key in table if key != "cases"]
    if not isinstance(found, dict) or not found or extra:
        what = f"received {extra[0]!r}" if extra else "there is none"
        raise InputError(
            f'{path} must hold tables [cases."name"] of fault magnitudes and nothing else; {what}.'
        )
    return _checked(found, subject, f" of {path}")


def _checked(given: Mapping[str, Any], subject: Subject, of: str = "") -> Cases:
    """Vectors of cases by name; ``of`` says in errors where they stand."""
    cases = {}
    for name, values in given.items():
        if of and not isinstance(values, dict):
            raise InputError(
                f"Case {name!r}{of} must be a table such as friction = 0.3, received {values!r}."
            )
        try:
            cases[str(name)] = subject.vector(values)
        except InputError as error:
            raise InputError(f"Case {name!r}{of}: {error}") from None
    return cases


def _random_vector(subject: Subject, seed: int, n: int) -> tuple[float, ...]:
    """Two to four faults, each somewhere between healthy and a bound."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, n]))
    faults = {subject.names[place]: subject.unknowns[place] for place in subject.magnitudes}
    most = min(4, len(faults))
    size = rng.integers(min(2, most), most + 1)
    chosen = rng.choice(list(faults), size=size, replace=False)
    directions = {subject.names[m]: subject.unknowns[d] for m, d in subject.directions}
    study, values = subject.model.study, {}
    for name in sorted(map(str, chosen)):
        one = faults[name]
        share = float(rng.uniform(*study.severities.get(name, study.severity)))
        healthy = (one.healthy - one.lower) / one.width
        if min(healthy, 1.0 - healthy) >= 0.1:  # there is room on both sides
            sign = float(rng.choice([-1.0, 1.0]))
        else:
            sign = 1.0 if healthy < 0.5 else -1.0
        reach = 1.0 - healthy if sign > 0.0 else healthy
        values[name] = _value(one, healthy + sign * share * reach)
        if name in directions:
            direction = directions[name]
            values[direction.name] = _value(direction, float(rng.uniform(0.0, 1.0)))
    return subject.vector(values)


def _value(unknown: Any, share: float) -> float:
    """The value at a share of a range, rounded to a readable one."""
    # three digits of the range
    value = unknown.lower + round(share, 3) * unknown.width
    return float(min(max(value, unknown.lower), unknown.upper))
