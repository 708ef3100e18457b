"""Covariance of the values that a search found.

With J the Jacobian (d, S) of the weighted residuals r at the answer, A = J J^T, and the recording
cut into blocks b,

    cov = A^-1 (sum_b g_b g_b^T) A^-1 B/(B - 1),   g_b = J_b r_b,

the cluster-robust ("sandwich") form (Liang and Zeger 1986): the residual is not white noise but the
twin's own error, alike from sample to sample, and independent samples would be counted far too
often otherwise.

That still leaves out an error of the twin which pulls the same way in every block. How much that
is was measured for the brushless actuator where the truth is known: on records of the reference
model, 95 % of the errors lie within 2 standard errors once these are multiplied by the model's
`model_error` (``python benchmarks/identification.py --coverage``). On a real rig the twin errs
more; then the standard errors are a lower bound.
"""

import numpy as np

from ematwin.estimation.problem import Problem

_BLOCKS = 20
_DIFFERENCE = 2e-3  # of the range of an unknown


def covariance(problem: Problem, point: np.ndarray, model_error: float = 1.0) -> np.ndarray:
    """Covariance (d, d) of the free unknowns at a point (d,).

    An unknown that the recordings do not determine has an infinite variance and no covariance with
    the others. Takes one simulation for each free unknown and one more.

    Parameters
    ----------
    problem : Problem
    point : (d,) array, values of its free unknowns
    model_error : factor on the standard errors
    """
    d = len(point)
    undetermined = np.diag(np.full(d, np.inf))
    width = problem.upper - problem.lower
    # towards the inside, and far enough to see through the roughness of impacts
    share = (point - problem.lower) / width
    signed = np.where(share < 0.5, _DIFFERENCE, -_DIFFERENCE) * width
    rows = np.tile(point, (d + 1, 1))
    rows[np.arange(1, d + 1), np.arange(d)] += signed
    residuals = problem.residuals(rows)
    if not np.isfinite(residuals).all():
        return undetermined
    jacobian = (residuals[1:] - residuals[0]) / (signed / width)[:, None]
    size = np.sqrt(np.einsum("ds,ds->d", jacobian, jacobian))
    # an unknown that moves the answer by less than a millionth of the strongest is not seen
    seen = size > 1e-6 * max(float(size.max()), 1e-300)
    if not seen.any():
        return undetermined
    scaled = jacobian[seen] / size[seen][:, None]
    values, vectors = np.linalg.eigh(scaled @ scaled.T)
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    blocks = np.array_split(np.arange(residuals.shape[1]), _BLOCKS)
    g = np.array([scaled[:, block] @ residuals[0][block] for block in blocks])
    found = inverse @ (g.T @ g) @ inverse * _BLOCKS / (_BLOCKS - 1)
    unit = model_error * width[seen] / size[seen]
    found = found * np.outer(unit, unit)
    # nearly the same change of the answer as a mixture of others: no blocks can tell them apart
    apart = np.sqrt(1.0 / np.maximum(np.diag(inverse), 1.0)) >= 1e-3
    known = np.flatnonzero(seen)[apart]
    result = undetermined
    result[np.ix_(known, known)] = found[np.ix_(apart, apart)]
    return result
