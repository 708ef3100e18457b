"""Linear least squares within bounds: the active set of Stark and Parker (1995).

Stark, P. B. and Parker, R. L., Comput. Stat. 10, 129-141. `scipy.optimize.lsq_linear` does the same
and takes longer to import than a descent takes.
"""

import numpy as np

_SMALL = 1e-10  # of the largest slope: what counts as none


def bounded_squares(
    matrix: np.ndarray, target: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """The x (d,) within bounds at which ``|matrix x - target|`` is least.

    Parameters
    ----------
    matrix : (K, d) array
    target : (K,) array
    low, high : (d,) arrays, ``low <= 0 <= high``: it sets out from zero
    """
    size = np.linalg.norm(matrix, axis=0)
    seen = size > _SMALL * size.max(initial=0.0)  # less is rounding
    size[~seen] = 1.0
    scaled = np.where(seen, matrix, 0.0) / size  # columns of length one
    normal, pull = scaled.T @ scaled, scaled.T @ target
    least, most = low, high
    low, high = low * size, high * size
    x, free = np.zeros(len(size)), np.ones(len(size), dtype=bool)
    enough = _SMALL * max(float(np.abs(pull).max(initial=0.0)), 1e-300)
    for _ in range(20 * len(size)):
        f = np.flatnonzero(free)
        held = pull[f] - normal[np.ix_(f, ~free)] @ x[~free]
        way = np.linalg.lstsq(normal[np.ix_(f, f)], held, rcond=None)[0] - x[f]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            room = np.where(way > 0.0, high[f] - x[f], low[f] - x[f]) / way
        room = np.where(way == 0.0, np.inf, room)
        first = int(np.argmin(room)) if f.size else 0
        if f.size and room[first] < 1.0:
            x[f] += max(room[first], 0.0) * way
            x[f[first]] = high[f[first]] if way[first] > 0.0 else low[f[first]]
            free[f[first]] = False
            continue
        x[f] += way
        slope = pull - normal @ x  # downhill
        inward = ~free & (((x <= low) & (slope > enough)) | ((x >= high) & (slope < -enough)))
        inward &= low < high
        if not inward.any():
            break
        free[int(np.argmax(np.where(inward, np.abs(slope), -1.0)))] = True
    return np.clip(x / size, least, most)
