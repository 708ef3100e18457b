"""When a search ends: criteria as values, and the reasons that they give."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from ematwin.errors import InputError
from ematwin.optimizers.base import whole_number


class Stop(StrEnum):
    """Why a search ended, as written in results and files."""

    BUDGET = "budget"
    TARGET = "target"
    STAGNATION = "stagnation"
    CALLBACK = "callback"
    INTERRUPTED = "interrupted"
    CONVERGED = "converged"


@dataclass(frozen=True)
class Progress:
    """What is known between two batches.

    Attributes
    ----------
    evaluations : int, points evaluated so far
    cost : float, least finite cost so far; infinite if there was none
    improved_at : int, evaluations after which ``cost`` last fell
    seconds : float, s, wall time in this process, objective included
    budget : int, evaluations that the search may spend
    """

    evaluations: int
    cost: float
    improved_at: int
    seconds: float
    budget: int


class StoppingCriterion(Protocol):
    """A reason to end a search before its budget is spent."""

    def reason(self, progress: Progress) -> str | None:
        """Give the reason, or None to go on."""
        ...  # pragma: no cover


@dataclass(frozen=True)
class Target:
    """End once the cost is at most ``cost``."""

    cost: float

    def reason(self, progress: Progress) -> str | None:
        """Give ``Stop.TARGET`` or None."""
        return Stop.TARGET if progress.cost <= self.cost else None


@dataclass(frozen=True)
class Stagnation:
    """End once ``evaluations`` in a row have not lowered the cost."""

    evaluations: int

    def __post_init__(self) -> None:
        whole_number(self.evaluations, "number of evaluations of a stagnation", 1)

    def reason(self, progress: Progress) -> str | None:
        """Give ``Stop.STAGNATION`` or None."""
        without = progress.evaluations - progress.improved_at
        return Stop.STAGNATION if without >= self.evaluations else None


def criteria(target: float | None, stagnation: int | None) -> tuple[StoppingCriterion, ...]:
    """Make the criteria that the plain arguments of ``minimize`` stand for."""
    found: list[StoppingCriterion] = []
    if target is not None:
        if not isinstance(target, (int, float)) or target != target:
            raise InputError(f"The target must be a cost to reach, received {target!r}.")
        found.append(Target(float(target)))
    if stagnation is not None:
        found.append(Stagnation(stagnation))
    return tuple(found)
