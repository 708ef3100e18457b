"""The misfit between two currents: eq. 2 of the paper, and the percentage error of faults.

    err = sum_t (I_3eq - I_m)^2 / sqrt((dI_3eq/dt)^2 + s^2)

A total least squares weighting: where the measured current is steep, a small shift in time makes
a large difference, and counts for less. The slope scale s = 1 A/s is the paper's own form.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SlopeWeighting:
    """Weights ``1/sqrt((dI/dt)^2 + s^2)`` from the measured current.

    Parameters
    ----------
    slope_scale : float, A/s; 1 is the paper's, larger ones come closer to least squares
    """

    slope_scale: float = 500.0

    def weights(self, measured: np.ndarray, interval: float) -> np.ndarray:
        """(S,) array, s/A, for a measured current (S,) in A sampled each ``interval`` s."""
        slope = np.gradient(measured, interval)
        return 1.0 / np.sqrt(slope**2 + self.slope_scale**2)


def misfit(
    measured: np.ndarray,
    simulated: np.ndarray,
    interval: float,
    weighting: SlopeWeighting | None = None,
) -> float:
    """Eq. 2 of the paper for two currents (S,) in A; unit A s."""
    weighting = weighting or SlopeWeighting()
    weights = weighting.weights(measured, interval)
    return float(np.sum(weights * (measured - simulated) ** 2))
