"""Where a search box lies relative to the fault vectors.

In the plain box six of the eight healthy values lie at the origin, in a corner. Methods that are
drawn to the origin, or that clip at the bounds, find them by that alone. The remapped box is the
same set of fault vectors turned round: each component is shifted along its unit interval, and what
leaves one end enters at the other,

    k = (x - SHIFT) mod 1,    x = (k + SHIFT) mod 1.

The map is one to one and keeps lengths, so that random search cannot tell the boxes apart, and
the cost of a fault vector is unchanged. A healthy magnitude (k = 0) lies inside, at x = SHIFT,
with k near 1 just below it: no continuous one-to-one map of an interval can bring its end inside.
Methods meet a cliff there where the plain box has a wall. For the direction of the eccentricity the
shift is a rotation, without any cliff.
"""

import numpy as np

from ematwin.errors import InputError

BOXES = ("plain", "remapped")

# healthy then lies at 0.31, 0.64, 0.42, 0.73, 0.27, 0.58, 0.69, 0.37: neither a corner, nor the
# centre, nor on a diagonal
SHIFT = np.array([0.31, 0.64, 0.42, 0.73, 0.27, 0.58, 0.19, 0.87])
SHIFT.flags.writeable = False


def check_box(box: str) -> str:
    """Give ``box`` back, or raise `InputError` if there is none of that name."""
    if box not in BOXES:
        raise InputError(f"There is no box {box!r}; choose {' or '.join(BOXES)}.")
    return box


def to_faults(x: np.ndarray, box: str) -> np.ndarray:
    """Fault vectors (N, 8) from points (N, 8) of the search box."""
    return x if box == "plain" else np.mod(x - SHIFT, 1.0)


def from_faults(k: np.ndarray, box: str) -> np.ndarray:
    """Points (N, 8) of the search box from fault vectors (N, 8)."""
    return k if box == "plain" else np.mod(k + SHIFT, 1.0)
