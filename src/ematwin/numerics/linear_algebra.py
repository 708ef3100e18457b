"""Small matrices: symmetric ones, least squares within bounds, and transitions of sampled loops."""

from collections.abc import Callable

import numpy as np

_SMALL = 1e-10  # of the largest slope: what counts as none


def inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix; directions without information get a large variance."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = eigen(information / np.outer(scale, scale))
    found = (vectors / np.maximum(values, 1e-10)) @ vectors.T
    return np.asarray(found / np.outer(scale, scale))


def eigen(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (d,) and eigenvectors (d, d) of a symmetric matrix.

    LAPACK's divide and conquer fails on some sound matrices; QR iterations do not.
    """
    try:
        return tuple(np.linalg.eigh(matrix))  # type: ignore[return-value]
    except np.linalg.LinAlgError:
        from scipy.linalg import eigh  # here, for it takes long to import

        return tuple(eigh(matrix, driver="ev"))


def bounded_squares(
    matrix: np.ndarray, target: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """The x (d,) within bounds, ``low <= 0 <= high``, at which ``|matrix x - target|`` is least.

    The active set of Stark and Parker (1995), Comput. Stat. 10, 129-141, as
    `scipy.optimize.lsq_linear`, which takes longer to import than a descent takes. The matrix is
    (K, d), the target (K,).
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
        way = _solved(normal[np.ix_(f, f)], held) - x[f]
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


def _solved(normal: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """The x (d,) with ``normal x = pull``, of a covariance whose diagonal is one; shortest of many.

    By elimination where that is sure: singular values take ten times as long.
    """
    try:
        pivots = np.diag(np.linalg.cholesky(normal))
    except np.linalg.LinAlgError:
        pivots = np.zeros(1)
    if pivots.min(initial=1.0) > 1e-4:  # of columns of length one
        return np.asarray(np.linalg.solve(normal, pull))
    return np.asarray(np.linalg.lstsq(normal, pull, rcond=None)[0])


def spectral_radius(transition: np.ndarray) -> float:
    """Largest magnitude of an eigenvalue of a (n, n) transition; below 1 it is stable.

    Franklin, Powell and Workman (1998), Digital Control of Dynamic Systems, chapters 4 and 5.
    """
    return float(np.abs(np.linalg.eigvals(transition)).max())


def largest_share(stable: Callable[[float], bool]) -> float:
    """The share of 1 up to which a loop is stable; 0 if it is at none."""
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
