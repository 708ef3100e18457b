"""Which faults are present: one rule for reports, commands and studies.

A fault is present if it is at least `SMALLEST` of its range from healthy with a probability of
`CERTAIN`. Beforehand it is as likely absent, within that share, as present, anywhere else in its
range (spike and slab: Mitchell and Beauchamp 1988, J. Am. Stat. Assoc. 83, 1023-1032); the
recording says how likely each value is, a normal density around what was found. A direction is
never a fault of its own.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from ematwin.estimation.constants import BEFOREHAND, CERTAIN, SMALLEST
from ematwin.estimation.estimate import Estimate

_ANY = 1e3  # ranges: with such an error every value is as likely
_normal = np.frompyfunc(lambda x: 0.5 * math.erfc(-x / math.sqrt(2.0)), 1, 1)


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
    """Whether deviations from healthy are faults; arguments as of `probability`."""
    return np.asarray(probability(deviation, width, standard_error, smallest) > CERTAIN)


def probability(
    deviation: ArrayLike, width: ArrayLike, standard_error: ArrayLike = 0.0,
    smallest: float = SMALLEST,
) -> np.ndarray:  # fmt: skip
    """Probabilities that faults are present; arrays (...) broadcast.

    Parameters
    ----------
    deviation : value less healthy value
    width : range of the unknown
    standard_error : infinite where the value is not determined; 0 where only the size counts
    smallest : float, share of the range that counts
    """
    size, error, width = np.broadcast_arrays(np.abs(deviation), standard_error, width)
    size, error = size / width, np.minimum(error / width, _ANY)

    def below(end: float) -> np.ndarray:
        return np.asarray(_normal((end - size) / np.where(error > 0.0, error, 1.0)), dtype=float)

    absent = below(smallest) - below(-smallest)
    there = np.maximum(below(1.0) - below(-1.0) - absent, 0.0)
    found = there / np.maximum(there + weight(smallest) * absent, 1e-300)
    certain = (error == 0.0) | (absent + there == 0.0)
    return np.where(certain, (size >= smallest).astype(float), found)


def weight(share: float) -> float:
    """How many times likelier "absent" is beforehand than its share of the range makes it."""
    return (1.0 - BEFOREHAND) / BEFOREHAND * (1.0 - share) / share
