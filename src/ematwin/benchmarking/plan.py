"""Plan of a study: cases, methods and settings, and the list of runs that follows from them.

The same seed gives the same runs. Each run's seed is drawn from the seed of the study and the names
of its case and algorithm, so that more cases, algorithms or runs leave the others as they were.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ematwin.benchmarking.run import RunSpec
from ematwin.benchmarking.subject import Cases, Subject
from ematwin.errors import InputError
from ematwin.estimation.search import expanded, named
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Profile, Scenario
from ematwin.models.simulating import check_seed
from ematwin.recordings.noise import Noise


@dataclass(frozen=True)
class Plan:
    """Cases, methods and settings of a study, checked and completed."""

    cases: Cases  # vectors (d,) of the actuator's faults and nuisances, by name
    # names of ``ematwin algorithms``, or presets: paper, improved, best; aliases become names
    algorithms: tuple[str, ...] = ("paper",)
    runs: int = 10  # repetitions of each case with each algorithm
    population: int = 50  # times iterations it is the budget of each run
    iterations: int = 200
    seed: int = 1
    noise: Noise | None = None  # of the current sensor
    box: str = "plain"  # "plain" or "remapped", see `ematwin.benchmarking.box`
    # of any kind, or the name of one; None takes the default brushless actuator
    actuator: ParameterSet | str | None = None
    scenario: Scenario | str | None = None  # of the recordings; None takes the default of the kind

    def __post_init__(self) -> None:
        for name in ("runs", "population", "iterations"):
            if (value := getattr(self, name)) < 1:
                raise InputError(f"The number of {name} must be at least 1, received {value}.")
        check_seed(self.seed)
        if self.box not in ("plain", "remapped"):
            raise InputError(f"There is no box {self.box!r}; choose plain or remapped.")
        subject = Subject.of(self.actuator)
        scenario = subject.model.load_scenario(self.scenario)
        subject.model.check_scenario(scenario, subject.actuator)
        names = expanded(self.algorithms)
        if not names or not self.cases:
            raise InputError("A study needs at least one case and one algorithm.")
        for case, vector in self.cases.items():
            if len(vector) != len(subject.names):
                raise InputError(
                    f"Case {case!r} has {len(vector)} values, but {subject.actuator.name} has "
                    f"{len(subject.names)}: {', '.join(subject.names)}."
                )
        budget = self.population * self.iterations
        for name in names:
            smallest = named(name).smallest_budget
            if budget < smallest:
                raise InputError(
                    f"{name} needs a budget (population times iterations) of at least "
                    f"{smallest}, received {budget}."
                )
        object.__setattr__(self, "algorithms", names)
        object.__setattr__(self, "actuator", subject.actuator)
        object.__setattr__(self, "scenario", _self_contained(scenario))

    def settings(self) -> dict[str, Any]:
        """What all runs of a study share, and what therefore identifies it, as plain values."""
        subject = Subject.of(self.actuator)
        assert isinstance(self.scenario, Scenario)
        values = {
            "seed": int(self.seed), "population": self.population, "iterations": self.iterations,
            "noise": None if self.noise is None else asdict(self.noise), "box": self.box,
            "actuator": subject.plain(), "scenario": self.scenario.model_dump(mode="json"),
            "model": subject.model.fidelities[0],
        }  # fmt: skip
        return json.loads(json.dumps(values))

    def specs(self) -> list[RunSpec]:
        """All runs; those that share a record stand together, so that workers simulate it once."""
        shared = self.settings()
        seed = shared.pop("seed")
        return [
            RunSpec(
                case, faults, algorithm, run,
                seed=derived_seed(seed, "search", case, algorithm, run),
                record_seed=derived_seed(seed, "record", case, run), **shared,
            )
            for case, faults in self.cases.items()
            for run in range(self.runs)
            for algorithm in self.algorithms
        ]  # fmt: skip


def derived_seed(seed: int, *names: str | int) -> int:
    """A seed of 32 bits that depends on ``seed`` and on all of ``names``."""
    digest = hashlib.sha256(json.dumps(names).encode()).digest()
    return int(np.random.SeedSequence([seed, *digest]).generate_state(1, np.uint32)[0])


def _self_contained(scenario: Scenario) -> Scenario:
    """The scenario with recorded files read: another machine does not have them."""

    def read(part: Any) -> Any:
        if not (isinstance(part, Profile) and part.file is not None):
            return part
        since, value = part.points()
        return Profile(time=since.tolist(), value=value.tolist())

    histories = {
        name: [read(part) for part in getattr(scenario, name)] for name in ("command", "load")
    }
    return scenario.model_copy(update=histories)
