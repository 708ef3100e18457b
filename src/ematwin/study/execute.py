"""Do one run: `RunSpec` in, `RunResult` out, whatever happens in between.

A plain function of plain values, so that any engine can carry it. It never raises: a run that
raises, takes too long or finds nothing finite is a result too.

A search is limited in time twice. Between two batches the clock is looked at, which ends a slow
method in good order. Behind it a watchdog ends the whole process of one that never comes back;
the engine notices the death and records the run as timed out.
"""

import faulthandler
import os
import platform
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, lru_cache
from typing import Any

import numpy as np

from ematwin import __version__
from ematwin.errors import EmatwinError
from ematwin.faults import Faults, error_percent, error_percent_wrapped
from ematwin.identification.identify import DEFAULT_ALGORITHM
from ematwin.identification.multistart import MultistartDescent
from ematwin.identification.objective import Objective
from ematwin.identification.space import FaultSpace
from ematwin.optimizers.minimize import minimize
from ematwin.plant.parameters import Actuator
from ematwin.plant.scenario import Scenario
from ematwin.signals.noise import Noise
from ematwin.simulation import simulate
from ematwin.study.box import to_faults
from ematwin.study.history import PackedHistory, pack
from ematwin.study.run import RunResult, RunSpec

_RECORDS = 16  # kept in a worker; runs that share one are neighbours in a plan


class _TimeUpError(Exception):
    """The search ran past its time limit; caught within this module."""


def hard_limit(time_limit: float) -> float:
    """Seconds after which the watchdog ends a process whose search was to end by itself."""
    return 1.2 * time_limit + 2.0


def execute(spec: RunSpec, time_limit: float | None = None, engine: str = "none") -> RunResult:
    """Do a run.

    Parameters
    ----------
    spec : RunSpec
    time_limit : float, s, for the search alone, or None
    engine : name of what carries it, for the provenance

    Returns
    -------
    RunResult
        Also of a run that failed: then ``status`` and ``stopped`` say how.
    """
    origin = provenance(engine)
    search: _Search | None = None
    try:
        objective = _objective(spec)
        search = _Search(objective, spec, time_limit)
        with _watchdog(time_limit):
            k, cost, history, stopped = search.run()
    except _TimeUpError:
        stopped = f"ran past its time limit of {time_limit:g} s"
        return _ended(spec, "timeout", stopped, search, origin)
    except Exception as error:
        if search is not None and search.evaluations and not search.any_finite:
            stopped = f"no finite cost in {search.evaluations} evaluations"
            return _ended(spec, "not finite", stopped, search, origin)
        kind = "" if isinstance(error, EmatwinError) else f"{type(error).__name__}: "
        return _ended(spec, "failed", f"{kind}{error}" or kind, search, origin)
    injected = np.array(spec.faults)
    return RunResult(
        id=spec.id,
        status="done",
        faults=tuple(k.tolist()),
        cost=float(cost),
        relative_misfit=objective.relative_misfit(cost),
        err=float(error_percent(k, injected)),
        err_wrapped=float(error_percent_wrapped(k, injected)),
        evaluations=search.evaluations,
        seconds=search.seconds,
        cpu_seconds=search.cpu_seconds,
        history=PackedHistory(pack(history)),
        stopped=str(stopped),
        provenance=origin,
    )


def warm_up() -> None:
    """Load what a run needs, so that the first one is not slower than the others."""
    from ematwin.kernels import batch  # noqa: F401


class _Search:
    """One search, with its clock, its count and the box that it sees."""

    def __init__(self, objective: Objective, spec: RunSpec, time_limit: float | None) -> None:
        self._objective = objective
        self._spec = spec
        self._limit = time_limit
        self._wall, self._cpu = time.perf_counter(), time.process_time()
        self.seconds = self.cpu_seconds = 0.0
        self.evaluations = 0
        self.any_finite = False

    def run(self) -> tuple[np.ndarray, float, list[tuple[int, float]], str]:
        """Best fault vector (8,), its cost, the way there, and why it ended."""
        spec = self._spec
        budget = spec.population * spec.iterations
        try:
            if spec.algorithm == DEFAULT_ALGORITHM:
                # it knows no box; its first sample is the held vector, which must not be healthy
                # where healthy is to be nowhere special
                centre = to_faults(np.full((1, 8), 0.5), spec.box)[0]
                space = FaultSpace(held=Faults.of(None if spec.box == "plain" else centre))
                descent = MultistartDescent(
                    self._objective, space, budget=budget, seed=spec.seed, report=self._report
                )
                state = descent.run()
                self.any_finite = bool(np.isfinite(state.cost))
                self.evaluations = state.evaluations
                if not self.any_finite:
                    raise ValueError("no finite cost")
                return state.best, state.cost, state.history, state.stopped
            found = minimize(
                self._costs, np.zeros(8), np.ones(8), spec.algorithm, spec.population,
                spec.iterations, spec.seed,
            )  # fmt: skip
            pairs = zip(
                found.history.evaluations.tolist(), found.history.cost.tolist(), strict=True
            )
            best = to_faults(found.x[None], spec.box)[0]
            return best, found.cost, list(pairs), found.stopped
        finally:
            self.seconds = time.perf_counter() - self._wall
            self.cpu_seconds = time.process_time() - self._cpu

    def _costs(self, x: np.ndarray) -> np.ndarray:
        self._check_clock()
        costs = self._objective(to_faults(x, self._spec.box))
        self.evaluations += len(x)
        self.any_finite = self.any_finite or bool(np.isfinite(costs).any())
        return costs

    def _report(self, evaluations: int, cost: float) -> None:
        self.evaluations = evaluations
        self.any_finite = self.any_finite or bool(np.isfinite(cost))
        self._check_clock()

    def _check_clock(self) -> None:
        if self._limit is not None and time.perf_counter() - self._wall > self._limit:
            raise _TimeUpError


def _ended(
    spec: RunSpec, status: str, stopped: str, search: _Search | None, origin: dict[str, Any]
) -> RunResult:
    if search is None:
        return RunResult(spec.id, status, stopped=stopped, provenance=origin)
    return RunResult(
        spec.id,
        status,
        evaluations=search.evaluations,
        seconds=search.seconds,
        cpu_seconds=search.cpu_seconds,
        stopped=stopped,
        provenance=origin,
    )


@contextmanager
def _watchdog(time_limit: float | None) -> Iterator[None]:
    """End this process if the block takes much longer than the limit.

    faulthandler's timer runs outside the interpreter, so that neither a held lock nor compiled
    code keeps it from acting.
    """
    if time_limit is None:
        yield
        return
    with open(os.devnull, "w") as sink:
        faulthandler.dump_traceback_later(hard_limit(time_limit), exit=True, file=sink)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def _objective(spec: RunSpec) -> Objective:
    # without noise the seed of the record changes nothing
    key = (spec.faults, spec.record_seed if spec.noise else None, spec.model)
    return _kept(key, _Setting(spec))


class _Setting:
    """What a record needs besides its key; equal where the values are, so that it can be a key."""

    def __init__(self, spec: RunSpec) -> None:
        self.spec = spec
        self._text = repr((spec.actuator, spec.scenario, spec.noise))

    def __hash__(self) -> int:
        return hash(self._text)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Setting) and self._text == other._text


@lru_cache(maxsize=_RECORDS)
def _kept(key: tuple[Any, ...], setting: _Setting) -> Objective:
    faults, seed, model = key
    spec = setting.spec
    actuator = Actuator.model_validate(spec.actuator)
    record = simulate(
        model,
        Scenario.model_validate(spec.scenario),
        Faults.of(np.array(faults)),
        actuator,
        noise=None if spec.noise is None else Noise(**spec.noise),
        seed=seed or 0,
    )
    objective = Objective(record, actuator, threads=1)
    objective(np.array([faults]))  # compiles, or loads what was compiled, outside any clock
    return objective


@cache
def provenance(engine: str) -> dict[str, Any]:
    """Versions, machine and kernel backend of this process."""
    import numba
    import scipy

    return {
        "ematwin": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
        "machine": socket.gethostname(),
        "processor": _processor(),
        "system": platform.platform(),
        "kernel": "numba on CPU, one thread",
        "engine": engine,
    }


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as text:
            names = [line.split(":", 1)[1].strip() for line in text if "model name" in line]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()
