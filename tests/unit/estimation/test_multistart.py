"""When the default search has enough."""

import numpy as np

from ematwin.estimation.multistart import MultistartDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Tally
from naive.toy import BASES, Toy, fault, stacked


def test_searches_that_fit_poorly_and_alike_are_enough_and_both_ends_are_kept():
    """Nothing tells one of the faults, so that no two searches end in the same place."""
    toy = Toy(lambda values: stacked(values["wear"]), wear=0.3)
    unexplained = BASES[3]
    toy.recording = toy.recording.changed(y=toy.recording.y + unexplained)
    state = Tally(Problem([toy], (fault("wear"), fault("idle"))), budget=10_000)
    MultistartDescent(state).run()
    assert state.stopped == "two searches fit alike"
    idle = [point[1] for point in (state.best, state.others[-1])]
    assert abs(idle[0] - idle[1]) > 0.02
    np.testing.assert_allclose([state.best[0], state.others[-1][0]], 0.3, atol=0.01)
