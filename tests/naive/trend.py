"""The linear Gaussian model of a trend as one dense system, solved at once: no recursion."""

import numpy as np
from scipy.linalg import expm
from scipy.stats import multivariate_normal


def dense(time, value, variance, covariates, wear, jumps=(), resets=()):
    """Posterior means (n, 5) and covariances (n, 5, 5) of all states, and the log evidence.

    States stand below one another in one normal vector; its covariance is filled block by block
    from x_i = T x_(i-1) + w, and conditioned on all estimates at once.
    """
    n = len(time)
    mean, cov = np.zeros(5 * n), np.zeros((5 * n, 5 * n))
    m, p = wear.mean[:5].copy(), np.diag(wear.spread[:5] ** 2)
    for i in range(n):
        here = slice(5 * i, 5 * i + 5)
        if i:
            dt = time[i] - time[i - 1]
            move = np.eye(5)
            law = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / wear.lasting]])
            move[:3, :3] = expm(law * dt)
            push = np.zeros(5)
            noise = np.diag([wear.q_level * dt, wear.q_slope * dt, 0.0, 0.0, 0.0])
            if i in jumps:
                move[1:3], push[1:3] = 0.0, wear.mean[[5, 2]]
                noise[0, 0] += wear.size**2
                noise[1:3, 1:3] = np.diag(wear.spread[[5, 2]] ** 2)
            if i in resets:
                move[:3], push[:3] = 0.0, wear.mean[:3]
                noise[:3, :3] = np.diag(wear.spread[:3] ** 2)
            before = slice(5 * i - 5, 5 * i)
            m, p = move @ m + push, move @ p @ move.T + noise
            cov[here, : 5 * i] = move @ cov[before, : 5 * i]
            cov[: 5 * i, here] = cov[here, : 5 * i].T
        mean[here], cov[here, here] = m, p
    used = np.isfinite(variance)
    seen = np.zeros((n, 5 * n))
    for i in range(n):
        seen[i, 5 * i : 5 * i + 5] = [1.0, 0.0, 0.0, *covariates[i]]
    seen = seen[used]
    spread = seen @ cov @ seen.T + np.diag(variance[used])
    gain = cov @ seen.T @ np.linalg.inv(spread)
    posterior = mean + gain @ (value[used] - seen @ mean)
    left = cov - gain @ seen @ cov
    told = multivariate_normal(seen @ mean, spread).logpdf(value[used])
    blocks = np.array([left[5 * i : 5 * i + 4, 5 * i : 5 * i + 5] for i in range(n)])
    return posterior.reshape(n, 5), blocks, told
