"""The promise of an engine."""

from abc import ABC, abstractmethod

from ematwin.benchmarking.run import RunResult, RunSpec
from ematwin.errors import EmatwinError

PATIENCE = 60.0  # s for which workers that are gone are waited for: a busy machine needs as long


class EngineError(EmatwinError):
    """An engine cannot be reached, or was lost in the middle of a study."""


class Engine(ABC):
    """Carries runs to processes that do them, each run on one thread, for ``time_limit`` s or None.

    An engine is given as many runs as it has `free` places, so that a run begins when it is
    submitted. A process that dies takes no run with it: the run is done again, unless it is the
    run that kills. Workers that are gone are waited for, ``patience`` s.
    """

    name: str

    def __init__(self, time_limit: float | None = None, patience: float = PATIENCE) -> None:
        self._limit = time_limit
        self._patience = patience

    @abstractmethod
    def start(self) -> None:
        """Make ready, or raise `EngineError`."""

    @property
    @abstractmethod
    def free(self) -> int:
        """Runs that could begin now."""

    @property
    @abstractmethod
    def busy(self) -> int:
        """Runs that were submitted and have not come back."""

    @abstractmethod
    def submit(self, spec: RunSpec) -> None:
        """Begin a run."""

    @abstractmethod
    def finished(self, timeout: float) -> list[RunResult]:
        """Give results that have come back; wait up to ``timeout`` s for the first."""

    @abstractmethod
    def close(self) -> None:
        """End all processes that the engine started, at once."""

    def _given_up(self, spec: RunSpec, overdue: bool) -> RunResult:
        """The result of a run whose process died each time, or was ended by the watchdog."""
        status, said = "failed", "its process died each time that it was tried"
        if overdue:
            status = "timeout"
            said = f"ran past its time limit of {self._limit:g} s and did not answer; process ended"
        return RunResult(spec.id, status, stopped=said, provenance={"engine": self.name})
