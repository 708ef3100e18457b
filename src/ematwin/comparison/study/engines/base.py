"""What an engine promises."""

from abc import ABC, abstractmethod

from ematwin.comparison.study.run import RunResult, RunSpec
from ematwin.errors import EmatwinError

DEATHS = 3  # of its process, after which a run is taken to be the cause


class EngineError(EmatwinError):
    """An engine cannot be reached, or was lost in the middle of a study."""


class Engine(ABC):
    """Carries runs to processes that do them, each run on one thread.

    An engine is given as many runs as it has `free` places, so that a run begins when it is
    submitted. A process that dies takes no run with it: the run is done again, unless it is the
    run that kills.
    """

    name: str

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
        """Results that have come back; waits up to ``timeout`` s for the first.

        Raises
        ------
        EngineError
            If the engine was lost.
        """

    @abstractmethod
    def close(self) -> None:
        """End all processes that the engine started, at once."""


def gave_up(spec: RunSpec, engine: str, time_limit: float | None, overdue: bool) -> RunResult:
    """The result of a run whose process died each time, or was ended by the watchdog."""
    if overdue:
        text = f"ran past its time limit of {time_limit:g} s and did not answer; process ended"
        return RunResult(spec.id, "timeout", stopped=text, provenance={"engine": engine})
    text = f"its process died {DEATHS} times"
    return RunResult(spec.id, "failed", stopped=text, provenance={"engine": engine})
