"""Options that several commands share, how the shell completes them, and what their texts mean."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import ematwin
from ematwin.errors import InputError
from ematwin.files import check_target
from ematwin.quantities import parse_quantity, use_units

if TYPE_CHECKING:
    from ematwin.models.parameter_set import ParameterSet
    from ematwin.monitoring.calibration import Calibration
    from ematwin.recordings.recording import Recording

Choices = dict[str, list[str]]  # values by label, as `ematwin.read` takes them


def option(help: str, default: Any = None, *names: str, **more: Any) -> Any:
    """An option with a value; None where it is not given, or a ``default``."""
    return typer.Option(default, *names, help=help, **more)


def argument(help: str, default: Any = ..., **more: Any) -> Any:
    """An argument of a command; it has to be given unless it has a ``default``."""
    return typer.Argument(default, help=help, **more)


def flag(name: str, help: str) -> Any:
    """An option without a value."""
    return typer.Option(False, name, help=help)


def file_to_write(help: str, *suffixes: str) -> Any:
    """An option for a file that will be written; refused before any work if that cannot be."""

    def checked(path: Path | None) -> Path | None:
        if path is not None:
            check_target(path, suffixes)
        return path

    return option(help, callback=checked)


def _names(module: str, names: Callable[[Any], Iterable[str]]) -> Callable[[str], list[str]]:
    """Complete one of the ``names`` that a module of ematwin knows, which is loaded only then."""

    def starting(incomplete: str) -> list[str]:
        try:
            known = names(import_module(f"ematwin.{module}"))
            return sorted(name for name in known if name.startswith(incomplete))
        except Exception:  # such as a broken package that adds an actuator: the prompt stays
            return []

    return starting


# the shell itself completes the names of files
ACTUATORS = _names("models.registry", lambda registry: registry.shipped_actuators())
SCENARIOS = _names(
    "models.registry", lambda known: {n for m in known.models().values() for n in m.scenarios()}
)
ALGORITHMS = _names("estimation.search", lambda search: [one.name for one in search.methods()])
_PRESETS = _names("optimizers.registry", lambda registry: registry.PRESETS)


def several_algorithms(incomplete: str) -> list[str]:
    """Complete search methods and presets with commas between them."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in [*ALGORITHMS(last), *_PRESETS(last)]]


ACTUATOR = option(
    "A shipped parameter set of any kind, a TOML file, or a calibrated actuator.",
    "servo48",
    autocompletion=ACTUATORS,
)
SCENARIO = option(
    "A shipped scenario, or a TOML, CSV or Parquet file; the kind's default if not given.",
    autocompletion=SCENARIOS,
)
EXACT = flag("--exact", "Parameters are exactly those of the actuator: no tolerances count.")
WHERE = option("Use only recordings with this label: condition=normal. Repeatable.")
COLUMN = option('Which channel is what, e.g. i_a="Phase A [A]". Repeatable.')
MAP = option("The same in a TOML file (docs/recordings.md).", None, "--map")
NOISE = option("Sensor noise, e.g. white=0.02,bits=12.")
GAPS = option("Holes in the record: refuse, longest or mask.", "refuse")
LOAD = option(
    'The constant load of a record that does not hold it, e.g. "10 N*m"; 0 if there was none.'
)
TABLE = file_to_write("Write all verdicts as a table (.csv or .parquet).", ".csv", ".parquet")
REPORT = file_to_write("Write a self-contained page here (.html).", ".html")
FORCE = flag("--force", "Replace a file that exists, which you may have edited.")
RECORDED_ACTUATOR = option(
    "A shipped parameter set of any kind, a TOML file, or a calibrated actuator; if not "
    "given the default one of the kind that has such channels.",
    autocompletion=ACTUATORS,
)
FAIL = option(
    "End with exit code 1 if a recording gets one of these grades: fault, changed, none; "
    "several with commas."
)
UNITS = option(
    'Show values in these units, e.g. "angle=mrad, torque=mN m"; ematwin units keeps '
    "them. Tables and JSON stay SI.",
    callback=use_units,  # without the option it takes those of the user's settings
)
JSON = flag("--json", "Answer as JSON.")
PORT = option("Port of the page on this machine; 0 takes a free one.", 0)
NO_BROWSER = flag("--no-browser", "Print the address and open nothing.")


def pairs(texts: list[str], what: str) -> dict[str, str]:
    """``["friction=0.25"]`` as a mapping; `InputError` if a name comes twice."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name.strip() and equals and value.strip()):
            example = f"Write for example {what} friction=0.25."
            raise InputError(f"{what} needs name=value, received {text!r}. {example}")
        if name.strip() in found:
            raise InputError(f"{what} gives {name.strip()} twice; give it once.")
        found[name.strip()] = value.strip()
    return found


def numbers(texts: list[str], what: str) -> dict[str, float]:
    """`pairs` with numbers as values."""
    values = {}
    for name, text in pairs(texts, what).items():
        try:
            values[name] = float(text)
        except ValueError:
            raise InputError(f"{what} {name} must be a number, received {text!r}.") from None
    return values


def grades(text: str | None) -> set[str]:
    """The grades of ``--fail-on``; none where it is not given."""
    found = set() if text is None else {part.strip() for part in text.split(",")}
    if not found <= {"fault", "changed", "none", "healthy"}:
        raise InputError(f"--fail-on takes fault, changed and none, received {text!r}.")
    return found


def meant(files: list[Path], column: list[str] | None, map_file: Path | None) -> "ParameterSet":
    """The actuator that the first of some files is of, where none was named."""
    from ematwin.monitoring.runs import actuator_of

    return actuator_of(files, pairs(column or [], "--column") or map_file)


def map_of(column: list[str] | None, map_file: Path | None, actuator: Any) -> Any:
    """The channel map of the options for recordings of an actuator, or None without any."""
    if not column and map_file is None:
        return None
    from ematwin.models.registry import model_of
    from ematwin.recordings.channel import ChannelMap

    channels = model_of(actuator).channels
    base = None if map_file is None else ChannelMap.of(map_file, channels)
    return ChannelMap.parse(column or [], channels, base)


def load(files: list[Path], columns: Any, actuator: Any, **reading: Any) -> "list[Recording]":
    """Recordings of an actuator in files and folders, each motion of a table."""
    from ematwin.monitoring.runs import files_of

    files = [file for path in files for file in files_of(path)]
    return ematwin.read(files, columns, actuator=actuator, split=True, **reading)


def gathered(
    files: list[Path], actuator: Any, column: list[str] | None, map_file: Path | None,
    known_of: "Callable[[Any, Path], Calibration]", **reading: Any,
) -> tuple[Any, "Calibration"]:  # fmt: skip
    """Recordings in files and folders, or those of a table of runs, and what judges the first.

    ``known_of`` takes the actuator that was named, if any, and the first file of it.
    """
    from ematwin.monitoring.runs import files_of, is_table_of_runs, read_runs

    columns = partial(map_of, column, map_file)
    for table in filter(is_table_of_runs, files):
        if len(files) > 1:
            raise InputError(f"{table} is a table of runs (a column path); give it alone.")
        runs = read_runs(table, actuator, columns, known_of=known_of, **reading)
        return runs, runs.groups[0].known
    known = known_of(actuator, files_of(files[0])[0])
    return load(files, columns(known.actuator), known.actuator, **reading), known


def constant_load(text: str | None, actuator: "ParameterSet") -> float | None:
    """A load in SI, from a number with or without its unit; None where none is given."""
    from ematwin.models.registry import model_of

    if text is None:
        return None
    model = model_of(actuator)
    if model.load is None:
        raise InputError(f"The kind {model.kind} takes no load; leave --load out.")
    return parse_quantity(text, model.channel(model.load).unit, "--load")


def remarks(recordings: "Sequence[Recording]") -> tuple[list[str], list[str]]:
    """Assumptions made in reading, and doubts; alike sentences once."""
    from ematwin.recordings.read import assumptions

    assumed = [text for one in recordings for text in assumptions(one)]
    doubtful = [text for one in recordings for text in one.provenance.get("warnings", [])]
    return list(dict.fromkeys(assumed)), list(dict.fromkeys(doubtful))


def choice(texts: list[str], what: str) -> Choices:
    """``["run=1,2"]`` as ``{"run": ["1", "2"]}``."""
    found = pairs(texts, what).items()
    return {name: [x.strip() for x in values.split(",") if x.strip()] for name, values in found}


def known_fault(text: str) -> tuple[str, Choices]:
    """``"lubrication:condition=dry;run=1,2"`` as fault and choice."""
    fault, colon, rest = text.partition(":")
    if not (fault.strip() and colon and rest.strip()):
        example = "Write for example --known lubrication:condition=dry."
        raise InputError(f"--known needs fault:label=value, received {text!r}. {example}")
    return fault.strip(), choice([part for part in rest.split(";") if part.strip()], "--known")
