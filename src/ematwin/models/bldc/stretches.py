"""Stretches of a recording on the monitor model's time base, and where they start."""

from dataclasses import dataclass

import numpy as np

from ematwin.numerics.filters import compare


@dataclass(frozen=True)
class PowerStretches:
    """Recorded power.

    Attributes
    ----------
    target : (S,) array, W, filtered
    weights : (S,) array, 1/W^2
    states : (N, 2) array, of the low-pass at the first sample of each stretch
    """

    target: np.ndarray
    weights: np.ndarray
    states: np.ndarray


@dataclass(frozen=True)
class Stretches:
    """Stretches of one recording, all of the same length; the whole recording may be the only one.

    Attributes
    ----------
    command, load : (S,) arrays on the motor shaft, rad and N m, of the whole recording
    target : (S,) array, A, filtered equivalent current
    weights : (S,) array, s/A
    starts : (N,) integer array, the sample at which each begins; it counts nothing itself
    samples : of each stretch
    states : (N, 7) array, of the monitor model at each start
    taps : (N, 7) array, of the low-pass and its state at each start
    kept : samples of a response over a stretch that are kept at most
    power : where it counts
    """

    command: np.ndarray
    load: np.ndarray
    target: np.ndarray
    weights: np.ndarray
    starts: np.ndarray
    samples: int
    states: np.ndarray
    taps: np.ndarray
    kept: int
    power: PowerStretches | None = None

    def __len__(self) -> int:
        return len(self.starts)

    def places(self, stride: int) -> np.ndarray:
        """(N, K) integer array: every so many samples of each stretch, from its start on."""
        return self.starts[:, None] + np.arange(0, self.samples, stride)

    def weighted(self, weights: np.ndarray, stride: int) -> np.ndarray:
        """(N, K) weights, of (S,) ones, of every so many samples; of each start none."""
        found = stride * weights[self.places(stride)]
        found[:, 0] = 0.0
        return found

    def compare(
        self,
        rows: np.ndarray,
        target: np.ndarray,
        weights: np.ndarray,
        stride: int,
        late: np.ndarray | None,
    ) -> None:
        """Change rows (B, N K), of every so many samples, to weighted residuals.

        ``late`` (B,) is by how many samples the target is ahead of each row; None is not at all.
        """
        places = self.places(stride)
        if late is None:
            rows -= target[places].ravel()
            rows *= np.sqrt(self.weighted(weights, stride)).ravel()
            return
        apart = rows.reshape(len(rows), *places.shape)
        compare(apart, target, np.sqrt(stride * weights), self.starts, stride, late)
        apart[:, :, 0] *= 0.0
