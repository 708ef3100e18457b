"""A recording compared stretch by stretch, each simulated anew from its recorded state.

Multiple shooting (Bock 1981; Bock and Plitt 1984, Proc. 9th IFAC World Congress, 242-247) with
states that were measured, so that only the faults are left to find. An error of the twin lasts to
the end of its stretch: near the torque at which a motor stalls, the misfit over the whole recording
jumps from vector to vector. A vector that explains the whole recording is still the better answer.
"""

from dataclasses import replace

import numpy as np

from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.stretches import PowerStretches, Stretches, initial_state, with_speeds
from ematwin.models.comparison import Candidates, Comparison
from ematwin.numerics.signals import filtered
from ematwin.recordings.recording import Recording

LENGTH = 0.005  # s; at 10 to 20 ms some twins still stalled within a stretch


def has_states(recording: Recording) -> bool:
    """Whether a recording holds the positions from which its stretches can start."""
    return {"motor_position", "output_position"} <= set(recording.channels)


class Restarted(Comparison):
    """Misfit of a batch of candidates, as `BldcComparison` gives it, summed over stretches.

    ``whole`` is of a recording with both positions; ``length`` of a stretch is in s. The low-pass
    starts each as the recorded current left it.
    """

    def __init__(self, whole: BldcComparison, length: float = LENGTH) -> None:
        size, rate = len(whole.recording), whole.recording.sample_rate
        samples = max(2, round(length * rate))
        starts = np.arange(0, max(1, size - samples), samples)
        most = 400  # of a longer recording as many, evenly spread
        if len(starts) > most:
            starts = starts[np.linspace(0, len(starts) - 1, most).astype(int)]
        self._whole = whole
        self.recording, self.actuator = whole.recording, whole.actuator
        self.length = self._length = length
        self.stretches = _stretches(whole, starts, min(samples + 1, size))
        self.noise, self.expected_misfit = whole.noise, whole.expected_misfit
        self.recorded_noise, self.independent = whole.recorded_noise, whole.independent
        self.ignores, self.model_error = whole.ignores, whole.model_error
        if self.stretches.power is not None:
            self.evidence = len(starts) * whole.kept_of(self.stretches)
        weights = self.stretches.weighted(whole.weights, 1)
        self.scale = float(np.sum(weights * whole.target[self.stretches.places(1)] ** 2))

    def with_evidence(self) -> "Restarted":
        """With the electrical power, where it was recorded."""
        return Restarted(self._whole.with_evidence(), self._length)

    def smoothed(self) -> "Restarted":
        """The same comparison through the smoothing low-pass."""
        return Restarted(self._whole.smoothed(), self._length)

    def costs(self, candidates: Candidates, count: int) -> np.ndarray:
        """Costs (B,), A s; infinite where a simulation diverged."""
        return self._whole.run(self.stretches, self._whole.batch(candidates, count), 0)[0]

    def responses(self, candidates: Candidates, count: int) -> dict[str, np.ndarray]:
        """Responses over the whole recording."""
        return self._whole.responses(candidates, count)

    def measured(self) -> dict[str, np.ndarray]:
        """Measured current of the whole recording."""
        return self._whole.measured()

    def captions(self) -> dict[str, tuple[str, str]]:
        """As of the whole recording."""
        return self._whole.captions()

    def residuals(self, candidates: Candidates, count: int) -> np.ndarray:
        """Weighted residuals (B, K): the sum of their squares is the cost."""
        return self._whole.residuals(candidates, count, self.stretches)


def _stretches(whole: BldcComparison, starts: np.ndarray, samples: int) -> Stretches:
    """Stretches from some samples on; each ends with the sample at which another may start."""
    recording, entire = with_speeds(whole.recording), whole.whole
    currents = whole.current[starts] if not whole.rectify else [None] * len(starts)
    states = [
        initial_state(recording, whole.actuator, None if now is None else float(now), int(start))
        for start, now in zip(starts, currents, strict=True)
    ]
    power = entire.power
    if power is not None and whole.power is not None:
        taps = _taps_at(starts, np.r_[whole.taps[:5], power.states[0]], whole.power.watts)
        # contiguous, as that of a whole recording: another layout compiles the kernel once more
        power = PowerStretches(power.target, power.weights, np.ascontiguousarray(taps[:, 5:]))
    return replace(
        entire, starts=starts, samples=samples, states=np.stack(states), power=power,
        taps=_taps_at(starts, whole.taps, whole.current), kept=max(8, whole.kept // len(starts)),
    )  # fmt: skip


def _taps_at(starts: np.ndarray, taps: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """(N, 7) taps of a filter at each start, as a recorded signal (S,) has left it there.

    It goes on from the recorded signal, so that a stretch has no transient.
    """
    found, done = np.tile(taps, (len(starts), 1)), 0
    for row, start in zip(found, starts.tolist(), strict=True):
        _, row[5:] = filtered(taps, signal[done : start + 1])
        taps = row
        done = start + 1
    return found
