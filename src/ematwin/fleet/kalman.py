"""Kalman filter and fixed-interval smoother of a level, its slope and two effects of covariates.

    a = (level, slope, effect, effect),   y = a_1 + x_1 a_3 + x_2 a_4 + e

`ematwin.fleet.trend` says what moves the state. Filter: Kalman (1960), J. Basic Eng. 82, 35-45;
smoother: de Jong (1989), J. Am. Stat. Assoc. 84, 1085-1088. A dense solution of the same linear
Gaussian model is in tests/naive.
"""

import math

import numpy as np

from ematwin.numerics.compile import loop


@loop
def filtered(time, value, variance, covariates, start, spread, after, acceleration, q_level,
             q_slope, jump, reset, mean, cov, gain, innovation, power):  # fmt: skip
    """Kalman filter; fills predicted states (n, 4), covariances (n, 4, 4), gains, innovations.

    ``jump`` (n,) is variance added to the level before an estimate; where it is positive the
    slope starts anew, with the mean and spread ``after``. ``reset`` (n,) starts level and slope
    anew. ``acceleration`` is the drift of the slope. Gives the log likelihood. After
    the last estimate the filtered state stands in row n.
    """
    n = time.size
    a = start.copy()
    p = np.zeros((4, 4))
    for j in range(4):
        p[j, j] = spread[j] ** 2
    told = 0.0
    for i in range(n):
        if i > 0:
            dt = time[i] - time[i - 1]
            a[0] += dt * (a[1] + 0.5 * dt * acceleration)
            a[1] += dt * acceleration
            for j in range(4):  # P <- T P T', rows and then columns
                p[0, j] += dt * p[1, j]
            for j in range(4):
                p[j, 0] += dt * p[j, 1]
            p[0, 0] += q_level * dt
            p[1, 1] += q_slope * dt
        if reset[i]:
            for j in range(2):
                a[j] = start[j]
                for k in range(4):
                    p[j, k] = 0.0
                    p[k, j] = 0.0
                p[j, j] = spread[j] ** 2
        if jump[i] > 0.0:
            p[0, 0] += jump[i]
            a[1] = after[0]
            for k in range(4):
                p[1, k] = 0.0
                p[k, 1] = 0.0
            p[1, 1] = after[1] ** 2
        mean[i] = a
        cov[i] = p
        x1, x2 = covariates[i, 0], covariates[i, 1]
        seen = a[0] + x1 * a[2] + x2 * a[3]
        innovation[i] = value[i] - seen
        if math.isinf(variance[i]):
            power[i] = math.inf
            gain[i] = 0.0
            continue
        f = variance[i]
        for j in range(4):
            gain[i, j] = p[j, 0] + x1 * p[j, 2] + x2 * p[j, 3]
        f += gain[i, 0] + x1 * gain[i, 2] + x2 * gain[i, 3]
        power[i] = f
        for j in range(4):
            gain[i, j] /= f
        for j in range(4):
            a[j] += gain[i, j] * innovation[i]
            for k in range(4):
                p[j, k] -= gain[i, j] * gain[i, k] * f
        told -= 0.5 * (math.log(2.0 * math.pi * f) + innovation[i] ** 2 / f)
    mean[n] = a
    cov[n] = p
    return told


@loop
def smoothed(time, covariates, jump, reset, mean, cov, gain, innovation, power,
            score, weight, residual, precision, smooth, error):  # fmt: skip
    """Fixed-interval smoother (de Jong 1989; Durbin and Koopman, sec. 4.4).

    Fills the score r (n, 4) and weight N (n, 4, 4) of shocks to the state before each estimate,
    residual u and precision D of each estimate, and the smoothed state with its variances (n, 4).
    """
    n = time.size
    r = np.zeros(4)
    m = np.zeros((4, 4))
    mk, z = np.zeros(4), np.zeros(4)
    z[0] = 1.0
    for i in range(n - 1, -1, -1):
        if i < n - 1:  # back through what lies between this estimate and the next
            if jump[i + 1] > 0.0:
                r[1] = 0.0
                m[1, :] = 0.0
                m[:, 1] = 0.0
            if reset[i + 1]:
                r[:2] = 0.0
                m[:2, :] = 0.0
                m[:, :2] = 0.0
            dt = time[i + 1] - time[i]
            r[1] += dt * r[0]
            for j in range(4):
                m[1, j] += dt * m[0, j]
            for j in range(4):
                m[j, 1] += dt * m[j, 0]
        z[2], z[3] = covariates[i, 0], covariates[i, 1]
        if math.isinf(power[i]):
            residual[i] = 0.0
            precision[i] = 0.0
        else:
            k = gain[i]
            u, d = innovation[i] / power[i], 1.0 / power[i]
            for j in range(4):
                mk[j] = 0.0
                for h in range(4):
                    mk[j] += m[j, h] * k[h]
                u -= k[j] * r[j]
                d += k[j] * mk[j]
            residual[i] = u
            precision[i] = d
            for j in range(4):
                r[j] += z[j] * u
                for h in range(4):  # (I - k z')' N (I - k z') + z z'/F
                    m[j, h] += z[j] * z[h] * d - z[j] * mk[h] - mk[j] * z[h]
        score[i] = r
        weight[i] = m
        p = cov[i]
        for j in range(4):
            smooth[i, j] = mean[i, j]
            error[i, j] = p[j, j]
            for h in range(4):
                smooth[i, j] += p[j, h] * r[h]
                for g in range(4):
                    error[i, j] -= p[j, h] * m[h, g] * p[g, j]
