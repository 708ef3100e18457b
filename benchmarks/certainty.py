"""Whether intervals and probabilities mean what they say: docs/certainty-results.md.

    python benchmarks/certainty.py verdicts --records 500 --store results
    python benchmarks/certainty.py coverage --records 200 --store results
    python benchmarks/certainty.py calibration --records 200 --store results
    python benchmarks/certainty.py coverage --quick

Recordings are drawn as `populations` says, from the distributions that the answers assume.

``coverage``     how many intervals of 95 % hold the truth, and how many verdicts are silently wrong
``calibration``  ranks of the truth among draws from the posterior, which are uniform if it is right
``verdicts``     how often a fault is there that has a probability of so much, and how many healthy
                 recordings are called faulty

Each recording and method is a line of ``FOLDER/rows.jsonl``; what is there already is not done
again, so that a run can be stopped and continued, or extended. A line holds the fingerprint of the
code that it was made with, and counts for that code alone, but for ``--stored``. ``--quick`` is a
size for tests.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from joblib import Parallel, delayed

sys.path.insert(0, str(Path(__file__).resolve().parent))

import certainty_answers as answers
import certainty_tables as tables
import ematwin
from populations import KNOWLEDGE, POPULATIONS

QUICK = 2  # recordings
_PARTS = ("estimation", "models", "numerics", "optimizers")  # that answers depend on


class Task(NamedTuple):
    """One recording and what is made of it; arguments of `populations.drawn`, and a method."""

    population: str
    knowledge: str
    fidelity: str
    seed: int
    method: str


class Store:
    """Rows of results, one JSON object a line.

    A last line that was cut off, by a full disk or an end of the power, does not count.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "rows.jsonl"
        self._path.touch()

    def rows(self) -> list[dict[str, Any]]:
        """All rows, in the order in which they came."""
        lines = self._path.read_text(encoding="utf-8").split("\n")
        return [json.loads(line) for line in lines[:-1] if line.endswith("}")]

    def add(self, row: dict[str, Any]) -> None:
        """One row more."""
        start = "" if self._path.read_bytes()[-1:] in (b"", b"\n") else "\n"
        with self._path.open("a", encoding="utf-8") as file:
            file.write(f"{start}{json.dumps(row)}\n")


def task_of(row: dict[str, Any]) -> Task:
    """The task that gave a row."""
    return Task(*(row[name] for name in Task._fields))


def done(task: Task) -> dict[str, Any]:
    """The row of a task."""
    return task._asdict() | answers.judged(*task)


def code() -> str:
    """Fingerprint of the code that gives the answers."""
    package = Path(ematwin.__file__).parent
    files = sorted(file for part in _PARTS for file in (package / part).rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def run(tasks: Sequence[Task], store: Store, workers: int) -> list[dict[str, Any]]:
    """The rows of tasks, those that are missing worked out first."""
    own = code()
    have = {task_of(row) for row in store.rows() if row.get("code") == own}
    missing = [task for task in tasks if task not in have]
    found: Iterable[dict[str, Any]] = map(done, missing)
    if workers > 1:
        found = Parallel(workers, return_as="generator")(delayed(done)(task) for task in missing)
    for n, row in enumerate(found, start=1):
        store.add(row | {"code": own})
        print(f"{n}/{len(missing)}", file=sys.stderr, end="\r", flush=True)
    wanted = set(tasks)
    return [row for row in store.rows() if task_of(row) in wanted and row.get("code") == own]


def tasks_of(given: argparse.Namespace) -> list[Task]:
    """All tasks of an experiment; the first recordings of each part before the next ones."""
    parts = product(given.populations, given.knowledge, given.fidelity, given.methods)
    seeds = range(given.first, given.first + given.records)
    return [Task(*part[:3], seed, part[3]) for seed, part in product(seeds, list(parts))]


def stored(tasks: Sequence[Task], store: Store) -> list[dict[str, Any]]:
    """Rows of an experiment that are there, whatever their seeds."""
    wanted = {task._replace(seed=0) for task in tasks}
    return [row for row in store.rows() if task_of(row)._replace(seed=0) in wanted]


# what each experiment takes unless others are asked for
EXPERIMENTS: dict[str, dict[str, Sequence[str]]] = {
    "coverage": {
        "populations": ("mixture",), "knowledge": ("exact", "drifted"),
        "fidelity": ("monitor", "reference"), "methods": ("laplace", "profile", "posterior"),
    },
    "calibration": {
        "populations": ("middle",), "knowledge": ("exact",), "fidelity": ("monitor",),
        "methods": ("laplace own", "posterior own"),
    },
    "verdicts": {
        "populations": ("healthy", "slight"), "knowledge": ("exact", "drifted"),
        "fidelity": ("reference",), "methods": ("laplace",),
    },
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> str:
    """Run one experiment; gives its tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("experiment", choices=EXPERIMENTS)
    parser.add_argument("--records", type=int, default=200, help="of each part")
    parser.add_argument("--first", type=int, default=1000, help="seed of the first")
    parser.add_argument("--populations", nargs="+", choices=POPULATIONS)
    parser.add_argument("--knowledge", nargs="+", choices=KNOWLEDGE)
    parser.add_argument("--fidelity", nargs="+", choices=("monitor", "reference"))
    parser.add_argument("--methods", nargs="+", choices=answers.METHODS)
    parser.add_argument("--store", type=Path, default=Path("certainty"), help="folder of results")
    parser.add_argument("--figure", type=Path, help="write the picture of the experiment here, SVG")
    parser.add_argument("--stored", action="store_true", help="tables of what is stored, no more")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} recordings")
    given = parser.parse_args(arguments)
    for name, usual in EXPERIMENTS[given.experiment].items():
        setattr(given, name, getattr(given, name) or usual)
    if given.quick:
        given.records = min(given.records, QUICK)
    tasks, store = tasks_of(given), Store(given.store)
    rows = stored(tasks, store) if given.stored else run(tasks, store, given.workers)
    text = tables.TABLES[given.experiment](rows)
    if given.figure is not None:
        given.figure.write_text(tables.FIGURES[given.experiment](rows), encoding="utf-8")
    print(text)
    return text


if __name__ == "__main__":
    main()
