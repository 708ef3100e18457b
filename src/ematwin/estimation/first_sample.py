"""When the sampled loops of a drive sampled first in a recording.

A voltage between two samples stays as it is. So the current after a commutation depends on how long
before it the loop had sampled: it differs by per cent, far more than noise. Where a recording
begins among the samples differs from one to the next, and is found by the equations along the
motion (`Equation.first_samples`).
"""

from collections.abc import Callable, Sequence

import numpy as np

from ematwin.numerics.side_by_side import side_by_side


def found_first_sample(cost: Callable[[float], float], instants: Sequence[float]) -> float:
    """The instant at which a cost is least.

    The share of commutations on the wrong side of a sample grows in proportion to the error of the
    instant, and so does the cost, to both sides.

    Parameters
    ----------
    cost : of an instant, s; called side by side
    instants : evenly spaced on a circle
    """
    costs = np.array(side_by_side(cost, instants))
    n = int(np.argmin(costs))
    before, after = costs[n - 1], costs[(n + 1) % len(costs)]
    steep = max(before, after) - costs[n]
    if not (np.isfinite(steep) and steep > 0.0):
        return instants[n]
    between = instants[n] + 0.5 * (before - after) / steep * (instants[1] - instants[0])
    return between if cost(between) < costs[n] else instants[n]
