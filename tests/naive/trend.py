"""The linear Gaussian model of a trend as one dense system, solved at once: no recursion."""

import numpy as np
from scipy.stats import multivariate_normal


def dense(time, value, variance, covariates, wear, jumps=(), resets=()):
    """Posterior means (n, 4) and covariances (n, 4, 4) of all states, and the log evidence.

    States stand below one another in one normal vector; its covariance is filled block by block
    from x_i = T x_(i-1) + w, and conditioned on all estimates at once.
    """
    n = len(time)
    mean, cov = np.zeros(4 * n), np.zeros((4 * n, 4 * n))
    m, p = wear.mean.copy(), np.diag(wear.spread**2)
    for i in range(n):
        here = slice(4 * i, 4 * i + 4)
        if i:
            dt = time[i] - time[i - 1]
            move = np.eye(4)
            move[0, 1] = dt
            push = wear.acceleration * np.array([dt**2 / 2, dt, 0.0, 0.0])
            noise = np.diag([wear.q_level * dt, wear.q_slope * dt, 0.0, 0.0])
            if i in jumps:
                move[1], push[1] = 0.0, wear.after[0]
                noise[0, 0] += wear.size**2
                noise[1, 1] = wear.after[1] ** 2
            if i in resets:
                move[:2], push[:2] = 0.0, wear.mean[:2]
                noise[:2, :2] = np.diag(wear.spread[:2] ** 2)
            before = slice(4 * i - 4, 4 * i)
            m, p = move @ m + push, move @ p @ move.T + noise
            cov[here, : 4 * i] = move @ cov[before, : 4 * i]
            cov[: 4 * i, here] = cov[here, : 4 * i].T
        mean[here], cov[here, here] = m, p
    used = np.isfinite(variance)
    seen = np.zeros((n, 4 * n))
    for i in range(n):
        seen[i, 4 * i : 4 * i + 4] = [1.0, 0.0, *covariates[i]]
    seen = seen[used]
    spread = seen @ cov @ seen.T + np.diag(variance[used])
    gain = cov @ seen.T @ np.linalg.inv(spread)
    posterior = mean + gain @ (value[used] - seen @ mean)
    left = cov - gain @ seen @ cov
    told = multivariate_normal(seen @ mean, spread).logpdf(value[used])
    blocks = np.array([left[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] for i in range(n)])
    return posterior.reshape(n, 4), blocks, told
