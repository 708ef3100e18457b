"""Particle swarm optimisation, with the topology as a value.

Kennedy and Eberhart (1995), Particle Swarm Optimization, Proc. IEEE ICNN 4, 1942-1948.

    v <- chi (v + phi1 r1 (p - x) + phi2 r2 (g - x)),   x <- x + v

p is the best point of the particle itself, g the best among its neighbours' (itself included),
r1 and r2 are fresh for every particle and variable.

Departure: the coefficients. The paper of 1995 has no inertia and both weights 2, with which the
swarm does not settle and needs a speed limit. The default is Clerc's standard swarm of 2006 (Clerc,
Particle Swarm Optimization, ISTE 2006): inertia 1 / (2 ln 2), both weights 1/2 + ln 2, with a speed
limit of a fifth of the box. `CONSTRICTION` and `ORIGINAL_1995` are the older forms.
Departure: the paper has no bounds. A particle that would leave the box stops at the bound and that
component of its velocity is set to zero, as in Clerc's standard.
Departure: who informs whom. In the paper every particle knows the best of all, and the swarm is
soon in one place, right or wrong. The authors' second paper of that year (Eberhart and Kennedy
1995, Proc. 6th Int. Symp. Micro Machine and Human Science, 39-43) has a ring beside it, which
gathers more slowly and misses less. By default the ring grows during the run until it is the whole
swarm, as `GrowingRing` says; ``topology=Global()`` is the paper's form.
Departure: craziness. The paper tells that a random disturbance of some particles, "craziness", was
in the first programs and was dropped. A tenth of the swarm is crazy by default, because without it
a swarm of 50 stays in a local minimum of Rastrigin's function (``docs/optimizers.md`` has the
numbers); ``crazy=0`` is the paper's final form.
"""

from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError, whole_number
from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer, positive, probability
from ematwin.optimizers.genetic_algorithm import Polynomial


@dataclass(frozen=True)
class Global:
    """Who informs whom: every particle every other (gbest)."""

    def informants(self, costs: FloatArray, progress: float) -> np.ndarray:
        """(N,) indices: for each particle the neighbour whose best point is best.

        ``progress`` is the share of the iterations that has gone, 0 to 1.
        """
        return np.full(len(costs), np.argmin(costs))


@dataclass(frozen=True)
class Ring:
    """Particles in a circle, each informed by itself and k others on either side (lbest)."""

    k: int = 1

    def __post_init__(self) -> None:
        whole_number(self.k, "The number k of neighbours on either side of a ring", 1)

    def informants(self, costs: FloatArray, progress: float) -> np.ndarray:
        """(N,) indices; the particle itself wins a tie."""
        count = len(costs)
        offsets = sorted(range(-self.k, self.k + 1), key=abs)
        around = (np.arange(count)[:, None] + offsets) % count
        return around[np.arange(count), np.argmin(costs[around], axis=1)]


@dataclass(frozen=True)
class GrowingRing:
    """A ring of one neighbour on either side that grows until it is the whole swarm.

    Suganthan (1999), Particle swarm optimiser with neighbourhood operator, Proc. CEC, 1958-1962:
    a small neighbourhood first, which is enlarged with the iterations until it is the swarm.

    Departure: his neighbours are the particles that are near; these are near on the ring, whose
    order says nothing of places, so that news travels slowly wherever the particles are.
    Departure: his neighbourhood grows evenly; here slowly first, so that the swarm is still spread
    when half of the iterations have gone (measured in ``docs/lab/search-methods.md``).
    """

    # positive: the ring reaches progress ** power of the way to half the swarm on either side
    power: float = 2.0

    def __post_init__(self) -> None:
        positive(self.power, "power of a growing ring")

    def informants(self, costs: FloatArray, progress: float) -> np.ndarray:
        """(N,) indices; the particle itself wins a tie."""
        if progress >= 1.0:
            return Global().informants(costs, progress)
        reach = round(progress**self.power * len(costs) / 2)
        return Ring(max(1, reach)).informants(costs, progress)


@dataclass(frozen=True)
class Coefficients:
    """The weights of the velocity equation."""

    inertia: float  # factor of the old velocity, chi
    own: float  # factor of the pull to the own best point, chi phi1
    neighbours: float  # and to that of the neighbours, chi phi2
    speed_limit: float = np.inf  # spans of the box per iteration, largest speed; infinite for none
    # what ``inertia`` falls to, evenly over the iterations; None: it stays
    last_inertia: float | None = None


_WEIGHT = 0.5 + float(np.log(2.0))
STANDARD_2006 = Coefficients(
    inertia=0.5 / float(np.log(2.0)), own=_WEIGHT, neighbours=_WEIGHT, speed_limit=0.2
)
"""Clerc (2006), with a speed limit."""

CONSTRICTION = Coefficients(inertia=0.72984, own=0.72984 * 2.05, neighbours=0.72984 * 2.05)
"""Clerc and Kennedy (2002)."""

INERTIA_1998 = Coefficients(inertia=0.9, own=2.0, neighbours=2.0, speed_limit=0.5, last_inertia=0.4)
"""Shi and Eberhart (1998), A Modified Particle Swarm Optimizer, Proc. IEEE ICEC, 69-73; the inertia
falls as in their study of 1999, Proc. CEC, 1945-1950, and the speed limit is half the box."""

ORIGINAL_1995 = Coefficients(inertia=1.0, own=2.0, neighbours=2.0, speed_limit=0.5)
"""Kennedy and Eberhart (1995); the speed limit that this form needs is half the box."""


class ParticleSwarm(PopulationOptimizer):
    """Particle swarm optimisation.

    Parameters
    ----------
    topology : ``GrowingRing()`` (default), ``Global()``, ``Ring(k)``, or any object with the same
        method
    coefficients : Coefficients
    crazy : share of the swarm, rounded down, that tries its luck beside the neighbours' best point
        instead of flying on: those whose own best point is worst. Beside the best point of the
        whole swarm they would carry it into every neighbourhood, and a ring would be none
    """

    def __init__(
        self,
        box: Box,
        *,
        topology: Global | Ring | GrowingRing = GrowingRing(),
        coefficients: Coefficients = STANDARD_2006,
        crazy: float = 0.1,
        **settings: int,
    ) -> None:
        super().__init__(box, **settings)
        if not coefficients.speed_limit > 0:
            raise InputError(
                f"The speed limit of a swarm must be positive, received {coefficients.speed_limit}."
            )
        self.topology = topology
        self.coefficients = coefficients
        self.crazy = probability(crazy, "share of crazy particles")
        self.best_points = np.empty((0, box.dimension))
        self.best_costs = np.full(self.population, np.inf)
        self._velocity = np.empty((0, box.dimension))

    def _start(self) -> FloatArray:
        particles = self.box.sample(self.rng, self.population)
        # Half the way to another random point of the box: no first step points far outside it.
        self._velocity = 0.5 * (self.box.sample(self.rng, self.population) - particles)
        self.best_points = particles.copy()
        return particles

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        better = costs < self.best_costs
        self.best_costs[better] = costs[better]
        self.best_points[better] = points[better]

    def limits(self) -> FloatArray:
        """A particle remembers the cost of its best point and no other."""
        return self.best_costs.copy()

    def _move(self) -> FloatArray:
        weights = self.coefficients
        x, p = self.points, self.best_points
        progress = min(self.iteration / self.iterations, 1.0)
        g = p[self.topology.informants(self.best_costs, progress)]
        r1, r2 = self.rng.random((2, *x.shape))
        inertia = weights.inertia
        if weights.last_inertia is not None:
            inertia += progress * (weights.last_inertia - inertia)
        v = (
            inertia * self._velocity
            + weights.own * r1 * (p - x)
            + weights.neighbours * r2 * (g - x)
        )
        if np.isfinite(weights.speed_limit):
            limit = weights.speed_limit * self.box.span
            v = np.clip(v, -limit, limit)
        wanted = x + v
        moved = self.box.clip(wanted)
        self._velocity = np.where(moved == wanted, v, 0.0)
        if count := int(self.crazy * self.population):
            crazy = np.argsort(self.best_costs, kind="stable")[-count:]
            moved[crazy] = Polynomial().mutate(self.rng, self.box, g[crazy])  # with their velocity
        return moved
