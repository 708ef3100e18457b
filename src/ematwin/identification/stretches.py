"""A record compared stretch by stretch, each simulated anew from its recorded state.

Multiple shooting (Bock 1981; Bock and Plitt 1984, Proc. 9th IFAC World Congress, 242-247) with
states that were measured, so that only the faults are left to find. An error of the twin lasts to
the end of its stretch. Over the whole record it may last for good: where the motor is near the
torque at which it stalls, the twin stalls where the actuator still moved, the misfit jumps from
vector to vector, and the truth itself fits badly.

What the current tells between two recorded positions is less than what it tells along the way: a
vector that explains the whole record is the better answer.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ematwin.identification.objective import Objective
from ematwin.signals.record import Record

LENGTH = 0.005  # s; at 10 to 20 ms some twins still stalled within a stretch
_MOST = 400  # stretches; of a longer record as many, evenly spread


def has_states(record: Record) -> bool:
    """Whether a record holds the positions from which its stretches can start."""
    return record.motor_position is not None and record.output_position is not None


class Stretches:
    """Misfit of a batch of fault vectors, as an `Objective` gives it, summed over stretches.

    Parameters
    ----------
    objective : Objective, of the whole record, which must have the positions of motor and output
    length : float, s

    Attributes
    ----------
    length : float, s
    low_pass : filter of both currents; it starts each stretch as the recorded current left it
    """

    def __init__(self, objective: Objective, length: float = LENGTH) -> None:
        size, rate = len(objective.record), objective.record.sample_rate
        samples = max(2, round(length * rate))
        starts = np.arange(0, max(1, size - samples), samples)
        if len(starts) > _MOST:
            starts = starts[np.linspace(0, len(starts) - 1, _MOST).astype(int)]
        self.low_pass = objective.low_pass
        self._whole = objective
        self.length = length
        self._parts = objective.parts(starts.tolist(), samples)
        self._scale = sum(float(np.sum(p.weights * p.target**2)) for p in self._parts)
        self._pool: ThreadPoolExecutor | None = None

    def with_cutoff(self, cutoff: float) -> "Stretches":
        """The same comparison through another low-pass (Hz)."""
        return Stretches(self._whole.with_cutoff(cutoff), self.length)

    def __call__(self, k: np.ndarray) -> np.ndarray:
        """Costs (B,) of fault vectors (B, 8), A s; infinite where a simulation diverged."""
        return np.sum(self._map(lambda part: part(k)), axis=0)

    def residuals(self, k: np.ndarray) -> np.ndarray:
        """Weighted residuals (B, K): the sum of their squares is the cost."""
        return np.concatenate(self._map(lambda part: part.residuals(k)), axis=1)

    def relative_misfit(self, cost: float) -> float:
        """Root of the cost over that of a twin without any current."""
        return float(np.sqrt(cost / self._scale))

    def _map(self, work: Callable[[Objective], np.ndarray]) -> list[np.ndarray]:
        if self._whole.threads == 1:
            return [work(part) for part in self._parts]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._whole.threads, thread_name_prefix="ematwin")
        return list(self._pool.map(work, self._parts))
