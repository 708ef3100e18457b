"""Commands tried before one of them is chosen.

A promise is linear: it knows nothing of valleys that impacts and stiction make, nor of parameters
far from those of the file, and a search finds the command on which it is too good. So `identify`
answers simulated recordings of the few most promising commands and of the given one, all of the
same actuators. A few recordings are luck as well: the given one stays unless another promises
clearly less and errs clearly less.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.observed import observe
from ematwin.estimation.promise import Judge, Judged

TRIALS = 8  # recordings of each command: its root mean square error is known to a fifth
TRIED = 3  # commands beside the given one
CLEARLY = 1.1  # times less that another command has to promise, and to err


@dataclass(frozen=True)
class Tried:
    """A command, with the errors of `identify` on simulated recordings of it.

    Attributes
    ----------
    judged : the command and what it promises
    errors : (n,) array, root mean square of each magnitude; empty if none was identified
    recordings : how many were
    """

    judged: Judged
    errors: np.ndarray
    recordings: int

    def observed(self, names: Sequence[str]) -> dict[str, float]:
        """Errors by name; empty if none was identified."""
        if not self.recordings:
            return {}
        return {name: float(error) for name, error in zip(names, self.errors, strict=True)}


def tried(
    judge: Judge,
    commands: Sequence[Judged],
    recordings: int,
    seed: int,
    progress: Callable[[float], object] | None = None,
) -> list[Tried]:
    """Each command with the errors on its recordings; fewer recordings after Ctrl-C.

    ``progress`` is called with the share done.
    """
    scenarios = [one.scenario for one in commands]
    found = observe(judge, scenarios, recordings, seed=seed, progress=progress)
    if not len(found):
        return [Tried(one, np.empty(0), 0) for one in commands]
    rms = np.sqrt((found**2).mean(axis=0))
    return [Tried(one, errors, len(found)) for one, errors in zip(commands, rms, strict=True)]


def best_of(
    given: Tried | None, others: Sequence[Tried], worst: Callable[[np.ndarray], float]
) -> Tried:
    """The command that erred least; the given one unless another erred clearly less.

    Parameters
    ----------
    given : None if it cannot be used
    others : the most promising first; at least one if ``given`` is None
    worst : errors (n,) -> the one that counts
    """
    counted = [one for one in (given, *others) if one is not None]
    if not all(one.recordings for one in counted):  # the promise is all there is
        return min(counted, key=lambda one: worst(one.judged.errors))
    best = min(counted, key=lambda one: worst(one.errors))
    if given is not None and CLEARLY * worst(best.errors) > worst(given.errors):
        return given
    return best
