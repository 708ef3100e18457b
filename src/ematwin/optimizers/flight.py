"""Dragonflies moved one after another, compiled: the equations are in `dragonfly`."""

from ematwin.numerics.compile import loop


@loop
def fly(X, V, onward, weights, reaches_food, levy, radius, lower, upper, limit, sums):
    """Move all dragonflies, in place, each seeing where those before it have gone already.

    Parameters
    ----------
    X, V : (N, d) places and steps, changed in place
    onward : (N, d) terms of the steps that do not depend on neighbours
    weights : (3, N, d) of separation, alignment and cohesion
    reaches_food : (N,) bool; levy : (N, d) flights of those that have no neighbours either
    radius, lower, upper, limit : (d,) of neighbours, of the box, of a step
    sums : (2, d) room for the sums over neighbours
    """
    count, dimension = X.shape
    for i in range(count):
        n = 0
        for k in range(dimension):
            sums[0, k] = sums[1, k] = 0.0
        for j in range(count):
            neighbour = True
            for k in range(dimension):
                distance = abs(X[j, k] - X[i, k])
                neighbour &= 0.0 < distance <= radius[k]
            if neighbour:
                n += 1
                for k in range(dimension):
                    sums[0, k] += X[j, k]
                    sums[1, k] += V[j, k]
        for k in range(dimension):
            x = X[i, k]
            if n > 1:
                C = sums[0, k] / n - x  # and S = -n C
                taken = onward[i, k] + weights[1, i, k] * (sums[1, k] / n)
                taken += (weights[2, i, k] - weights[0, i, k] * n) * C
            elif reaches_food[i]:
                taken = onward[i, k] + weights[1, i, k] * V[i, k]
            else:
                taken = 0.0
                x += levy[i, k] * x
            V[i, k] = min(max(taken, -limit[k]), limit[k])
            X[i, k] = min(max(x + V[i, k], lower[k]), upper[k])
