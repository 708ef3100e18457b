"""Which sector a step of the monitor model is in, where the next one may begin within it.

In sector s of 60 electrical degrees the pair is that of `gate_signals`
(`ematwin.models.bldc.inverter`). A step in which the next pair takes over has a sector between
both, by the share of each, and `gate_signals` gives the mean of both pairs.
"""

import math

import numpy as np

from ematwin.numerics.compile import part
from ematwin.numerics.scalar import clip

_SECTOR = math.pi / 3.0  # rad
_STANDS = 1e-6  # sectors in a step


@part
def sector_of_step(theta_e, moved_e):
    """Sector, 0 to 6; ``theta_e`` is the angle in the middle, which changes by ``moved_e``."""
    width = max(abs(moved_e) / _SECTOR, _STANDS)
    begin = theta_e / _SECTOR - 0.5 - 0.5 * width
    first = np.floor(begin)
    sector = first + clip((begin + width - first - 1.0) / width, 0.0, 1.0)
    return sector - 6.0 * np.floor(sector / 6.0)
