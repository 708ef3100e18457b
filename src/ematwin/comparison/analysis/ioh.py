"""Export to the IOHprofiler format, which IOHanalyzer and iohinspector read.

Layout as `ioh` 0.3 writes it (https://iohprofiler.github.io/IOHanalyzer/data/): a folder for each
algorithm; in it, for each case as a "function", a JSON meta file and a folder with one raw-data
file. Raw data: two columns, evaluations and best cost (``raw_y``), a header line before each run.
The readers tell runs apart by evaluation 1, and a history here begins after the first batch of
candidates: its best cost is therefore given at evaluation 1, which flatters the very beginning.
Written from the whole histories, run by run, so a large store passes through.
"""

import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ematwin import __version__
from ematwin.comparison.study.run import StoredRun
from ematwin.errors import FileError

_HEADER = "evaluations raw_y\n"


@dataclass
class _Function:
    """One case and algorithm in the making."""

    number: int
    name: str
    algorithm: str
    dimension: int
    runs: list[dict[str, Any]] = field(default_factory=list)

    @property
    def data(self) -> str:
        place = f"data_f{self.number}_{self.name}"
        return f"{place}/IOHprofiler_f{self.number}_DIM{self.dimension}.dat"

    def meta(self) -> dict[str, Any]:
        return {
            "version": "0.3.18",
            "suite": "ematwin",
            "function_id": self.number,
            "function_name": self.name,
            "maximization": False,
            "algorithm": {"name": self.algorithm, "info": f"ematwin {__version__}"},
            "attributes": ["evaluations", "raw_y"],
            "scenarios": [{"dimension": self.dimension, "path": self.data, "runs": self.runs}],
        }


def export_ioh(runs: Iterable[StoredRun], folder: str | Path, cases: list[str]) -> tuple[int, int]:
    """Write the histories of runs.

    Parameters
    ----------
    folder : made if missing; must be empty
    cases : all names, whose places number the functions from 1

    Returns
    -------
    written, left out : int, runs; without any history there is nothing to write

    Raises
    ------
    FileError
        If the folder holds something already or cannot be written.
    """
    root = Path(folder)
    functions: dict[tuple[str, str], _Function] = {}
    left_out = 0
    try:
        root.mkdir(parents=True, exist_ok=True)
        if any(root.iterdir()):
            raise FileError(f"The folder {root} is not empty. Choose a new one for the export.")
        for stored in runs:
            history = [(int(n), float(cost)) for n, cost in stored.result.history]
            history = [(n, cost) for n, cost in history if math.isfinite(cost)]
            if not history:
                left_out += 1
                continue
            key = (stored.spec.algorithm, stored.spec.case)
            if key not in functions:
                functions[key] = _Function(
                    cases.index(stored.spec.case) + 1, _word(stored.spec.case),
                    stored.spec.algorithm, len(stored.spec.faults),
                )  # fmt: skip
            _append(root / _word(stored.spec.algorithm), functions[key], stored, history)
        for function in functions.values():
            meta = (
                root / _word(function.algorithm)
                / f"IOHprofiler_f{function.number}_{function.name}.json"
            )  # fmt: skip
            meta.write_text(json.dumps(function.meta(), indent=1), encoding="utf-8")
    except FileError:
        raise
    except OSError as error:
        raise FileError(
            f"Cannot write the export to {root}: {error.strerror or error}. Choose a folder that "
            "is yours."
        ) from None
    return sum(len(function.runs) for function in functions.values()), left_out


def _append(
    folder: Path, function: _Function, stored: StoredRun, history: list[tuple[int, float]]
) -> None:
    """Add a run's improvements, and its end, to the raw data."""
    improved = history[:1]
    for point in history[1:]:
        if point[1] < improved[-1][1]:
            improved.append(point)
    best = improved[-1]
    total = max(stored.result.evaluations, history[-1][0])
    lines = [(1, improved[0][1]), *improved[1:]]
    if lines[-1][0] != total:
        lines.append((total, best[1]))
    target = folder / function.data
    target.parent.mkdir(parents=True, exist_ok=True)
    with target.open("a", encoding="utf-8", newline="\n") as file:
        file.write(_HEADER)
        file.writelines(f"{n} {cost!r}\n" for n, cost in lines)
    # the format wants a position; a failed run has none, which "x" says by being empty
    position = list(stored.result.faults)
    function.runs.append({
        "instance": 1,
        "evals": total,
        "best": {"evals": best[0], "y": best[1], "x": position},
    })  # fmt: skip


def _word(name: str) -> str:
    """A name as a part of a path."""
    return re.sub(r"[^A-Za-z0-9-]+", "-", name).strip("-") or "unnamed"
