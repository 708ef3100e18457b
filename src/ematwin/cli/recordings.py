"""Options of the commands that take recordings: which files, channels and labels."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import ematwin
from ematwin.cli.options import pairs
from ematwin.errors import InputError
from ematwin.quantities import parse_quantity

if TYPE_CHECKING:
    from ematwin.models.parameter_set import ParameterSet
    from ematwin.monitoring.calibration import Calibration
    from ematwin.recordings.recording import Recording

Choices = dict[str, list[str]]


def meant(files: list[Path], column: list[str] | None, map_file: Path | None) -> "ParameterSet":
    """The actuator that the first of some files is of, where none was named."""
    from ematwin.models.reading import actuator_for
    from ematwin.monitoring.runs import files_of

    given = pairs(column or [], "--column")
    return actuator_for(files_of(files[0])[0], given or map_file)


def map_of(column: list[str] | None, map_file: Path | None, actuator: Any) -> Any:
    """The channel map of the options for recordings of an actuator, or None without any."""
    if not column and map_file is None:
        return None
    from ematwin.models.registry import model_of
    from ematwin.recordings.channel_map import ChannelMap

    channels = model_of(actuator).channels
    base = None if map_file is None else ChannelMap.of(map_file, channels)
    return ChannelMap.parse(column or [], channels, base)


def load(
    files: list[Path], column: list[str] | None, map_file: Path | None, actuator: Any,
    **reading: Any,
) -> "list[Recording]":  # fmt: skip
    """Recordings of an actuator in files and folders, each motion of a table."""
    from ematwin.monitoring.runs import files_of

    columns = map_of(column, map_file, actuator)
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

    for table in filter(is_table_of_runs, files):
        if len(files) > 1:
            raise InputError(f"{table} is a table of runs (a column path); give it alone.")
        columns = partial(map_of, column, map_file)
        runs = read_runs(table, actuator, columns, known_of=known_of, **reading)
        return runs, runs.groups[0].known
    known = known_of(actuator, files_of(files[0])[0])
    return load(files, column, map_file, known.actuator, **reading), known


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

    assumed = dict.fromkeys(text for one in recordings for text in assumptions(one))
    doubtful = dict.fromkeys(
        text for one in recordings for text in one.provenance.get("warnings", [])
    )
    return list(assumed), list(doubtful)


def choice(texts: list[str], what: str) -> Choices:
    """``["run=1,2"]`` as ``{"run": ["1", "2"]}``."""
    return {
        name: [value.strip() for value in values.split(",") if value.strip()]
        for name, values in pairs(texts, what).items()
    }


def known_fault(text: str) -> tuple[str, Choices]:
    """``"lubrication:condition=dry;run=1,2"`` as fault and choice."""
    fault, colon, rest = text.partition(":")
    if not (fault.strip() and colon and rest.strip()):
        raise InputError(
            f"--known needs fault:label=value, received {text!r}. Write for example "
            "--known lubrication:condition=dry."
        )
    return fault.strip(), choice([part for part in rest.split(";") if part.strip()], "--known")
