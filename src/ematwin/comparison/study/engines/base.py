"""What an engine promises."""

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass

from ematwin.comparison.study.run import RunResult, RunSpec
from ematwin.errors import EmatwinError

DEATHS = 3  # of its process, after which a run may be taken to be the cause
PATIENCE = 60.0  # s for which what is lost is tried again: a busy machine needs as long
_PAUSES = (0.5, 10.0)  # s, of the first trial and of the last


class EngineError(EmatwinError):
    """An engine cannot be reached, or was lost in the middle of a study."""


@dataclass
class Trials:
    """How often something failed in a row, since when, and when it is due again.

    Attributes
    ----------
    failures : int
    since : float, of the monotonic clock, s, when it failed first
    due : float, likewise, when it may be tried again; each pause is twice the one before
    """

    failures: int = 0
    since: float = 0.0
    due: float = 0.0

    def failed(self) -> None:
        """Count a failure."""
        now = time.monotonic()
        self.since = self.since if self.failures else now
        self.due = now + min(_PAUSES[0] * 2.0**self.failures, _PAUSES[1])
        self.failures += 1

    @property
    def is_due(self) -> bool:
        """Whether it may be tried now."""
        return time.monotonic() >= self.due

    def over(self, patience: float) -> bool:
        """Whether it failed often enough, for long enough, to be given up."""
        return self.failures >= DEATHS and time.monotonic() - self.since >= patience


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


def gave_up(
    spec: RunSpec, engine: str, time_limit: float | None, overdue: bool, deaths: int = DEATHS
) -> RunResult:
    """The result of a run whose process died each time, or was ended by the watchdog."""
    if overdue:
        text = f"ran past its time limit of {time_limit:g} s and did not answer; process ended"
        return RunResult(spec.id, "timeout", stopped=text, provenance={"engine": engine})
    text = f"its process died {deaths} times"
    return RunResult(spec.id, "failed", stopped=text, provenance={"engine": engine})
