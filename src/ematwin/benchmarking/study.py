"""Run a study: do the runs that are missing in its store, save each as it comes back.

Stopping at any moment loses at most the runs in flight. Several of these may work on one store at
once, on one machine or many: each run is claimed before it is begun.
"""

import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from ematwin.benchmarking.engine import Engine
from ematwin.benchmarking.plan import Plan
from ematwin.benchmarking.store import LEASE, Store
from ematwin.errors import EmatwinError


@dataclass
class Tally:
    """Progress of a study."""

    planned: int  # runs of the plan
    found: int = 0  # of those, in the store before
    finished: int = 0  # by this process
    elsewhere: int = 0  # by other processes meanwhile
    # statuses and how many of the plan's runs ended so
    counts: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0  # since the start

    @property
    def complete(self) -> int:
        """Runs of the plan that are in the store."""
        return self.found + self.finished + self.elsewhere


Progress = Callable[[Tally], None]


def run_study(
    plan: Plan,
    store: Store,
    engine: Engine,
    *,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> Tally:
    """Do all runs of a plan that its store, new or of the same study, does not hold.

    ``engine`` is not started; ``retry_failed``: also do again what ended otherwise than done;
    ``progress`` is called after each change. Where the engine is lost (`EngineError`), finished
    runs are in the store.
    """
    settings = plan.settings()
    store.check(settings)
    try:
        engine.start()  # before the store is made: a wrong address shall leave nothing behind
        store.begin(settings)
        return _Work(plan, store, engine, retry_failed, progress).run()
    finally:
        engine.close()


class _Work:
    """The loop between plan, store and engine."""

    def __init__(
        self, plan: Plan, store: Store, engine: Engine, retry: bool, progress: Progress | None
    ) -> None:
        self._specs = {spec.id: spec for spec in plan.specs()}
        self._store = store
        self._engine = engine
        self._retry = retry
        self._progress = progress
        self._started = self._renewed = self._asked = time.monotonic()
        statuses = store.statuses()
        self._missing = deque(id for id in self._specs if not self._settled(statuses.get(id)))
        self._ready: deque[str] = deque()  # claimed, not begun
        self._held: list[str] = []  # claimed by others when we asked
        self.tally = Tally(len(self._specs), found=len(self._specs) - len(self._missing))

    def run(self) -> Tally:
        """Claim, begin, save, until nothing is missing."""
        self._report()
        try:
            while self._missing or self._ready or self._held or self._engine.busy:
                self._begin_runs()
                results = self._engine.finished(0.5)  # s, while nothing comes back
                self._begin_runs(ask=False)  # before the books: no process shall wait for them
                if results:
                    self._store.save(results)
                    self.tally.finished += len(results)
                    self._report()
                if time.monotonic() - self._renewed > LEASE / 4.0:
                    self._store.renew()
                    self._renewed = time.monotonic()
                if self._held and not self._missing:
                    self._look_at_held()
        finally:
            with suppress(EmatwinError):  # the claims lapse by themselves
                self._store.release()
        statuses = self._store.statuses()
        self.tally.counts = dict(Counter(statuses[id] for id in self._specs))
        return self.tally

    def _settled(self, status: str | None) -> bool:
        return status == "done" if self._retry else status is not None

    def _begin_runs(self, ask: bool = True) -> None:
        """Begin runs while there are free places; claim as many ahead as are in flight."""
        while True:
            while self._engine.free and self._ready:
                self._engine.submit(self._specs[self._ready.popleft()])
            if not (ask and self._missing and len(self._ready) < max(1, self._engine.busy)):
                return
            count = min(max(self._engine.free, self._engine.busy, 1), len(self._missing))
            asked = [self._missing.popleft() for _ in range(count)]
            ours = self._store.claim(asked, self._retry)
            self._ready.extend(id for id in asked if id in ours)
            self._held.extend(id for id in asked if id not in ours)

    def _look_at_held(self) -> None:
        """Count what others finished of their claims, and ask for the rest again."""
        if time.monotonic() - self._asked < 1.0:  # s
            return
        self._asked = time.monotonic()
        statuses = self._store.statuses()
        left = [id for id in self._held if not self._settled(statuses.get(id))]
        self.tally.elsewhere += len(self._held) - len(left)
        self._held = []
        self._missing.extend(left)
        self._report()

    def _report(self) -> None:
        self.tally.seconds = time.monotonic() - self._started
        if self._progress is not None:
            self._progress(self.tally)
