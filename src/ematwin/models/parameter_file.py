"""Parameter files: entries with values, units, sources and tolerances, read and written.

A file holds a table for each section and, for each parameter, ``{ value, unit, source }``; where
more is known than of the kind at large, also a ``tolerance``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic.fields import FieldInfo

from ematwin.errors import ParameterError
from ematwin.quantities import parse_share, to_si
from ematwin.validation import load_toml, misspelt, shortened, unknown_name

_ON_TEMPLATES = (
    "Put in the values of your actuator, in any unit of the same kind, and their sources.",
    "",
    "Tolerance: how far a value may be off. 95 % of such actuators lie between the value divided",
    "by and multiplied with 1 + tolerance. The comments say what is usual; where you know better,",
    'add tolerance = "5 %" to an entry. Without any, a value is taken as exact.',
    "Drift: how far it changes between recordings of one actuator, with temperature and supply.",
    "",
)
_ON_OPTIONS = (
    "Sections that may be left out: without one, what it describes is not there, or has its simple",
    "form. To have it, remove the comment signs and put in your values.",
)
_NEEDED = ("value", "unit", "source")  # of each parameter in a file


def unit_of(field: FieldInfo) -> str:
    """SI unit of a parameter; the empty string for a ratio."""
    return str(stated(field)["unit"])


def stated(field: FieldInfo) -> dict[str, Any]:
    """Unit, tolerance, drift and exactness of a parameter, as `quantity` states them."""
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    return extra


def parameter_file(name_or_path: str | Path, shipped: Mapping[str, Path]) -> Path:
    """The path of a TOML file, or of the file of a shipped set."""
    path = Path(name_or_path)
    if path.suffix == ".toml":
        return path
    if str(name_or_path) not in shipped:
        raise ParameterError(
            f"There is no actuator {str(name_or_path)!r}. Shipped: {', '.join(shipped)}; "
            "or give the path of a TOML file (ending in .toml)."
        )
    return shipped[str(name_or_path)]


def parameter_table(name_or_path: str | Path, shipped: Mapping[str, Path]) -> dict[str, Any]:
    """The content of a parameter file, or of a shipped set, as it is written."""
    return load_toml(parameter_file(name_or_path, shipped), "actuator")


def _toml(value: str | float) -> str:
    """A value as TOML, on one line."""
    import tomli_w

    return tomli_w.dumps({"x": value}).removeprefix("x = ").rstrip("\n")


def _as_written(leaf: Mapping[str, Any], before: Mapping[str, Any]) -> dict[str, Any]:
    """Value and unit of an entry as they stood in a file, if they still mean the same."""
    if not {"value", "unit"} <= before.keys():
        return {}
    if to_si(before["value"], before["unit"], leaf["unit"], "it") != leaf["value"]:
        return {}
    return {"value": before["value"], "unit": before["unit"]}


def _comment(text: str) -> str:
    return f"# {' '.join(text.split())}".rstrip()


class Read(NamedTuple):
    """A parameter file as it was read.

    Parameters
    ----------
    values : as the class of the actuator validates them, SI
    sources, tolerances : by place
    problems : place and sentence of each
    unread : places whose value is not known, which is no second problem
    """

    values: dict[str, Any]
    sources: dict[str, str]
    tolerances: dict[str, float]
    problems: list[tuple[str, str]]
    unread: set[str]


def read_table(kind: Any, table: Mapping[str, Any], what: str) -> Read:
    """The content of a parameter file for a class of actuators; ``what`` names it in messages."""
    found = Read({}, {}, {}, [], set())
    given = {key: entry for key, entry in table.items() if key != "kind"}
    for key, entry in _corrected(given, kind.model_fields, "", what, found.problems):
        section = kind.section(key)
        if section is None or not isinstance(entry, dict):
            found.values[key] = entry
            continue
        values = found.values[key] = {}
        fields = section.model_fields
        for name, leaf in _corrected(entry, fields, f"{key}.", what, found.problems):
            if name not in fields:
                values[name] = leaf
                continue
            place = f"{key}.{name}"
            read = _read_entry(leaf, fields[name], place, what)
            found.problems.extend((place, text) for text in read.problems)
            if read.value is None:
                found.unread.add(place)
            else:
                values[name] = read.value
            if read.source is not None:
                found.sources[place] = read.source
            if read.tolerance is not None:
                found.tolerances[place] = read.tolerance
    return found


def _corrected(
    table: Mapping[str, Any], known: Any, prefix: str, what: str, problems: list[tuple[str, str]]
) -> list[tuple[str, Any]]:
    """Names and entries of a table, each misspelt name put right and noted as a problem."""
    meant, found = misspelt(table, known), []
    for given, entry in table.items():
        name = meant.get(given, given)
        if name != given:
            wrong = f"{prefix}{given}"
            problems.append((wrong, unknown_name(wrong, what, f"{prefix}{name}")))
        found.append((name, entry))
    return found


class _Entry(NamedTuple):
    """A parameter as a file gives it; None where it is missing or wrong."""

    value: float | None  # SI
    source: str | None
    tolerance: float | None
    problems: list[str]  # a sentence each


def _read_entry(leaf: Any, field: FieldInfo, place: str, what: str) -> _Entry:
    """Value, source and tolerance of ``{ value, unit, source }``, and all that is wrong with it."""
    if not isinstance(leaf, dict):
        return _Entry(None, None, None, [_incomplete(place, leaf)])
    known = (*_NEEDED, "tolerance")
    meant = misspelt(leaf, known)
    problems = [
        unknown_name(f"{place}.{key}", what, f"{place}.{meant[key]}" if key in meant else "")
        for key in leaf
        if key not in known
    ]
    given = {meant.get(key, key): one for key, one in leaf.items()}
    if not given.keys() >= set(_NEEDED):
        problems.append(_incomplete(place, leaf))
    value = source = tolerance = None
    if "value" in given:
        number = given["value"]
        if isinstance(number, bool) or not isinstance(number, int | float):
            problems.append(f"{place} must be a number, received {number!r}; correct it.")
        elif "unit" in given:
            try:
                value = to_si(number, given["unit"], unit_of(field), place)
            except ParameterError as error:
                problems.append(str(error))
    if "source" in given:
        if isinstance(given["source"], str) and given["source"].strip():
            source = given["source"]
        else:
            problems.append(
                f"{place} must name the source of its value, received "
                f"{given['source']!r}; say where it comes from."
            )
    if "tolerance" in given:
        try:
            tolerance = tolerance_of(given["tolerance"], field, place)
        except ParameterError as error:
            problems.append(str(error))
    return _Entry(value, source, tolerance, problems)


def _incomplete(place: str, leaf: Any) -> str:
    return (
        f"{place} must be {{ value = ..., unit = ..., source = ... }}, "
        f"received {shortened(leaf)}; complete it."
    )


def tolerance_of(given: Any, field: FieldInfo, place: str) -> float:
    """A tolerance as it is given for a parameter, such as "5 %", as a share."""
    if stated(field).get("exact"):
        raise ParameterError(
            f"{place} is chosen or counted and thus exact, received the tolerance {given!r}; "
            "leave its tolerance out."
        )
    return parse_share(given, f"The tolerance of {place}")


def template_of(actuator: Any, before: Mapping[str, Any]) -> str:
    """Text of a parameter file with comments (`ParameterSet.template`)."""
    import tomli_w

    table = actuator.as_table()
    meanings = {place: meaning for place, _, _, meaning, _ in actuator.parameters()}
    lines = [_comment(line) for line in _ON_TEMPLATES]
    for key, entry in table.items():
        section = actuator.section(key)
        if isinstance(entry, dict) and section is None:
            lines += ["", tomli_w.dumps({key: entry}).rstrip()]
            continue
        if section is None:
            lines.append(f"{key} = {_toml(entry)}")
            continue
        lines += ["", f"[{key}]"]
        summary = (section.__doc__ or "").strip().partition("\n")[0]
        if summary:
            lines.append(_comment(summary))
        for name, leaf in entry.items():
            place = f"{key}.{name}"
            leaf |= _as_written(leaf, before.get(key, {}).get(name, {}))
            inner = ", ".join(f"{part} = {_toml(one)}" for part, one in leaf.items())
            lines += [
                _comment(f"{meanings[place]}{_reach(actuator, place)}"),
                f"{name} = {{ {inner} }}",
            ]
    lines += _left_out(actuator)
    return "\n".join(lines) + "\n"


def _left_out(actuator: Any) -> list[str]:
    """Lines of a template on the sections that this actuator leaves out, as comments."""
    lines: list[str] = []
    for key in type(actuator).model_fields:
        section = actuator.section(key)
        if section is None or getattr(actuator, key) is not None:
            continue
        lines += ["", f"# [{key}]", _comment((section.__doc__ or "").partition("\n")[0])]
        for name, field in section.model_fields.items():
            leaf: dict[str, Any] = {
                "value": section.example[name],
                "unit": unit_of(field),
                "source": "...",
            }
            inner = ", ".join(f"{part} = {_toml(one)}" for part, one in leaf.items())
            said = f"{field.description}{_reach(actuator, f'{key}.{name}')}"
            lines.append(_comment(f"{name} = {{{inner}}}  # {said}"))
    return ["", *map(_comment, _ON_OPTIONS), *lines] if lines else []


def _reach(actuator: Any, place: str) -> str:
    """Tolerance and drift of a parameter for a comment; nothing where it has neither."""
    tolerance, drift = actuator.tolerance(place), actuator.drift(place)
    said = "" if tolerance is None else f"; tolerance {100.0 * tolerance:.3g} %"
    return said if drift is None else f"{said}; drift {100.0 * drift:.3g} %"
