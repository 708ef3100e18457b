"""Cases of a study: named vectors, of the kind of actuator, at random, or from a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.benchmarking.subject import Subject
from ematwin.errors import InputError
from ematwin.models.parameter_set import ParameterSet
from ematwin.validation import load_toml

Cases = dict[str, tuple[float, ...]]

PAPER_KIND = "bldc"  # whose own cases are Table 1 of the paper (ESREL 2020)


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
        brushless actuator), "multi" (random vectors with two to four faults: the paper's future
        work), a TOML file with a table ``[cases."name"]`` of values for each case, or a mapping of
        names to such values; missing faults are healthy
    count, seed : of random cases; more of them leave the first ones as they were
    """
    subject = Subject.of(actuator)
    if not isinstance(given, str):
        return _checked(given, subject)
    if count is not None and given != "multi":
        raise InputError(f"--count belongs to --cases multi, received --cases {given}.")
    if given == "paper" and subject.kind != PAPER_KIND:
        raise InputError(
            f"--cases paper is for the kind {PAPER_KIND}, and {subject.actuator.name} is of the "
            f"kind {subject.kind}; choose own, multi or a TOML file."
        )
    if given in ("own", "paper"):
        return _checked(subject.cases(), subject)
    if given == "multi":
        count = 50 if count is None else count
        if count < 1:
            raise InputError(f"The number of cases must be at least 1, received {count}.")
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
