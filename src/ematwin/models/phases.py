"""Phases of a recording: motions of the command, each with a transient and a steady part.

A stretch of constant commanded speed is a transient until the actuator has settled, and steady
from then on. A command without such stretches is cut into equal parts.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

_SAME = 0.02  # of the largest commanded speed: differences below are none
_EQUAL_PARTS = 8


@dataclass(frozen=True)
class Phase:
    """A part of a recording."""

    name: str  # e.g. "out", "rest", "back", numbered where one comes again
    steady: bool  # the transient is over
    samples: slice

    @property
    def title(self) -> str:
        """Name for tables: "out, steady"."""
        return f"{self.name}, {'steady' if self.steady else 'transient'}"


def phases(command: np.ndarray, interval: float, settling_time: float) -> list[Phase]:
    """The phases of a command (S,), sampled each ``interval`` s.

    ``settling_time`` is from a change of the commanded speed to steady motion, s.
    """
    speed = np.diff(command, prepend=command[0])
    speed[0] = speed[1]
    largest = float(np.abs(speed).max())
    changes = np.flatnonzero(np.abs(np.diff(speed)) > _SAME * max(largest, 1e-12)) + 1
    edges = np.r_[0, changes]
    edges = edges[np.r_[True, np.diff(edges) >= 3]]  # a corner between two samples is one change
    edges = np.r_[0, edges[(edges > 0) & (edges <= command.size - 3)], command.size]
    if edges.size > 2 * _EQUAL_PARTS:
        return _equal_parts(command.size)
    settle = round(settling_time / interval)
    found: list[Phase] = []
    seen: dict[str, int] = {}
    for first, end in pairwise(edges):
        middle = float(np.median(speed[first:end]))
        kind = "rest" if abs(middle) <= _SAME * largest else "out" if middle > 0.0 else "back"
        seen[kind] = seen.get(kind, 0) + 1
        name = kind if seen[kind] == 1 else f"{kind} {seen[kind]}"
        cut = min(first + settle, end)
        if end - cut < 12:  # samples; shorter steady phases belong to the transient before
            cut = end
        found.append(Phase(name, False, slice(int(first), int(cut))))
        if cut < end:
            found.append(Phase(name, True, slice(int(cut), int(end))))
    steady = [speed[phase.samples] for phase in found if phase.steady]
    if not steady or max(float(np.ptp(part)) for part in steady) > 0.1 * largest:
        return _equal_parts(command.size)  # a sine: its speed never stays
    return found


def calm(command: np.ndarray, interval: float, settling_time: float) -> np.ndarray:
    """Samples (S,) in which the actuator is at rest or moves steadily; arguments as `phases`."""
    found = np.zeros(command.size, dtype=bool)
    for phase in phases(command, interval, settling_time):
        if phase.steady:
            found[phase.samples] = True
    return found


def _equal_parts(samples: int) -> list[Phase]:
    even = np.linspace(0, samples, _EQUAL_PARTS + 1).astype(int)
    return [
        Phase(f"part {n + 1}", False, slice(int(a), int(b)))
        for n, (a, b) in enumerate(pairwise(even))
    ]
