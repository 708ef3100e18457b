"""Kalman filter and fixed-interval smoother of a level whose slope changes, with covariates.

    a = (level, slope, acceleration, effect, effect),   y = a_1 + x_1 a_4 + x_2 a_5 + e

`ematwin.fleet.trend` says what moves the state. Filter: Kalman (1960), J. Basic Eng. 82, 35-45;
smoother: de Jong (1989), J. Am. Stat. Assoc. 84, 1085-1088. A dense solution of the same linear
Gaussian model is in tests/naive.
"""

# No slices of arrays, with which numba takes three times as long to compile.

import math

import numpy as np

from ematwin.numerics.compile import loop
from ematwin.numerics.lanes import lane_loop

_LANES = 64  # draws side by side: their states stay in the first cache


@lane_loop
def filtered(time, value, error, covariates, used, jump, reset, draws, mean, cov, told,
             states, covariances, gain, innovation, power):  # fmt: skip
    """Kalman filter for N draws of the wear (`ematwin.fleet.trend.Draws`), side by side.

    ``jump`` (n,) is variance added to the level before an estimate; where it is positive slope and
    acceleration start anew, the slope with the sixth mean and spread. ``reset`` (n,) starts
    all but the effects anew; ``used`` (n,) says which estimates count. Fills the level, slope and
    acceleration after the last estimate, ``mean`` (N, 3) and ``cov`` (N, 3, 3), and the log
    likelihoods ``told`` (N,).

    For one draw the predicted ``states`` (n, 5), ``covariances`` (n, 5, 5), gains (n, 5),
    innovations and their variances (n,) are filled as well; for several these have no rows.
    """
    keeps = len(power) > 0
    s = np.empty((5, 6, _LANES))  # covariance, and the mean in the last column
    g = np.empty((6, _LANES))  # covariances with an estimate, less its innovation
    q_level, q_slope = np.empty(_LANES), np.empty(_LANES)
    f, share, product = np.empty(_LANES), np.empty(_LANES), np.ones(_LANES)
    told[:] = 0.0
    for begin in range(0, draws.q_level.size, _LANES):
        lanes = min(_LANES, draws.q_level.size - begin)
        for m in range(lanes):
            q_level[m], q_slope[m] = draws.q_level[begin + m], draws.q_slope[begin + m]
            for j in range(5):
                for k in range(5):
                    s[j, k, m] = 0.0
                s[j, j, m] = draws.spread[begin + m, j] ** 2
                s[j, 5, m] = draws.mean[begin + m, j]
        for i in range(time.size):
            if i > 0:
                dt = time[i] - time[i - 1]
                rise = -draws.lasting * math.expm1(-dt / draws.lasting)
                climb, left = draws.lasting * (dt - rise), math.exp(-dt / draws.lasting)
                for k in range(6):
                    for m in range(lanes):
                        s[0, k, m] += dt * s[1, k, m] + climb * s[2, k, m]
                        s[1, k, m] += rise * s[2, k, m]
                        s[2, k, m] *= left
                for j in range(5):
                    for m in range(lanes):
                        s[j, 0, m] += dt * s[j, 1, m] + climb * s[j, 2, m]
                        s[j, 1, m] += rise * s[j, 2, m]
                        s[j, 2, m] *= left
                for m in range(lanes):
                    s[0, 0, m] += q_level[m] * dt
                    s[1, 1, m] += q_slope[m] * dt
            if reset[i] or jump[i] > 0.0:
                for m in range(lanes):
                    for j in range(0 if reset[i] else 1, 3):
                        for k in range(5):
                            s[j, k, m] = 0.0
                            s[k, j, m] = 0.0
                        s[j, j, m] = draws.spread[begin + m, j] ** 2
                        s[j, 5, m] = draws.mean[begin + m, j]
                    if jump[i] > 0.0:
                        s[0, 0, m] += jump[i]
                        s[1, 5, m] = draws.mean[begin + m, 5]
                        s[1, 1, m] = draws.spread[begin + m, 5] ** 2
            if i % 8 == 0:  # one logarithm for eight
                for m in range(lanes):
                    told[begin + m] -= 0.5 * math.log(product[m])
                    product[m] = 1.0
            x1, x2 = covariates[i, 0], covariates[i, 1]
            if keeps:
                innovation[i] = value[i] - s[0, 5, 0] - x1 * s[3, 5, 0] - x2 * s[4, 5, 0]
                power[i] = math.inf
                for j in range(5):
                    states[i, j] = s[j, 5, 0]
                    gain[i, j] = 0.0
                    for k in range(5):
                        covariances[i, j, k] = s[j, k, 0]
            if not used[i]:
                continue
            for k in range(6):
                for m in range(lanes):
                    g[k, m] = s[0, k, m] + x1 * s[3, k, m] + x2 * s[4, k, m]
            for m in range(lanes):
                g[5, m] -= value[i]
                f[m] = draws.occasion[begin + m] ** 2 + (draws.scale[begin + m] * error[i]) ** 2
                f[m] += g[0, m] + x1 * g[3, m] + x2 * g[4, m]
                told[begin + m] -= 0.5 * g[5, m] ** 2 / f[m]
                product[m] *= 2.0 * math.pi * f[m]
            if keeps:
                power[i] = f[0]
                for j in range(5):
                    gain[i, j] = g[j, 0] / f[0]
            for j in range(5):
                for m in range(lanes):
                    share[m] = g[j, m] / f[m]
                for k in range(6):
                    for m in range(lanes):
                        s[j, k, m] -= share[m] * g[k, m]
        for m in range(lanes):
            told[begin + m] -= 0.5 * math.log(product[m])
            product[m] = 1.0
            for j in range(3):
                mean[begin + m, j] = s[j, 5, m]
                for k in range(3):
                    cov[begin + m, j, k] = s[j, k, m]


@loop
def smoothed(time, covariates, lasting, jump, reset, mean, cov, gain, innovation, power,
            score, weight, residual, precision, variance, smooth):  # fmt: skip
    """Fixed-interval smoother (de Jong 1989; Durbin and Koopman, sec. 4.4).

    Fills, (n,) each, score r and weight N of a shock to the level before each estimate, residual u
    and precision D of each estimate, and the variance of the smoothed level; and the smoothed
    states (n, 5).
    """
    n = time.size
    r = np.zeros(5)
    m = np.zeros((5, 5))
    mk, z = np.zeros(5), np.zeros(5)
    z[0] = 1.0
    for i in range(n - 1, -1, -1):
        if i < n - 1:  # back through what lies between this estimate and the next
            if reset[i + 1] or jump[i + 1] > 0.0:
                first = 0 if reset[i + 1] else 1
                for j in range(first, 3):
                    r[j] = 0.0
                    for h in range(5):
                        m[j, h] = 0.0
                        m[h, j] = 0.0
            dt = time[i + 1] - time[i]
            rise = -lasting * math.expm1(-dt / lasting)
            climb, left = lasting * (dt - rise), math.exp(-dt / lasting)
            r[2] = climb * r[0] + rise * r[1] + left * r[2]
            r[1] += dt * r[0]
            for j in range(5):
                m[2, j] = climb * m[0, j] + rise * m[1, j] + left * m[2, j]
                m[1, j] += dt * m[0, j]
            for j in range(5):
                m[j, 2] = climb * m[j, 0] + rise * m[j, 1] + left * m[j, 2]
                m[j, 1] += dt * m[j, 0]
        z[3], z[4] = covariates[i, 0], covariates[i, 1]
        if math.isinf(power[i]):
            residual[i] = 0.0
            precision[i] = 0.0
        else:
            u, d = innovation[i] / power[i], 1.0 / power[i]
            for j in range(5):
                mk[j] = 0.0
                for h in range(5):
                    mk[j] += m[j, h] * gain[i, h]
                u -= gain[i, j] * r[j]
                d += gain[i, j] * mk[j]
            residual[i] = u
            precision[i] = d
            for j in range(5):
                r[j] += z[j] * u
                for h in range(5):  # (I - k z')' N (I - k z') + z z'/F
                    m[j, h] += z[j] * z[h] * d - z[j] * mk[h] - mk[j] * z[h]
        score[i], weight[i], variance[i] = r[0], m[0, 0], cov[i, 0, 0]
        for j in range(5):
            smooth[i, j] = mean[i, j]
            for h in range(5):
                smooth[i, j] += cov[i, j, h] * r[h]
                variance[i] -= cov[i, 0, j] * m[j, h] * cov[i, h, 0]
