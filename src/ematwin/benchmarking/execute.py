"""Do one run: `RunSpec` in, `Run` out, whatever happens in between.

A plain function of plain values, so that any engine can carry it. It never raises: a search that
raises, takes too long or finds nothing finite is a result too.

A search is limited in time twice. Between two batches the clock is looked at, which ends a slow
method in good order. Behind it a watchdog ends the whole process of one that never comes back;
the engine notices the death and records the run as timed out.

A run searches the box of the faults, or the remapped one. In the plain box of the brushless
actuator six of the eight healthy values lie at the origin, in a corner. Methods that are drawn to
the origin, or that clip at the bounds, find them by that alone. The remapped box is the same set of
vectors turned round: each component is shifted along its range, and what leaves one end enters at
the other. In shares u of the range,

    u = (x - shift) mod 1,    x = (u + shift) mod 1.

The map is one to one and keeps lengths, so that random search cannot tell the boxes apart, and the
cost of a vector is unchanged. A healthy magnitude at the lower bound (u = 0) lies inside, at
x = shift, with u near 1 just below it: no continuous one-to-one map of an interval can bring its
end inside. Methods meet a cliff there where the plain box has a wall. For a direction the shift is
a rotation, without any cliff.
"""

import faulthandler
import json
import math
import os
import platform
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from typing import Any

import numpy as np

from ematwin import __version__
from ematwin.benchmarking.plan import Run, RunSpec, pack
from ematwin.benchmarking.subject import Subject
from ematwin.errors import EmatwinError
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import find, named
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.recordings.noise import Noise


class _TimeUpError(Exception):
    """The search ran past its time limit; caught within this module."""


def hard_limit(time_limit: float) -> float:
    """Seconds after which the watchdog ends a process whose search was to end by itself."""
    return 1.2 * time_limit + 2.0


def execute(spec: RunSpec, time_limit: float | None = None, engine: str = "none") -> Run:
    """Do a run; ``status`` and ``stopped`` say how one ended that failed.

    ``time_limit``, s, is for the search alone; ``engine`` carries it, for the provenance.
    """
    clock = _Clock(time_limit)

    def result(status: str, stopped: str, **found: Any) -> Run:
        return Run(
            spec, status, evaluations=clock.evaluations, seconds=clock.seconds,
            cpu_seconds=clock.cpu_seconds, stopped=stopped, provenance=provenance(engine), **found,
        )  # fmt: skip

    try:
        subject, problem = _prepared(spec)
        with clock.running():
            search = named(spec.algorithm, population=spec.population, iterations=spec.iterations)
            found = find(
                problem if spec.box == "plain" else RemappedProblem(problem), search,
                budget=spec.population * spec.iterations, seed=spec.seed, progress=clock.look,
            )  # fmt: skip
    except _TimeUpError:
        return result("timeout", f"ran past its time limit of {time_limit:g} s")
    except Exception as error:
        if clock.evaluations and not clock.any_finite:
            return result("not finite", f"no finite cost in {clock.evaluations} evaluations")
        kind = "" if isinstance(error, EmatwinError) else f"{type(error).__name__}: "
        return result("failed", f"{kind}{error}")
    pair = subject.values(found.point), subject.values(spec.faults)
    study, faults = subject.model.study, subject.model.faults(subject.actuator)
    clock.evaluations = found.evaluations
    return result(
        "done", str(found.stopped), faults=tuple(found.point.tolist()), cost=float(found.cost),
        relative_misfit=problem.relative_misfit(found.cost),
        err=study.error_percent(faults, *pair),
        err_wrapped=study.error_percent(faults, *pair, wrapped=True),
        history=pack(*found.history.T),
    )  # fmt: skip


class _Clock:
    """Time and evaluations of a search, and its limit."""

    def __init__(self, limit: float | None) -> None:
        self._limit = limit
        self._wall = 0.0
        self.seconds = self.cpu_seconds = math.nan  # before it ran
        self.evaluations = 0
        self.any_finite = False  # some candidate had a finite cost

    @contextmanager
    def running(self) -> Iterator[None]:
        """Measure the block, and end this process if it takes much longer than the limit.

        faulthandler's timer runs outside the interpreter, so that neither a held lock nor compiled
        code keeps it from acting.
        """
        with open(os.devnull, "w") as sink:
            if self._limit is not None:
                faulthandler.dump_traceback_later(hard_limit(self._limit), exit=True, file=sink)
            self._wall, cpu = time.perf_counter(), time.process_time()
            try:
                yield
            finally:
                faulthandler.cancel_dump_traceback_later()
                self.seconds = time.perf_counter() - self._wall
                self.cpu_seconds = time.process_time() - cpu

    def look(self, evaluations: int, cost: float, budget: int) -> None:
        """Note where the search stands; end it if its time is up."""
        self.evaluations = evaluations
        self.any_finite = self.any_finite or math.isfinite(cost)
        if self._limit is not None and time.perf_counter() - self._wall > self._limit:
            raise _TimeUpError


def _prepared(spec: RunSpec) -> tuple[Subject, Problem]:
    """Make the search problem of a run; runs that share a recording share it."""
    # where nothing in a recording is drawn at random, its seed changes nothing
    seeded = spec.noise is not None or _subject(json.dumps(spec.actuator)).model.study.noisy
    seed = spec.record_seed if seeded else 0
    inputs = (spec.actuator, spec.scenario, spec.faults, spec.model, spec.noise, seed)
    return _simulated(json.dumps(inputs))


@lru_cache(maxsize=16)  # runs that share a recording are neighbours in a plan
def _simulated(inputs: str) -> tuple[Subject, Problem]:
    actuator, scenario, faults, fidelity, noise, seed = json.loads(inputs)
    subject = _subject(json.dumps(actuator))
    recording = subject.model.simulate(
        subject.actuator, Scenario.model_validate(scenario), subject.values(faults),
        fidelity=fidelity, noise=None if noise is None else Noise(**noise), seed=seed,
    )  # fmt: skip
    problem = Problem.of(recording, subject.actuator, threads=1)
    problem.costs(np.array([faults]))  # compiles, or loads what was compiled, outside any clock
    return subject, problem


@lru_cache(maxsize=16)
def _subject(actuator: str) -> Subject:
    return Subject.stored(json.loads(actuator))


def shifts(unknowns: Sequence[Unknown]) -> np.ndarray:
    """Shift of each component (d,) that brings its healthy value to its place in the box.

    Places are shares of the range. The first eight are not in a corner, nor in the centre, nor on a
    diagonal; any after them, the n-th, is the fractional part g of n golden ratios, brought into
    0.25 to 0.45 (g < 0.5) or 0.55 to 0.75.
    """
    first = (0.31, 0.64, 0.42, 0.73, 0.27, 0.58, 0.69, 0.37)
    healthy = [(one.healthy - one.lower) / one.width for one in unknowns]
    golden = np.arange(len(first) + 1, len(healthy) + 1) * 0.5 * (math.sqrt(5.0) - 1.0) % 1.0
    places = np.append(first, 0.25 + 0.4 * golden + 0.1 * (golden >= 0.5))[: len(healthy)]
    return np.round(np.mod(places - healthy, 1.0), 12)


class RemappedProblem(Problem):
    """A problem, without unknowns that each recording has for itself, in the remapped box.

    Methods of the box see it turned round. Methods that follow slopes know no box and use the
    variables of the problem; but they start in the middle of the remapped box, not at healthy.
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.comparisons, problem.unknowns, held=problem.held)
        self._shift = shifts(self.unknowns)
        middle = 0.5 * (self.lower + self.upper)
        self.start = self.from_box(middle[None])[0]
        self.starts = self.start[None]

    def from_box(self, points: np.ndarray) -> np.ndarray:
        """Vectors (N, d) from points (N, d) of the remapped box."""
        lower, upper = self.lower, self.upper
        share = np.mod((points - lower) / (upper - lower) - self._shift, 1.0)
        return np.clip(lower + share * (upper - lower), lower, upper)


@cache
def provenance(engine: str) -> dict[str, Any]:
    """Versions and machine of this process."""
    import numba
    import scipy

    return {
        "ematwin": __version__, "python": platform.python_version(), "numpy": np.__version__,
        "scipy": scipy.__version__, "numba": numba.__version__, "machine": socket.gethostname(),
        "processor": _processor(), "system": platform.platform(),
        "kernel": "numba on CPU, one thread", "engine": engine,
    }  # fmt: skip


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as text:
            names = [line.split(":", 1)[1].strip() for line in text if "model name" in line]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()
