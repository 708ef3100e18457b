"""When the sampled loops of a drive sampled first in a recording.

A voltage between two samples stays as it is. So the current after a commutation depends on how long
before it the loop had sampled: it differs by per cent, far more than noise. Where a recording
begins among the samples differs from one to the next, and is found by the equations along the
motion (`Equation.first_samples`).
"""

from collections.abc import Callable, Sequence

from ematwin.numerics.side_by_side import side_by_side

_HALVED = 3  # times: to a 64th of a sample time


def found_first_sample(
    cost: Callable[[float], float], instants: Sequence[Sequence[float]]
) -> float:
    """The instant at which a cost is least.

    The share of commutations on the wrong side of a sample grows with the error of the instant, and
    so does the cost, to both sides. It hardly depends on which sample of the current is the first
    of the speed as well. So the first row is compared, then the best column, then nearer instants,
    with steps that are halved.

    Parameters
    ----------
    cost : of an instant, s; called side by side
    instants : rows of the same instants in one sample time after the other, evenly spaced
    """

    def best_of(some: Sequence[float]) -> tuple[float, float]:
        return min(zip(side_by_side(cost, some), some, strict=True))

    _, share = best_of(instants[0])
    column = instants[0].index(share)
    least, best = best_of([row[column] for row in instants])
    step = instants[0][1] - instants[0][0]
    for _ in range(_HALVED):
        step *= 0.5
        least, best = min((least, best), best_of([best - step, best + step]))
    return best
