"""One run of a study: `RunSpec` -> `RunResult`, plain values and a plain function between them.

The id of a run is a hash of its scientific inputs: what changes the numbers is in it, what does
not (workers, engine, machine) is not. So resuming a study is a set difference, on any engine.
"""

import hashlib
import json
import math
import zlib
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

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
        inputs = {one.name: getattr(self, one.name) for one in fields(self)}
        text = json.dumps({"schema": SCHEMA, **inputs}, sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


@dataclass(frozen=True)
class RunResult:
    """The outcome of a run."""

    id: str  # of its `RunSpec`
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
class StoredRun:
    """A run in a store: its inputs and its outcome."""

    spec: RunSpec
    result: RunResult


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
