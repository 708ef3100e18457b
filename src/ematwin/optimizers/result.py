"""Result of a search, its progress, and the reasons why it ends."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from ematwin.optimizers.base import FloatArray
from ematwin.showing.results import drawn, frame, html


class Stop(StrEnum):
    """Why a search ended, as written in results and files."""

    BUDGET = "budget"
    TARGET = "target"
    STAGNATION = "stagnation"
    CALLBACK = "callback"
    INTERRUPTED = "interrupted"
    CONVERGED = "converged"


_SENTENCES = {
    Stop.BUDGET: "the budget is spent",
    Stop.TARGET: "the target is reached",
    Stop.STAGNATION: "the cost has stopped falling",
    Stop.CALLBACK: "the callback asked to stop",
    Stop.INTERRUPTED: "interrupted; this is the best found so far",
    Stop.CONVERGED: "the method itself has converged",
}


@dataclass(frozen=True)
class Progress:
    """State of a search between two batches."""

    evaluations: int  # points evaluated so far
    cost: float  # least finite cost so far; infinite if there was none
    improved_at: int  # evaluations after which ``cost`` last fell
    seconds: float  # wall time in this process, objective included
    budget: int  # evaluations that the search may spend


@dataclass(frozen=True)
class History:
    """Best cost after each of B batches."""

    evaluations: np.ndarray  # (B,), integers
    cost: FloatArray  # (B,)

    def __len__(self) -> int:
        return len(self.evaluations)


@dataclass(frozen=True)
class MinimizeResult:
    """Result of a search.

    Attributes
    ----------
    x : (d,) array, best point
    cost : float, its cost
    evaluations : int
    history : History
    stopped : str, one of `Stop`, or a method's own reason
    seconds : float, s, wall time, objective included; over all sittings if resumed
    algorithm : str
    seed : int
    """

    x: FloatArray
    cost: float
    evaluations: int
    history: History
    stopped: str
    seconds: float
    algorithm: str
    seed: int

    def to_frame(self) -> Any:
        """A pandas DataFrame of the best cost after each batch; needs pandas."""
        return frame(vars(self.history), "evaluations")

    to_dataframe = to_frame

    def plot(self) -> Any:
        """The best cost over the evaluations, a figure of plotly."""
        return drawn(self, "convergence", {"convergence": "plot_convergence"})

    def _repr_html_(self) -> str:
        """The result in a notebook."""
        point = ", ".join(f"{value:.6g}" for value in self.x)
        said = f"{self.algorithm}, seed {self.seed}, x = ({point})"
        return html(self.message, notes=[said])

    @property
    def message(self) -> str:
        """One sentence for people."""
        reason = _SENTENCES.get(self.stopped, self.stopped)  # type: ignore[call-overload]
        return (
            f"Cost {self.cost:.6g} after {self.evaluations} evaluations "
            f"in {self.seconds:.2f} s: {reason}."
        )
