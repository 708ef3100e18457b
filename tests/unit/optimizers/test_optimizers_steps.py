"""One step of each method, on examples small enough to work out by hand."""

import itertools
import math

import numpy as np
import pytest

from ematwin.errors import InputError
from ematwin.optimizers import Box, DifferentialEvolution, Dragonfly, GreyWolf, ParticleSwarm, Whale
from ematwin.optimizers.differential_evolution import bounced_back, others
from ematwin.optimizers.genetic_algorithm import Polynomial, Roulette, SimulatedBinary, Tournament
from ematwin.optimizers.particle_swarm import Coefficients, Global, GrowingRing, Ring
from naive import optimizers_naive as naive

WIDE = Box([-100.0, -100.0], [100.0, 100.0])
VAST = Box([-1e6, -1e6], [1e6, 1e6])


class Scripted:
    """A generator of random numbers that gives what it was told, in any shape."""

    def __init__(self, *answers):
        self.answers = list(answers)

    def _next(self, shape):
        return np.broadcast_to(np.asarray(self.answers.pop(0)), shape).copy()

    def random(self, size=()):
        return self._next(size)

    def integers(self, low, high=None, size=()):
        return self._next(size)


def start(optimizer, points, costs, *others):
    """Put an optimiser behind its first batch, which lies at ``points``.

    ``others`` are further points of the box that it draws for its start.
    """
    box = optimizer.box
    drawn = [(np.array(some, dtype=float) - box.lower) / box.span for some in (points, *others)]
    optimizer.rng = Scripted(*drawn)
    batch = optimizer.ask()
    assert batch == pytest.approx(np.array(points, dtype=float), abs=1e-15 * box.span.max())
    optimizer.tell(batch, np.array(costs, dtype=float))


def test_grey_wolf_leaders_equal_those_of_the_wolf_by_wolf_comparison():
    rng = np.random.default_rng(0)
    for _ in range(50):
        wolves = GreyWolf(Box([-1.0], [1.0]), population=12, iterations=5)
        scores = [math.inf] * 3
        for _ in range(3):
            costs = rng.integers(0, 15, size=12).astype(float)
            points = wolves.ask()
            wolves.tell(points, costs)
            for f in costs:
                if f < scores[0]:
                    scores[0] = f
                if scores[0] < f < scores[1]:
                    scores[1] = f
                if f > scores[0] and f > scores[1] and f < scores[2]:
                    scores[2] = f
        assert wolves.leader_costs.tolist() == scores


def test_searching_whales_see_those_before_them_where_they_have_gone():
    random = np.random.default_rng(2)
    count, leader = 30, np.array([0.5, -0.5])
    whales = Whale(VAST, population=count, iterations=10)
    places = random.normal(size=(count, 2))
    places[0] = leader
    start(whales, places, np.arange(float(count)))
    r1, r2, p = random.random((3, count))
    r1[1::2], p[1::2] = 0.75 + 0.25 * r1[1::2], 0.1  # |A| >= 1: every other one searches
    r1[::2], p[::2] = 0.25 + 0.5 * r1[::2], 0.2  # |A| < 1: the others encircle the leader
    drawn = random.integers(count, size=(count // 2, 2))
    whales.rng = Scripted(np.array([r1, r2, r1, p])[:, :, None], drawn)
    A, C = 4.0 * r1 - 2.0, 2.0 * r2  # a = 2 in the first iteration
    now = places.copy()
    for i in range(count):
        for j in range(2):
            other = now[drawn[i // 2, j], j] if i % 2 else leader[j]
            now[i, j] = other - A[i] * abs(C[i] * other - places[i, j])
    assert whales.ask() == pytest.approx(now, abs=1e-7)


class Shared:
    """The same random numbers for a method of arrays and for one of plain loops."""

    def __init__(self, seed, count, dimension):
        self.uniform = np.random.default_rng(seed)
        self.normal = np.random.default_rng(seed + 1).normal(size=(2, count, dimension))
        self.singles = itertools.cycle(self.normal.transpose(1, 2, 0).ravel().tolist())

    def random(self, size=None):
        return self.uniform.random(size)

    def standard_normal(self, size):
        assert size == self.normal.shape
        return self.normal

    def gauss(self, mean, deviation):
        return next(self.singles)


@pytest.mark.parametrize("seed", range(5))
def test_dragonflies_move_one_after_another(seed):
    """All points of a search are those of the plain loop over dragonflies."""
    lower, upper = [-1.0, 0.0, 2.0], [1.0, 4.0, 3.0]
    flies = Dragonfly(Box(lower, upper), population=12, iterations=10)
    flies.rng = Shared(seed, 12, 3)
    places, slow = [], []
    # the best point is in a corner, so that many cannot see it and some rest on a bound
    cost = np.array([1.0, 0.2, -3.0])
    for _ in range(10):
        points = flies.ask()
        places.append(points)
        flies.tell(points, points @ cost)

    def plain(x):
        slow.append(list(x))
        return float(np.array(x) @ cost)

    naive.dragonfly(plain, lower, upper, 12, 10, Shared(seed, 12, 3))
    places, slow = np.concatenate(places), np.array(slow)
    assert np.abs(places - slow).max() < 1e-9
    assert ((places == lower) | (places == upper)).any(axis=0).all()


def test_the_enemy_of_dragonflies_is_strictly_inside_the_box():
    flies = Dragonfly(Box([0.0], [1.0]), population=3, iterations=10)
    start(flies, [[0.0], [0.5], [0.2]], [9.0, 2.0, 3.0], [[0.0]])
    assert flies.enemy.tolist() == [0.2]
    assert flies.food.tolist() == [0.5]


def test_a_particle_stops_at_a_bound_and_loses_that_speed():
    swarm = ParticleSwarm(
        Box([0.0, 0.0], [1.0, 1.0]),
        population=1,
        iterations=10,
        coefficients=Coefficients(1.0, 0.0, 0.0),
        crazy=0.0,
    )
    start(swarm, [[0.6, 0.1]], [1.0], [[1.0, 0.3]])  # a speed of (0.2, 0.1)
    swarm.rng = Scripted(*[0.0] * 4)
    for place in ([0.8, 0.2], [1.0, 0.3], [1.0, 0.4]):
        assert swarm.ask()[0] == pytest.approx(place)
        swarm.tell(swarm.ask(), np.array([1.0]))
    swarm.coefficients = Coefficients(-1.0, 0.0, 0.0)  # back, with what speed there is
    assert swarm.ask()[0] == pytest.approx([1.0, 0.3])


@pytest.mark.parametrize(("topology", "beside"), [(Global(), [0, 0]), (Ring(1), [17, 0])])
def test_craziness_puts_the_worst_particles_beside_their_neighbours_best_point(topology, beside):
    swarm = ParticleSwarm(
        Box([0.0] * 4, [1.0] * 4), population=20, iterations=10, seed=2, topology=topology
    )
    costs = np.arange(20.0)
    points = swarm.ask()
    swarm.tell(points, costs)
    crazy = swarm.ask()[-2:]  # 10 % of 20
    changed = (crazy != points[beside]).sum(axis=1)
    assert changed.max() < 4
    assert np.abs(crazy - points[beside]).max() < 0.5


@pytest.mark.parametrize("picks", [2, 3, 4])
def test_donors_are_different_and_not_the_parent(picks):
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(2000):
        drawn = np.vstack([np.arange(6), others(rng, 6, picks)])
        for column in drawn.T:
            assert len(set(column.tolist())) == picks + 1
        seen |= {tuple(column) for column in drawn.T.tolist()}
    assert len(seen) == math.perm(6, picks + 1)  # every choice is possible


def test_mutants_outside_the_box_bounce_back():
    box = Box([0.0, 0.0], [1.0, 1.0])
    mutants, bases = np.array([[-0.4, 0.5], [0.3, 1.6]]), np.array([[0.2, 0.2], [0.3, 0.4]])
    bounced = bounced_back(Scripted(0.5), box, mutants, bases)
    assert bounced == pytest.approx(np.array([[0.1, 0.5], [0.3, 0.7]]))


def test_the_best_of_each_tournament_wins_and_everyone_is_drawn():
    costs = np.array([3.0, 1.0, 2.0, 0.0])
    won = Tournament(2).select(np.random.default_rng(0), costs, 4)
    assert (won == 3).sum() == 2  # drawn twice in four pairs, it wins each time
    everyone = Tournament(1).select(np.random.default_rng(0), costs, 4)
    assert sorted(everyone.tolist()) == [0, 1, 2, 3]


def test_children_of_real_parents_lie_on_the_line_through_them_when_crossed_whole():
    rng = np.random.default_rng(5)
    first, second = rng.normal(size=(2, 200, 2))
    crossover = SimulatedBinary(whole=1.0, probability=1.0)
    one, other = crossover.cross(rng, VAST, first, second)
    direction = second - first
    for child in (one, other):
        cross = (child - first)[:, 0] * direction[:, 1] - (child - first)[:, 1] * direction[:, 0]
        assert np.abs(cross).max() < 1e-6  # bounds nearby would bend the line


def test_children_of_real_parents_are_spread_evenly_about_their_parents():
    rng = np.random.default_rng(6)
    first, second = rng.normal(size=(2, 500, 2))
    one, other = SimulatedBinary(whole=0.0, probability=1.0, eta=2.0).cross(
        rng, VAST, first, second
    )
    assert (one + other) == pytest.approx(first + second, abs=1e-6)
    contracted = np.abs(one - other) < np.abs(first - second)
    assert contracted.mean() == pytest.approx(0.5, abs=0.05)


def test_polynomial_mutation_stays_in_the_box_and_moves_one_variable_on_average():
    rng = np.random.default_rng(7)
    box = Box([0.0] * 5, [1.0] * 5)
    points = rng.random((4000, 5)) ** 4
    moved = Polynomial().mutate(rng, box, points)
    assert box.contains(moved)
    assert (moved != points).sum(axis=1).mean() == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    "make",
    [
        lambda: DifferentialEvolution(WIDE, F=0.0),
        lambda: DifferentialEvolution(WIDE, CR=1.5),
        lambda: ParticleSwarm(WIDE, coefficients=Coefficients(1, 1, 1, speed_limit=0.0)),
        lambda: Ring(0),
        lambda: GrowingRing(0.0),
        lambda: Tournament(0),
        lambda: SimulatedBinary(eta=-1.0),
        lambda: GreyWolf(WIDE, start=0.0),
        lambda: Whale(WIDE, power=math.nan),
        lambda: Dragonfly(WIDE, step_limit=-1.0),
    ],
)
def test_impossible_settings_are_refused(make):
    with pytest.raises(InputError):
        make()


def test_a_roulette_of_equals_or_of_none_finite_draws_all_alike():
    for costs in (np.full(4, 2.0), np.full(4, np.inf)):
        drawn = Roulette().select(np.random.default_rng(1), costs, 8_000)
        assert np.bincount(drawn) / 8_000 == pytest.approx([0.25] * 4, abs=0.02)
