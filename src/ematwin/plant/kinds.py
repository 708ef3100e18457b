"""The kinds of actuators, and parameter sets of any kind."""

from pathlib import Path
from typing import Any

from ematwin.errors import ParameterError
from ematwin.plant.ball_screw import BallScrew
from ematwin.plant.parameter_set import ROTARY, ParameterSet, parameter_file
from ematwin.plant.parameters import Actuator
from ematwin.validation import load_toml

KINDS: dict[str, type[ParameterSet]] = {kind.kind: kind for kind in (Actuator, BallScrew)}


def shipped_actuators() -> dict[str, Path]:
    """Names and files of all parameter sets that come with ematwin."""
    return {name: path for kind in KINDS.values() for name, path in kind.shipped().items()}


def load_actuator(name_or_path: str | Path | ParameterSet) -> ParameterSet:
    """A shipped set by name, or a TOML file, of whatever kind it says it is.

    Raises
    ------
    ParameterError
        If there is no such set, or a value is missing, impossible or of the wrong unit.
    FileError
        If the file cannot be read.
    """
    if isinstance(name_or_path, ParameterSet):
        return name_or_path
    table = _table(name_or_path)
    return KINDS[_kind(table, name_or_path)].from_dict(table, str(name_or_path))


def kind_of(name_or_path: str | Path) -> str:
    """The kind of a shipped set or TOML file, without reading its values."""
    return _kind(_table(name_or_path), name_or_path)


def _table(name_or_path: str | Path) -> dict[str, Any]:
    return load_toml(parameter_file(name_or_path, shipped_actuators()), "actuator")


def _kind(table: dict[str, Any], what: str | Path) -> str:
    kind = table.get("kind", ROTARY)
    if not isinstance(kind, str) or kind not in KINDS:
        raise ParameterError(
            f"{what}: there is no kind of actuator {kind!r}; choose one of {', '.join(KINDS)}."
        )
    return kind
