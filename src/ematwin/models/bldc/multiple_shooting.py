"""A recording compared stretch by stretch, each simulated anew from its recorded state.

Multiple shooting (Bock 1981; Bock and Plitt 1984, Proc. 9th IFAC World Congress, 242-247) with
states that were measured, so that only the faults are left to find. An error of the twin lasts to
the end of its stretch. Over the whole recording it may last for good: where the motor is near the
torque at which it stalls, the twin stalls where the actuator still moved, the misfit jumps from
vector to vector, and the truth itself fits badly.

What the current tells between two recorded positions is less than what it tells along the way: a
vector that explains the whole recording is the better answer.
"""

import numpy as np

from ematwin.models.bldc.comparison import (
    KEPT,
    BldcComparison,
    PowerStretch,
    Stretch,
    initial_state,
    with_speeds,
)
from ematwin.models.comparison import Candidates, Comparison
from ematwin.numerics.low_pass import filtered
from ematwin.recordings.recording import Recording

LENGTH = 0.005  # s; at 10 to 20 ms some twins still stalled within a stretch
# Candidates; fewer are simulated over a stretch in less time than threads take to take turns in
# Python: a hundred stretches of 9 take 5 ms on one thread, and 10 on two.
_ALONE = 64
_MOST = 400  # stretches; of a longer recording as many, evenly spread


def has_states(recording: Recording) -> bool:
    """Whether a recording holds the positions from which its stretches can start."""
    return {"motor_position", "output_position"} <= set(recording.channels)


class Restarted(Comparison):
    """Misfit of a batch of candidates, as `BldcComparison` gives it, summed over stretches.

    Parameters
    ----------
    whole : BldcComparison, of a recording with the positions of motor and output
    length : float, s

    Attributes
    ----------
    length : float, s
    stretches : tuple of Stretch; the low-pass starts each as the recorded current left it
    """

    def __init__(self, whole: BldcComparison, length: float = LENGTH) -> None:
        size, rate = len(whole.recording), whole.recording.sample_rate
        samples = max(2, round(length * rate))
        starts = np.arange(0, max(1, size - samples), samples)
        if len(starts) > _MOST:
            starts = starts[np.linspace(0, len(starts) - 1, _MOST).astype(int)]
        self._whole = whole
        self.recording, self.actuator = whole.recording, whole.actuator
        self.length = self._length = length
        self.stretches = _stretches(whole, starts.tolist(), samples)
        self.noise, self.expected_misfit = whole.noise, whole.expected_misfit
        self.recorded_noise, self.independent = whole.recorded_noise, whole.independent
        self.ignores, self.tells = whole.ignores, whole.tells
        self.evidence = sum(whole.kept_of(s) for s in self.stretches if s.power is not None)
        self.scale = sum(float(np.sum(s.weights * s.target**2)) for s in self.stretches)

    def with_evidence(self) -> "Restarted":
        """With the electrical power, where it was recorded."""
        return Restarted(self._whole.with_evidence(), self._length)

    def smoothed(self) -> "Restarted":
        """The same comparison through the smoothing low-pass."""
        return Restarted(self._whole.smoothed(), self._length)

    def costs(self, candidates: Candidates, count: int) -> np.ndarray:
        """Costs (B,), A s; infinite where a simulation diverged."""
        batch = self._whole.batch(candidates, count)
        if self._whole.backend == "cuda":
            runs = self._whole.run_at_once(self.stretches, batch, [0] * len(self.stretches))
            return np.asarray(np.sum([run[0] for run in runs], axis=0))
        costs = np.empty((len(self.stretches), count))

        def work(n: int) -> None:
            costs[n] = self._whole.run(self.stretches[n], batch, 0, spread=False)[0]

        self._whole.share(work, range(len(self.stretches)), spread=count > _ALONE)
        return np.asarray(costs.sum(axis=0))

    def responses(self, candidates: Candidates, count: int) -> dict[str, np.ndarray]:
        """Those of the whole recording."""
        return self._whole.responses(candidates, count)

    def measured(self) -> dict[str, np.ndarray]:
        """That of the whole recording."""
        return self._whole.measured()

    def captions(self) -> dict[str, tuple[str, str]]:
        """As of the whole recording."""
        return self._whole.captions()

    def residuals(self, candidates: Candidates, count: int) -> np.ndarray:
        """Weighted residuals (B, K): the sum of their squares is the cost."""
        batch = self._whole.batch(candidates, count)
        parts: list[list[np.ndarray]] = [[]] * len(self.stretches)
        whole = self._whole
        if whole.backend == "cuda":
            kept = [whole.kept_of(stretch) for stretch in self.stretches]
            runs = whole.run_at_once(self.stretches, batch, kept)
            for n, (stretch, few, run) in enumerate(zip(self.stretches, kept, runs, strict=True)):
                parts[n] = whole.weighted(stretch, batch, few, *run)
        else:

            def work(n: int) -> None:
                parts[n] = whole.residuals_of(self.stretches[n], batch, spread=False)

            whole.share(work, range(len(self.stretches)), spread=count > _ALONE)
        in_order = [part for kind in zip(*parts, strict=True) for part in kind]
        return np.concatenate(in_order, axis=1)


def _stretches(whole: BldcComparison, starts: list[int], samples: int) -> tuple[Stretch, ...]:
    """Stretches from some samples on; each ends with the sample at which another may start."""
    taps, z = whole.taps[:5], whole.taps[5:]
    recording = with_speeds(whole.recording)
    power = whole.stretch.power
    y = None if power is None else power.state
    stretches, done = [], 0
    for start in starts:
        # the filter goes on from the recorded current, so that a stretch has no transient
        _, z = filtered(np.r_[taps, z], whole.current[done : start + 1])
        span = slice(start, start + samples + 1)
        own_power = None
        if power is not None and whole.power is not None:
            _, y = filtered(np.r_[taps, y], whole.power.watts[done : start + 1])
            own_power = PowerStretch(power.target[span], _but_first(power.weights[span]), y)
        done = start + 1
        current = None if whole.rectify else float(whole.current[start])
        stretches.append(
            Stretch(
                whole.command[span],
                whole.load[span],
                whole.target[span],
                _but_first(whole.weights[span]),
                initial_state(recording, whole.actuator, current, start),
                np.concatenate([taps, z]),
                max(8, KEPT // len(starts)),
                own_power,
                at_rest=start == 0,
            )
        )
    return tuple(stretches)


def _but_first(weights: np.ndarray) -> np.ndarray:
    """Weights of a stretch; at its start nothing has been simulated yet."""
    return np.concatenate([[0.0], weights[1:]])
