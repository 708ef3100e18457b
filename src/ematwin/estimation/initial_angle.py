"""Estimate the initial rotor angle of a recording that does not state it.

A short in one phase looks like a short in another where the twin's rotor stands a third of a turn
off, and the conducting phases show where it stands only beside a twin that moves as recorded.
So the kind's default search is run, the recording is counted from the rotor angle that its answer
shows, and again, until nothing is left to turn (`Comparison.placed`).
"""

from collections.abc import Callable
from dataclasses import dataclass

from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Progress, Search, find
from ematwin.recordings.recording import Recording

_UNSETTLED = (
    "Where the rotor stands could not be told from the phases that conduct, so no fault can be put "
    "to a phase: record motor_position."
)


@dataclass(frozen=True)
class InitialAngle:
    """A recording that is counted as its twin counts.

    Attributes
    ----------
    recording : Recording
    problem : of it
    found : result of the default search there; None where none was needed
    said : sentences on the turns applied
    obstacles : sentences on why it cannot be placed
    """

    recording: Recording
    problem: Problem
    found: Found | None = None
    said: tuple[str, ...] = ()
    obstacles: tuple[str, ...] = ()


def estimate_initial_angle(
    recording: Recording,
    problem: Problem,
    problem_of: Callable[[Recording], Problem],
    search: Search,
    *,
    seed: int,
    progress: Progress | None,
) -> InitialAngle:
    """Count rotor angles of a recording as the twin does.

    ``search`` should be quick.
    """
    if not problem.comparisons[0].unplaced:
        return InitialAngle(recording, problem)
    said: tuple[str, ...] = ()
    for _ in range(4):  # at most; one or two are usual
        found = find(problem, search, seed=seed, progress=progress)
        if found.stopped == "interrupted":
            break
        placed = problem.comparisons[0].placed(problem.values(found.point))
        if placed is None:
            break
        if placed.recording is None:
            return InitialAngle(recording, problem, found, said, (placed.said,))
        recording, said = placed.recording, (placed.said,)
        problem = problem_of(recording)
    else:
        return InitialAngle(recording, problem, None, said, (_UNSETTLED,))
    return InitialAngle(recording, problem, found, said)
