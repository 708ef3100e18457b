"""A study before it runs: what is compared, and the list of runs that follows from it.

The same seed gives the same runs. Each run's seed is drawn from the seed of the study and the names
of its case and algorithm, so that more cases, algorithms or runs leave the others as they were.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ematwin.errors import InputError, MissingExtraError
from ematwin.identification.identify import DEFAULT_ALGORITHM
from ematwin.identification.multistart import SMALLEST_BUDGET
from ematwin.optimizers.catalogue import EXTRA
from ematwin.optimizers.registry import find
from ematwin.plant.parameters import Actuator
from ematwin.plant.recorded import recorded_columns
from ematwin.plant.scenario import Profile, Scenario
from ematwin.signals.noise import Noise
from ematwin.simulation import check_seed
from ematwin.study.box import check_box
from ematwin.study.cases import Cases
from ematwin.study.run import RunSpec

PAPER_ALGORITHMS = ("ga", "pso", "de", "gwo", "da", "woa")


@dataclass(frozen=True)
class Plan:
    """What a study compares.

    Parameters
    ----------
    cases : mapping of names to fault vectors
    algorithms : names of ``ematwin algorithms``, or "multistart"; aliases become names
    runs : int, repetitions of each case with each algorithm
    population, iterations : int; their product is the budget of each run
    seed : int
    noise : of the current sensor, or None
    box : "plain" or "remapped", see `ematwin.study.box`
    actuator, scenario : of the records

    Raises
    ------
    InputError
        If an algorithm is unknown or a number cannot be used.
    MissingExtraError
        If an algorithm's library is not installed.
    """

    cases: Cases
    algorithms: tuple[str, ...] = PAPER_ALGORITHMS
    runs: int = 10
    population: int = 50
    iterations: int = 200
    seed: int = 1
    noise: Noise | None = None
    box: str = "plain"
    actuator: Actuator = field(default_factory=Actuator.load)
    scenario: Scenario = field(default_factory=Scenario.load_file)

    def __post_init__(self) -> None:
        for name, value in [
            ("runs", self.runs), ("population", self.population), ("iterations", self.iterations)
        ]:  # fmt: skip
            if value < 1:
                raise InputError(f"The number of {name} must be at least 1, received {value}.")
        check_seed(self.seed)
        check_box(self.box)
        self.scenario.check(self.actuator)
        names = tuple(dict.fromkeys(_algorithm(name) for name in self.algorithms))
        if not names or not self.cases:
            raise InputError("A study needs at least one case and one algorithm.")
        budget = self.population * self.iterations
        if DEFAULT_ALGORITHM in names and budget < SMALLEST_BUDGET:
            raise InputError(
                f"{DEFAULT_ALGORITHM} needs a budget (population times iterations) of at least "
                f"{SMALLEST_BUDGET}, received {budget}."
            )
        object.__setattr__(self, "algorithms", names)
        object.__setattr__(self, "scenario", _self_contained(self.scenario))

    def settings(self) -> dict[str, Any]:
        """What all runs of a study share, and what therefore identifies it, as plain values."""
        values = {
            "seed": int(self.seed),
            "population": self.population,
            "iterations": self.iterations,
            "noise": None if self.noise is None else asdict(self.noise),
            "box": self.box,
            "actuator": self.actuator.model_dump(mode="json"),
            "scenario": self.scenario.model_dump(mode="json"),
            "model": "reference",
        }
        plain: dict[str, Any] = json.loads(json.dumps(values))
        return plain

    def specs(self) -> list[RunSpec]:
        """All runs; those that share a record stand together, so that workers simulate it once."""
        shared = self.settings()
        seed = shared.pop("seed")
        records = {
            (case, run): derived_seed(seed, "record", case, run)
            for case in self.cases
            for run in range(self.runs)
        }
        return [
            RunSpec(
                case=case,
                faults=faults,
                algorithm=algorithm,
                run=run,
                seed=derived_seed(seed, "search", case, algorithm, run),
                record_seed=records[case, run],
                **shared,
            )
            for case, faults in self.cases.items()
            for run in range(self.runs)
            for algorithm in self.algorithms
        ]


def derived_seed(seed: int, *names: str | int) -> int:
    """A seed of 32 bits that depends on ``seed`` and on all of ``names``."""
    digest = hashlib.sha256(json.dumps(names).encode()).digest()
    return int(np.random.SeedSequence([seed, *digest]).generate_state(1, np.uint32)[0])


def _self_contained(scenario: Scenario) -> Scenario:
    """The scenario with recorded files read: another machine does not have them."""

    def read(part: Any) -> Any:
        if not (isinstance(part, Profile) and part.file is not None and part.column is not None):
            return part
        columns = recorded_columns(
            part.file, {"time": ("s",), part.column: ("rad", "N*m")}, optional={}
        )
        since = columns["time"] - columns["time"][0]
        return Profile(time=since.tolist(), value=columns[part.column].tolist())

    histories = {
        name: [read(part) for part in getattr(scenario, name)] for name in ("command", "load")
    }
    return scenario.model_copy(update=histories)


def _algorithm(text: str) -> str:
    if text.strip().lower() == DEFAULT_ALGORITHM:
        return DEFAULT_ALGORITHM
    found = find(text)
    if not found.installed:
        raise MissingExtraError(str(found.requires), EXTRA, f"The algorithm {found.name!r}")
    return found.name
