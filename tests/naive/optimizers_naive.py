"""Slow versions of the optimisers: one agent, one variable at a time, in plain Python.

Written from the papers and from how Mirjalili's programs behave, not from the package. Each takes
a cost function of one point (a list) and gives the best cost found.
"""

import math


def _clip(value, low, high):
    return min(max(value, low), high)


def _random_point(rng, lower, upper):
    return [low + rng.random() * (high - low) for low, high in zip(lower, upper, strict=True)]


def grey_wolf(cost, lower, upper, population, iterations, rng):
    d = len(lower)
    wolves = [_random_point(rng, lower, upper) for _ in range(population)]
    alpha, beta, delta = [0.0] * d, [0.0] * d, [0.0] * d
    f_alpha = f_beta = f_delta = math.inf
    for t in range(iterations):
        for i in range(population):
            wolves[i] = [_clip(wolves[i][j], lower[j], upper[j]) for j in range(d)]
            f = cost(wolves[i])
            if f < f_alpha:
                f_alpha, alpha = f, wolves[i]
            if f_alpha < f < f_beta:
                f_beta, beta = f, wolves[i]
            if f > f_alpha and f > f_beta and f < f_delta:
                f_delta, delta = f, wolves[i]
        a = 2 - 2 * t / iterations
        moved = []
        for i in range(population):
            place = []
            for j in range(d):
                total = 0.0
                for leader in (alpha, beta, delta):
                    A = a * (2 * rng.random() - 1)
                    C = 2 * rng.random()
                    total += leader[j] - A * abs(C * leader[j] - wolves[i][j])
                place.append(total / 3)
            moved.append(place)
        wolves = moved
    return f_alpha


def whale(cost, lower, upper, population, iterations, rng):
    d = len(lower)
    whales = [_random_point(rng, lower, upper) for _ in range(population)]
    leader, f_leader = [0.0] * d, math.inf
    for t in range(iterations):
        for i in range(population):
            whales[i] = [_clip(whales[i][j], lower[j], upper[j]) for j in range(d)]
            f = cost(whales[i])
            if f < f_leader:
                f_leader, leader = f, list(whales[i])
        a = 2 - 2 * t / iterations
        a2 = -1 - t / iterations
        for i in range(population):
            A = 2 * a * rng.random() - a
            C = 2 * rng.random()
            l = (a2 - 1) * rng.random() + 1
            p = rng.random()
            for j in range(d):
                x = whales[i][j]
                if p >= 0.5:
                    gap = abs(leader[j] - x)
                    whales[i][j] = gap * math.exp(l) * math.cos(2 * math.pi * l) + leader[j]
                elif abs(A) < 1:
                    whales[i][j] = leader[j] - A * abs(C * leader[j] - x)
                else:
                    other = whales[rng.randrange(population)][j]
                    whales[i][j] = other - A * abs(C * other - x)
    return f_leader


def fly_one_after_another(X, V, drift, weights, radius, span, lower, upper, levy, reaches_food):
    """One iteration of dragonflies with every random number given; changes X and V in place."""
    s, a, c = weights
    population, d = len(X), len(lower)
    for i in range(population):
        friends = []
        for k in range(population):
            gaps = [abs(X[i][j] - X[k][j]) for j in range(d)]
            if all(0 < gaps[j] <= radius[j] for j in range(d)):
                friends.append(k)
        n = len(friends)
        if n <= 1 and not reaches_food[i]:
            for j in range(d):
                X[i][j] = _clip(X[i][j] + levy[i][j] * X[i][j], lower[j], upper[j])
                V[i][j] = 0.0
            continue
        old = list(X[i])
        for j in range(d):
            if n > 1:
                S = -sum(X[k][j] - old[j] for k in friends)
                A = sum(V[k][j] for k in friends) / n
                C = sum(X[k][j] for k in friends) / n - old[j]
            else:
                S, A, C = 0.0, V[i][j], 0.0
            step = drift[i][j] + s[i][j] * S + a[i][j] * A + c[i][j] * C
            V[i][j] = _clip(step, -span[j] / 10, span[j] / 10)
            X[i][j] = _clip(old[j] + V[i][j], lower[j], upper[j])


def dragonfly(cost, lower, upper, population, iterations, rng):
    d = len(lower)
    span = [upper[j] - lower[j] for j in range(d)]
    X = [_random_point(rng, lower, upper) for _ in range(population)]
    V = [_random_point(rng, lower, upper) for _ in range(population)]
    food, f_food = [0.0] * d, math.inf
    enemy, f_enemy = [0.0] * d, -math.inf
    sigma = (math.gamma(2.5) * math.sin(0.75 * math.pi) / (math.gamma(1.25) * 1.5 * 2**0.25)) ** (
        2 / 3
    )
    for t in range(1, iterations + 1):
        radius = [span[j] * (0.25 + 2 * t / iterations) for j in range(d)]
        w = 0.9 - 0.5 * t / iterations
        fade = max(0.0, 0.1 - 0.2 * t / iterations)
        s, a, c = (2 * rng.random() * fade for _ in range(3))
        f = 2 * rng.random()
        for x in X:
            value = cost(x)
            if value < f_food:
                f_food, food = value, list(x)
            if value > f_enemy and all(lower[j] < x[j] < upper[j] for j in range(d)):
                f_enemy, enemy = value, list(x)
        near, drift, weights = [], [], ([], [], [])
        for x, v in zip(X, V, strict=True):
            fed = all(abs(x[j] - food[j]) <= radius[j] for j in range(d))
            scared = all(abs(x[j] - enemy[j]) <= radius[j] for j in range(d))
            terms = [w * v[j] for j in range(d)]
            if fed:
                terms = [terms[j] + f * (food[j] - x[j]) for j in range(d)]
                if scared:
                    terms = [terms[j] + fade * (enemy[j] + x[j]) for j in range(d)]
            near.append(fed)
            drift.append(terms)
        for row, weight in zip(weights, (s, a, c), strict=True):
            row += [[weight if fed else rng.random() for _ in range(d)] for fed in near]
        levy = [
            [0.01 * sigma * rng.gauss(0, 1) / abs(rng.gauss(0, 1)) ** (2 / 3) for _ in range(d)]
            for _ in range(population)
        ]
        fly_one_after_another(X, V, drift, weights, radius, span, lower, upper, levy, near)
    return f_food


def particle_swarm(
    cost, lower, upper, population, iterations, rng, inertia, weight, ring=None, limit=math.inf,
    last=None,
):  # fmt: skip
    d = len(lower)
    X = [_random_point(rng, lower, upper) for _ in range(population)]
    V = []
    for x in X:
        goal = _random_point(rng, lower, upper)
        V.append([0.5 * (there - here) for there, here in zip(goal, x, strict=True)])
    best, f_best = [list(x) for x in X], [math.inf] * population
    for t in range(1, iterations + 1):
        for i in range(population):
            f = cost(X[i])
            if f < f_best[i]:
                f_best[i], best[i] = f, list(X[i])
        for i in range(population):
            reach = (
                round((t / iterations) ** 2 * population / 2) or 1 if ring == "growing" else ring
            )
            if reach is None:
                informers = range(population)
            else:
                informers = [(i + k) % population for k in range(-reach, reach + 1)]
            g = best[min(informers, key=f_best.__getitem__)]
            heaviness = inertia if last is None else inertia + t / iterations * (last - inertia)
            for j in range(d):
                v = heaviness * V[i][j]
                v += weight * rng.random() * (best[i][j] - X[i][j])
                v += weight * rng.random() * (g[j] - X[i][j])
                most = limit * (upper[j] - lower[j])
                v = _clip(v, -most, most)
                X[i][j] += v
                V[i][j] = v if lower[j] <= X[i][j] <= upper[j] else 0.0
                X[i][j] = _clip(X[i][j], lower[j], upper[j])
    return min(f_best)


def differential_evolution(cost, lower, upper, population, iterations, rng, F, CR, best=False):
    d = len(lower)
    X = [_random_point(rng, lower, upper) for _ in range(population)]
    costs = [cost(x) for x in X]
    for _ in range(iterations - 1):
        trials = []
        leader = costs.index(min(costs))
        for i in range(population):
            pool = [k for k in range(population) if k != i]
            r1, r2, r3 = rng.sample(pool, 3)
            base = X[leader] if best else X[r1]
            sure = rng.randrange(d)
            trial = list(X[i])
            for j in range(d):
                if j == sure or rng.random() < CR:
                    value = base[j] + F * (X[r2][j] - X[r3][j])
                    if value < lower[j]:
                        value = lower[j] + rng.random() * (base[j] - lower[j])
                    if value > upper[j]:
                        value = upper[j] + rng.random() * (base[j] - upper[j])
                    trial[j] = value
            trials.append(trial)
        for i in range(population):
            f = cost(trials[i])
            if f <= costs[i]:
                X[i], costs[i] = trials[i], f
    return min(costs)


def _decoded(string, lower, upper, bits, gray):
    """The point of a string of bits, in Gray or in plain code."""
    x = []
    for j, (low, high) in enumerate(zip(lower, upper, strict=True)):
        bit, number = 0, 0
        for place in string[j * bits : (j + 1) * bits]:
            bit = bit ^ place if gray else place
            number = 2 * number + bit
        x.append(low + number / (2**bits - 1) * (high - low))
    return x


def _children(one, two, rng, crossed, flipped):
    """Two children of two strings: one-point crossover, then bits that flip."""
    one, two = list(one), list(two)
    if rng.random() < crossed:
        cut = rng.randrange(1, len(one))
        one[cut:], two[cut:] = two[cut:], one[cut:]
    return [[bit ^ (rng.random() < flipped) for bit in child] for child in (one, two)]


def binary_genetic_algorithm(cost, lower, upper, population, iterations, rng, bits, contest):
    length = len(lower) * bits
    parents = [[rng.randrange(2) for _ in range(length)] for _ in range(population)]
    costs = [cost(_decoded(parent, lower, upper, bits, True)) for parent in parents]
    for _ in range(iterations - 1):
        draws = []
        while len(draws) < contest * population:
            draws += rng.sample(range(population), population)
        winners = [
            min(draws[k * contest : (k + 1) * contest], key=costs.__getitem__)
            for k in range(population)
        ]
        half, children = population // 2, []
        for first, second in zip(winners[:half], winners[half:], strict=False):
            children += _children(parents[first], parents[second], rng, 0.9, 1 / length)
        pool = parents + children
        costs += [cost(_decoded(child, lower, upper, bits, True)) for child in children]
        order = sorted(range(len(pool)), key=costs.__getitem__)[:population]
        parents, costs = [pool[k] for k in order], [costs[k] for k in order]
    return min(costs)


def holland(cost, lower, upper, population, iterations, rng, bits=16, crossed=0.6, flipped=0.001):
    """Holland's plan: roulette over window-scaled fitness, children in their parents' places."""

    def parent():
        turn = rng.random() * sum(fitness)
        for string, share in zip(strings, fitness, strict=True):
            turn -= share
            if turn < 0:
                return string
        return strings[-1]

    length = len(lower) * bits
    strings = [[rng.randrange(2) for _ in range(length)] for _ in range(population)]
    best = math.inf
    for _ in range(iterations):
        costs = [cost(_decoded(string, lower, upper, bits, False)) for string in strings]
        best = min(best, *costs)
        fitness = [max(costs) - f for f in costs]
        if not any(fitness):
            fitness = [1.0] * population
        children = []
        while len(children) < population:
            children += _children(parent(), parent(), rng, crossed, flipped)
        strings = children
    return best
