"""The kinds of actuators that there are, and parameter sets of any kind.

Some come with ematwin; others are found by the entry point group ``ematwin.models``, whose entries
name an instance of `Model` (or its class), or named by `register_model` in a process. A kind
of someone else never replaces one of ours, so that one of ours is found without loading the rest.
"""

from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from ematwin.errors import InputError, ParameterError
from ematwin.models.base import Model
from ematwin.models.parameter_file import parameter_table
from ematwin.models.parameter_set import DEFAULT_KIND, ParameterSet

# Ours by kind, which is also the name of the folder but for hyphens.
_OURS = ("bldc", "ball-screw", "linear-axis", "pmsm", "position-servo")
_STATED = "fmu"  # each file of this kind states what it is, so that it has no sets, no channels
_REGISTERED: dict[str, Model] = {}  # of this process, by kind
_BROKEN: dict[str, str] = {}  # sentences by the name of the entry point


def _own(kind: str) -> Model:
    """One of ours, which is loaded without the others."""
    return import_module(f"ematwin.models.{kind.replace('-', '_')}.model").MODEL


def register_model(model: Model) -> None:
    """Make a kind of actuator known, in this process and in the workers that it starts.

        ematwin.register_model(MODEL)

    It is for notebooks and for trying a model out. The same kind again replaces what there was. A
    package registers by the entry point group ``ematwin.models`` instead, which the command line
    finds as well.

    Parameters
    ----------
    model : an instance of a class of `Model`

    Raises
    ------
    InputError
        If it is no model, or of a kind that comes with ematwin.
    """
    if not isinstance(model, Model):
        raise InputError(
            f"register_model takes an instance of a Model, received {model!r}; give the model "
            "itself, such as MyModel()."
        )
    if model.kind in (*_OURS, _STATED):
        raise InputError(
            f"The kind {model.kind!r} comes with ematwin; choose another name for yours."
        )
    _REGISTERED[model.kind] = model
    models.cache_clear()


def registered_models() -> tuple[Model, ...]:
    """The kinds that `register_model` named in this process."""
    return tuple(_REGISTERED.values())


@cache
def models() -> dict[str, Model]:
    """All kinds by name, ours first; kinds that cannot be loaded are in `broken_kinds`."""
    found: dict[str, Model] = {kind: _own(kind) for kind in _OURS} | _REGISTERED
    _BROKEN.clear()
    for point in entry_points(group="ematwin.models"):
        try:
            loaded = point.load()
            model = loaded() if isinstance(loaded, type) else loaded
            if not isinstance(model, Model):
                raise TypeError(
                    f"it must be a Model of ematwin.models.base, but is a {type(model).__name__}"
                )
        except Exception as error:  # whatever a package of others raises
            _BROKEN[point.name] = (
                f"The kind of actuator {point.name!r} cannot be loaded from {point.value}: "
                f"{error}. Repair or remove the package that registers it."
            )
            continue
        found.setdefault(model.kind, model)
    return found


def broken_kinds() -> list[str]:
    """A sentence on each kind that an installed package names and that cannot be loaded."""
    models()
    return list(_BROKEN.values())


def model_of(actuator: Any) -> Model:
    """The model of an actuator, or of a kind by its name.

    Raises `ParameterError` if there is no such kind.
    """
    if isinstance(actuator, ParameterSet) and actuator.own_model is not None:
        return actuator.own_model
    return _model_of_kind(actuator if isinstance(actuator, str) else type(actuator).kind, "There")


def _model_of_kind(kind: Any, there: str) -> Model:
    """The model of a kind; ``there`` begins the sentence of the error, which names all kinds."""
    if kind in (*_OURS, _STATED):
        return _own(kind)
    for model in models().values():
        if kind == model.kind or kind in model.parameters.former_kinds:
            return model
    if isinstance(kind, str) and kind in _BROKEN:
        raise ParameterError(_BROKEN[kind])
    known = ", ".join([*models(), _STATED])
    said = f"{there} is no kind of actuator {kind!r}; choose one of {known}."
    raise ParameterError(" ".join([said, *broken_kinds()]))


def shipped_actuators() -> dict[str, Path]:
    """Names and files of all parameter sets that come with the kinds."""
    found: dict[str, Path] = {}
    for model in models().values():
        found |= model.parameters.shipped()
    return found


def load_actuator(name_or_path: "str | Path | ParameterSet | Any | None" = None) -> ParameterSet:
    """An actuator: a shipped set by name, or a TOML file, of whatever kind it says it is.

    What holds an actuator (a calibration) gives that; None gives the default brushless one.

    Raises `ParameterError` if there is no such set, or a value is missing, impossible or of the
    wrong unit; `FileError` if the file cannot be read.
    """
    if name_or_path is None:
        return model_of(DEFAULT_KIND).parameters.load()
    for one in (name_or_path, getattr(name_or_path, "actuator", None)):
        if isinstance(one, ParameterSet):
            return one
    if not isinstance(name_or_path, str | Path):
        raise InputError(
            "An actuator is a parameter set, the name of a shipped one, or the path of a TOML "
            f"file; received {type(name_or_path).__name__}."
        )
    return actuator_in(_table(name_or_path), name_or_path)


def actuator_in(table: dict[str, Any], what: str | Path) -> ParameterSet:
    """The actuator in the content of a parameter file, of whatever kind it says it is."""
    return _model(table, what).parameters.from_dict(table, str(what))


def model_in(name_or_path: str | Path) -> Model:
    """The model of a shipped set or TOML file, without reading its values."""
    return _model(_table(name_or_path), name_or_path)


def _table(name_or_path: str | Path) -> dict[str, Any]:
    """The content of a shipped set or TOML file; of our sets without loading any kind."""
    name = str(name_or_path)
    folders = (Path(__file__).parent / kind.replace("-", "_") for kind in _OURS)
    files = (folder / f"{name}.toml" for folder in folders)
    ours = {f.stem: f for f in files if not Path(name).suffix and f.is_file()}
    return parameter_table(name_or_path, ours or shipped_actuators(), broken_kinds)


def _model(table: dict[str, Any], what: str | Path) -> Model:
    model = _model_of_kind(table.get("kind", DEFAULT_KIND), f"{what}: there")
    return model.of_file(table, str(what))
