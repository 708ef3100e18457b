"""Run a study: do the runs that are missing in its store, save each as it comes back.

Stopping at any moment loses at most the runs in flight. Several of these may work on one store at
once, on one machine or many: each run is claimed before it is begun.
"""

import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from ematwin.comparison.study.engines.base import Engine
from ematwin.comparison.study.plan import Plan
from ematwin.comparison.study.run import RunSpec, StoredRun
from ematwin.comparison.study.store import LEASE, Store
from ematwin.errors import EmatwinError

_TICK = 0.5  # s between two looks around while nothing comes back
_ASK_AGAIN = 1.0  # s between two looks at runs that another process claimed


@dataclass
class Tally:
    """Where a study stands.

    Attributes
    ----------
    planned : int, runs of the plan
    found : int, of those, in the store before
    finished : int, by this process
    elsewhere : int, by other processes meanwhile
    counts : statuses and how many of the plan's runs ended so
    seconds : float, since the start
    """

    planned: int
    found: int = 0
    finished: int = 0
    elsewhere: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def complete(self) -> int:
        """Runs of the plan that are in the store."""
        return self.found + self.finished + self.elsewhere


Progress = Callable[[Tally], None]


def compare(
    plan: Plan,
    store: Store,
    engine: Engine,
    *,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> Tally:
    """Do all runs of a plan that its store does not hold.

    Parameters
    ----------
    plan : Plan
    store : Store, new, or of the same study
    engine : Engine, not started
    retry_failed : also do again what ended otherwise than done
    progress : called after each change

    Returns
    -------
    Tally

    Raises
    ------
    FileError
        If the store holds another study, or cannot be written.
    EngineError
        If the engine cannot be reached or was lost; what is finished is in the store.
    """
    specs = plan.specs()
    settings = plan.settings()
    store.check(settings)
    try:
        engine.start()  # before the store is made: a wrong address shall leave nothing behind
        store.begin(settings)
        work = _Work(specs, store, engine, retry_failed, progress or (lambda tally: None))
        return work.run()
    finally:
        engine.close()


class _Work:
    """The loop between plan, store and engine."""

    def __init__(
        self,
        specs: list[RunSpec],
        store: Store,
        engine: Engine,
        retry: bool,
        progress: Progress,
    ) -> None:
        self._specs = {spec.id: spec for spec in specs}
        self._store = store
        self._engine = engine
        self._retry = retry
        self._report = progress
        self._started = self._renewed = self._asked = time.monotonic()
        statuses = store.statuses()
        kept = {"done"} if retry else None  # None: any
        self._missing = deque(
            id
            for id in self._specs
            if id not in statuses or (kept is not None and statuses[id] not in kept)
        )
        self._ready: deque[str] = deque()  # claimed, not begun
        self._held: dict[str, None] = {}  # claimed by others when we asked
        self.tally = Tally(len(self._specs), found=len(self._specs) - len(self._missing))

    def run(self) -> Tally:
        """Claim, begin, save, until nothing is missing."""
        self._told()
        try:
            while self._missing or self._ready or self._held or self._engine.busy:
                self._feed()
                results = self._engine.finished(_TICK if self._engine.busy else 0.0)
                self._feed(claimed_only=True)  # before the books: no process shall wait for them
                if results:
                    self._store.save([StoredRun(self._specs[r.id], r) for r in results])
                    self.tally.finished += len(results)
                    self._told()
                self._renew()
                if self._held:
                    self._ask_again()
        finally:
            with suppress(EmatwinError):  # the claims lapse by themselves
                self._store.release()
        statuses = self._store.statuses()
        for id in self._specs:
            status = statuses[id]
            self.tally.counts[status] = self.tally.counts.get(status, 0) + 1
        return self.tally

    def _feed(self, claimed_only: bool = False) -> None:
        """Begin runs while there are free places, and claim the next ones ahead."""
        while self._engine.free and self._ready:
            self._engine.submit(self._specs[self._ready.popleft()])
        if claimed_only:
            return
        # as many ahead as are in flight, so that a finished run's place is taken without asking
        while self._missing and len(self._ready) < max(1, self._engine.busy):
            count = max(self._engine.free, self._engine.busy, 1)
            asked = [self._missing.popleft() for _ in range(min(count, len(self._missing)))]
            ours = self._store.claim(asked, self._retry)
            for id in asked:
                if id in ours:
                    self._ready.append(id)
                else:
                    self._held[id] = None
            while self._engine.free and self._ready:
                self._engine.submit(self._specs[self._ready.popleft()])

    def _ask_again(self) -> None:
        """What others claimed: count what they finished, take over what they left."""
        now = time.monotonic()
        idle = not (self._engine.busy or self._ready or self._missing)
        pause = _ASK_AGAIN if idle else 10.0 * _ASK_AGAIN
        if now - self._asked < pause:
            if idle:
                time.sleep(pause - (now - self._asked))
            else:
                return
        self._asked = time.monotonic()
        statuses = self._store.statuses()
        for id in list(self._held):
            status = statuses.get(id)
            if status is not None and (not self._retry or status == "done"):
                del self._held[id]
                self.tally.elsewhere += 1
        if idle and self._held:
            # a few at a time: other processes that wait shall get their share
            few = list(self._held)[: max(1, self._engine.free)]
            ours = self._store.claim(few, self._retry)
            for id in ours:
                del self._held[id]
                self._ready.append(id)
            for id in few:
                if id in self._held:  # to the back of the line
                    del self._held[id]
                    self._held[id] = None
        self._told()

    def _renew(self) -> None:
        if time.monotonic() - self._renewed > LEASE / 4.0:
            self._store.renew()
            self._renewed = time.monotonic()

    def _told(self) -> None:
        self.tally.seconds = time.monotonic() - self._started
        self._report(self.tally)
