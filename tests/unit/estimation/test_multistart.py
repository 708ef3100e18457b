"""When the default search has enough."""

import numpy as np

from ematwin.estimation.multistart import MultistartDescent
from ematwin.estimation.problem import Problem
from naive.toy import BASES, Toy, fault, stacked


def test_searches_that_fit_poorly_and_alike_are_enough_and_both_ends_are_kept():
    """Nothing tells one of the faults, so that no two searches end in the same place."""
    toy = Toy(lambda values: stacked(values["wear"]), wear=0.3)
    unexplained = BASES[3]
    toy.recording = toy.recording.changed(y=toy.recording.y + unexplained)
    search = MultistartDescent(Problem([toy], (fault("wear"), fault("idle"))))
    state = search.run()
    assert state.stopped == "two searches fit alike"
    idle = [point[1] for point in (state.best, state.others[-1])]
    assert abs(idle[0] - idle[1]) > 0.02
    np.testing.assert_allclose([state.best[0], state.others[-1][0]], 0.3, atol=0.01)


def test_searches_that_fit_no_better_twice_in_a_row_are_the_last(monkeypatch):
    search, scale = unlike_anything()
    ends = iter([0.5, 0.3, 0.4, 0.6, 0.1])  # the relative misfits of one search after another
    seen = []

    def one_search(self, sobol):
        seen.append(next(ends))
        return seen[-1] ** 2 * scale, np.array([seen[-1]])

    monkeypatch.setattr(MultistartDescent, "_one_search", one_search)
    assert search.run().stopped == "no search fits better"
    assert seen == [0.5, 0.3, 0.4, 0.6]


def test_a_search_that_is_not_worth_another_is_the_last(monkeypatch):
    search, scale = unlike_anything()
    search.worth = 0.2
    monkeypatch.setattr(
        MultistartDescent, "_one_search", lambda self, sobol: (0.09 * scale, np.array([0.3]))
    )
    assert search.run().stopped == "no search fits better"


def unlike_anything() -> tuple[MultistartDescent, float]:
    """A search, and the cost of a twin that does not answer."""
    toy = Toy(lambda values: stacked(values["wear"]), wear=0.3)
    return MultistartDescent(Problem([toy], (fault("wear"),))), toy.scale


def test_points_of_the_smooth_stage_are_rated_together_and_keep_their_place_in_the_history():
    toy = Toy(lambda values: stacked(values["wear"]), wear=0.3)
    search = MultistartDescent(Problem([toy], (fault("wear"),)))
    search.state.evaluations = 7
    search._note(np.array([0.5]))
    search.state.evaluations = 20
    search._note(np.array([0.29]))
    assert search.state.history == []
    search.rate_noted()
    (first, worse), (second, better) = search.state.history
    assert (first, second) == (8, 21)
    assert better < worse
    np.testing.assert_allclose(search.state.best, [0.29], atol=1e-9)
    search.rate_noted()  # once
    assert len(search.state.history) == 2
