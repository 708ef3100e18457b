"""When the sampled loops of a drive sampled first in a recording.

A voltage between two samples stays as it is. So the current after a commutation depends on how long
before it the loop had sampled: it differs by per cent, far more than noise. Where a recording
begins among the samples differs from one to the next, and is found by the equations along the
motion (`Equation.first_samples`).
"""

from collections.abc import Callable, Sequence

from ematwin.numerics.side_by_side import side_by_side

_HALVED = 3  # times: to a 64th of a sample time


def found_first_sample(cost: Callable[[float], float], instants: Sequence[float]) -> float:
    """The instant at which a cost is least.

    The share of commutations on the wrong side of a sample grows with the error of the instant, and
    so does the cost, to both sides. The best instant is followed with steps that are halved.

    Parameters
    ----------
    cost : of an instant, s; called side by side
    instants : evenly spaced on a circle
    """
    costs = side_by_side(cost, instants)
    least, best = min(zip(costs, instants, strict=True))
    step = instants[1] - instants[0]
    for _ in range(_HALVED):
        step *= 0.5
        tried = [best - step, best + step]
        least, best = min((least, best), *zip(side_by_side(cost, tried), tried, strict=True))
    return best
