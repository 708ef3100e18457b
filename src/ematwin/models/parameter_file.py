"""Parameter files: entries with values, units, sources and tolerances, read and written.

A file holds a table for each section and, for each parameter, ``{ value, unit, source }``; where
more is known than of the kind at large, also a ``tolerance``.
"""

import difflib
from collections.abc import Callable, Mapping
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
    'add tolerance = "5 %" to an entry. Without one, that of the kind counts; with neither, the',
    "value is exact.",
    "Drift: how far it changes between recordings of one actuator, with temperature and supply.",
    "",
)
_ON_OPTIONS = (
    "Sections that may be left out: without one, what it describes is not there, or has its simple",
    "form. To have it, remove the comment signs and put in your values.",
)


def unit_of(field: FieldInfo) -> str:
    """SI unit of a parameter; the empty string for a ratio."""
    return str(stated(field)["unit"])


def stated(field: FieldInfo) -> dict[str, Any]:
    """Unit, tolerance, drift and exactness of a parameter, as `quantity` states them."""
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    return extra


def parameter_table(
    name_or_path: str | Path, shipped: Mapping[str, Path], broken: Callable[[], list[str]] = list
) -> dict[str, Any]:
    """The content of a parameter file or shipped set; ``broken`` says what may be missing."""
    path, name = Path(name_or_path), str(name_or_path)
    if path.suffix != ".toml":
        if name not in shipped:
            close = difflib.get_close_matches(name, shipped, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            said = (
                f"There is no actuator {name!r}.{hint} Shipped: {', '.join(shipped)}; "
                "or give the path of a TOML file (ending in .toml)."
            )
            raise ParameterError(" ".join([said, *broken()]))
        path = shipped[name]
    return load_toml(path, "actuator")


def _toml(value: str | float) -> str:
    """A value as TOML, on one line."""
    import tomli_w

    return tomli_w.dumps({"x": value}).removeprefix("x = ").rstrip("\n")


def _as_written(leaf: Mapping[str, Any], before: Mapping[str, Any]) -> dict[str, Any]:
    """Value and unit of an entry as they stood in a file, if they still mean the same."""
    if not {"value", "unit"} <= before.keys():
        return {}
    value, unit = before["value"], before["unit"]
    same = to_si(value, unit, leaf["unit"], "it") == leaf["value"]
    return {"value": value, "unit": unit} if same else {}


def _comment(text: str) -> str:
    return f"# {' '.join(text.split())}".rstrip()


class Read(NamedTuple):
    """A parameter file as it was read."""

    values: dict[str, Any]  # as the class of the actuator validates them, SI
    sources: dict[str, str]  # by place
    tolerances: dict[str, float]
    problems: list[tuple[str, str]]  # place and sentence
    unread: set[str]  # places whose value is not known, which is no second problem


def read_table(kind: Any, table: Mapping[str, Any], what: str) -> Read:
    """The content of a parameter file for a class of actuators; ``what`` names it in messages."""
    found = Read({}, {}, {}, [], set())
    given = {key: entry for key, entry in table.items() if key != "kind"}
    for key, entry in _corrected(given, kind.model_fields, "", what, found):
        section = kind.section(key)
        if section is None or not isinstance(entry, dict):
            found.values[key] = entry
            continue
        values, fields = found.values.setdefault(key, {}), section.model_fields
        for name, leaf in _corrected(entry, fields, f"{key}.", what, found):
            if name not in fields:
                values[name] = leaf
                continue
            place = f"{key}.{name}"
            value = _read_entry(leaf, fields[name], place, what, found)
            if value is None:
                found.unread.add(place)
            else:
                values[name] = value
    return found


def _corrected(
    table: Mapping[str, Any], known: Any, prefix: str, what: str, found: Read
) -> list[tuple[str, Any]]:
    """Names and entries of a table, each misspelt name put right and noted as a problem."""
    meant = misspelt(table, known)
    for given, name in meant.items():
        wrong = f"{prefix}{given}"
        found.problems.append((wrong, unknown_name(wrong, what, f"{prefix}{name}")))
    return [(meant.get(given, given), entry) for given, entry in table.items()]


def _read_entry(leaf: Any, field: FieldInfo, place: str, what: str, found: Read) -> float | None:
    """Value of ``{ value, unit, source }``, SI, or None; all that is wrong with it is noted."""
    needed = ("value", "unit", "source")
    known = (*needed, "tolerance")
    entry = leaf if isinstance(leaf, dict) else {}
    meant = misspelt(entry, known)
    strange = [key for key in entry if key not in known]
    names = [(f"{place}.{key}", f"{place}.{meant[key]}" if key in meant else "") for key in strange]
    wrong = [unknown_name(name, what, right) for name, right in names]
    given = {meant.get(key, key): one for key, one in entry.items()}
    if not given.keys() >= set(needed):
        wrong.append(
            f"{place} must be {{ value = ..., unit = ..., source = ... }}, "
            f"received {shortened(leaf)}; complete it."
        )
    number: Any = given.get("value")
    value = None
    try:
        if "value" in given and (isinstance(number, bool) or not isinstance(number, int | float)):
            wrong.append(f"{place} must be a number, received {number!r}; correct it.")
        elif "value" in given and "unit" in given:
            value = to_si(number, given["unit"], unit_of(field), place)
    except ParameterError as error:
        wrong.append(str(error))
    source = given.get("source", "unknown")
    if not isinstance(source, str) or not source.strip():
        wrong.append(
            f"{place} must name the source of its value, received {source!r}; say where it comes "
            "from."
        )
    elif "source" in given:
        found.sources[place] = source
    try:
        if "tolerance" in given:
            found.tolerances[place] = tolerance_of(given["tolerance"], field, place)
    except ParameterError as error:
        wrong.append(str(error))
    found.problems.extend((place, text) for text in wrong)
    return value


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
            leaf = {"value": section.example[name], "unit": unit_of(field), "source": "..."}
            inner = ", ".join(f"{part} = {_toml(one)}" for part, one in leaf.items())
            said = f"{field.description}{_reach(actuator, f'{key}.{name}')}"
            lines.append(_comment(f"{name} = {{{inner}}}  # {said}"))
    return ["", *map(_comment, _ON_OPTIONS), *lines] if lines else []


def _reach(actuator: Any, place: str) -> str:
    """Tolerance and drift of a parameter for a comment; nothing where it has neither."""
    tolerance, drift = actuator.tolerance(place), actuator.drift(place)
    said = "" if tolerance is None else f"; tolerance {100.0 * tolerance:.3g} %"
    return said if drift is None else f"{said}; drift {100.0 * drift:.3g} %"
