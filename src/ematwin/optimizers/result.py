"""Result of a search, its progress, and why it ends."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ematwin.optimizers.base import FloatArray
from ematwin.showing.results import drawn, frame, html

_SENTENCES = {
    "budget": "the budget is spent",
    "target": "the target is reached",
    "stagnation": "the cost has stopped falling",
    "callback": "the callback asked to stop",
    "interrupted": "interrupted; this is the best found so far",
    "converged": "the method itself has converged",
}
"""Why a search ended, as written in results and files, and in words."""


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
    """Result of a search."""

    x: FloatArray  #: (d,), best point
    cost: float  #: its cost
    evaluations: int
    history: History
    stopped: str  #: budget, target, stagnation, callback, interrupted, or a method's own reason
    seconds: float  #: wall time, objective included; over all sittings if resumed
    algorithm: str  #: its name
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
        reason = _SENTENCES.get(self.stopped, self.stopped)
        return (
            f"Cost {self.cost:.6g} after {self.evaluations} evaluations "
            f"in {self.seconds:.2f} s: {reason}."
        )
