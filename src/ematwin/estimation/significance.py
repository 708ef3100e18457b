"""Which faults are present: one rule for reports, commands, studies and monitoring.

A fault is present if its value lies further from healthy than `SMALLEST` of its range and than
`SIGMAS` standard errors. The first bound keeps out what is too small to matter, the second what may
be chance. A direction is never a fault of its own.

Three standard errors of a normal distribution are exceeded upwards once in 740 cases; with the
eight values of the brushless actuator one healthy recording in a hundred is called faulty, if the
errors are what they say. `FALSE_ALARM_RATE` is what is promised; docs/trust.md counts.
"""

import numpy as np
from numpy.typing import ArrayLike

from ematwin.estimation.constants import SIGMAS, SMALLEST
from ematwin.estimation.estimate import Estimate


def present(estimate: Estimate, smallest: float = SMALLEST) -> tuple[str, ...]:
    """Names of the faults of an estimate that are present, in its order."""
    errors = estimate.standard_errors
    return tuple(
        name
        for name in estimate.names
        if name not in estimate.directions
        and is_present(
            estimate[name] - estimate.healthy[name], estimate.ranges[name], errors[name], smallest
        )
    )


def is_present(
    deviation: ArrayLike, width: ArrayLike, standard_error: ArrayLike = 0.0,
    smallest: float = SMALLEST,
) -> np.ndarray:  # fmt: skip
    """Whether deviations from healthy are faults; arrays (...) broadcast.

    Parameters
    ----------
    deviation : value less healthy value
    width : range of the unknown
    standard_error : infinite where the value is not determined; 0 where only the size counts
    smallest : float, share of the range that counts
    """
    size, error = np.abs(deviation), np.asarray(standard_error)
    large = size >= smallest * np.asarray(width)
    return np.asarray(large & np.isfinite(error) & (size > SIGMAS * error))
