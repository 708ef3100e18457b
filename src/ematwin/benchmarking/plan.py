"""Plan of a study, and the runs that follow from it: plain values in, plain values out.

The id of a run is a hash of its scientific inputs: what changes the numbers is in it, what does
not (workers, engine, machine) is not. So resuming a study is a set difference, on any engine.

The same seed gives the same runs. Each run's seed is drawn from the seed of the study and the names
of its case and algorithm, so that more cases, algorithms or runs leave the others as they were.
"""

import hashlib
import json
import math
import zlib
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ematwin.benchmarking.subject import Cases, Subject
from ematwin.errors import InputError, whole_number
from ematwin.estimation.search import expanded, named
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Profile, Scenario
from ematwin.recordings.noise import Noise

SCHEMA = 1  # of the hashed inputs; part of every id
SHARED = ("population", "iterations", "noise", "actuator", "scenario", "box", "model")
"""Names of the inputs that all runs of a study share."""


@dataclass(frozen=True)
class RunSpec:
    """Everything that determines the numbers of a run."""

    case: str  # name of the case, e.g. "Low F"
    faults: tuple[float, ...]  # (d,), injected values of the actuator's faults and nuisances
    algorithm: str  # a name of ``ematwin algorithms``
    run: int  # repetition within case and algorithm, from 0
    seed: int  # of the search
    population: int
    iterations: int
    noise: dict[str, Any] | None  # fields of `Noise`
    record_seed: int  # of the sensor noise: the same for all algorithms of a case and repetition
    actuator: dict[str, Any]  # all parameters in SI (`ematwin.benchmarking.subject.Subject.plain`)
    scenario: dict[str, Any]  # `Scenario.model_dump`
    # "plain", or "remapped": the search box moved so that healthy lies nowhere special
    box: str = "plain"
    # the model of its kind that makes the recording, "reference" for the brushless actuator
    model: str = "reference"

    @cached_property
    def id(self) -> str:
        """Hash of the inputs, 24 hexadecimal digits."""
        inputs = {"schema": SCHEMA} | {name: getattr(self, name) for name in self.__match_args__}
        text = json.dumps(inputs, sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Run:
    """A run that has ended: its inputs and its outcome."""

    spec: RunSpec
    status: str  # "done", "failed" (raised), "timeout" or "not finite"
    faults: tuple[float, ...] = ()  # (d,), found, empty unless done
    cost: float = math.nan  # cost, relative_misfit: NaN unless done
    relative_misfit: float = math.nan
    # err, err_wrapped: Err% of the kind, and with directions taken as angles; NaN unless done
    err: float = math.nan
    err_wrapped: float = math.nan
    evaluations: int = 0
    seconds: float = math.nan  # seconds, cpu_seconds: wall and CPU time of the search alone
    cpu_seconds: float = math.nan
    history: bytes = b""  # evaluations and best cost after each batch, as `pack` gives them
    stopped: str = ""  # reason of the search, or the message of the failure
    provenance: dict[str, Any] = field(default_factory=dict)  # versions, machine, engine


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
    box: str = "plain"  # "plain" or "remapped", see `ematwin.benchmarking.execute`
    # of any kind, or the name of one; None takes the default brushless actuator
    actuator: ParameterSet | str | None = None
    scenario: Scenario | str | None = None  # of the recordings; None takes the default of the kind

    def __post_init__(self) -> None:
        for name, least in {"runs": 1, "population": 1, "iterations": 1, "seed": 0}.items():
            count = whole_number(getattr(self, name), name, least)
            object.__setattr__(self, name, count)
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


def pack(evaluations: Any, costs: Any) -> bytes:
    """Compress a convergence history, exact to the last bit.

    A store of 100,000 runs holds some twenty million pairs. Differences of the (B,) evaluations
    and the bytes of one rank side by side pack three times as well as the plain arrays.
    """
    steps = np.diff(np.asarray(evaluations, "<i8"), prepend=0)
    words = np.concatenate([steps.view("<u8"), np.asarray(costs, "<f8").view("<u8")])
    by_rank = words.view(np.uint8).reshape(-1, 8).T.copy()
    return zlib.compress(by_rank.tobytes(), 6)


def unpack(packed: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Give the evaluations (B,) int64 and best costs (B,) float64 of a packed history."""
    raw = zlib.decompress(packed) if packed else b""
    words = np.frombuffer(raw, np.uint8).reshape(8, -1).T.copy().view("<u8").ravel()
    steps, costs = np.split(words, 2)
    return np.cumsum(steps.view("<i8")), costs.view("<f8")
