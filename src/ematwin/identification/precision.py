"""Standard errors of identified faults.

With J the Jacobian (d, S) of the weighted residuals r at the answer, A = J J^T, and the record cut
into blocks b,

    cov = A^-1 (sum_b g_b g_b^T) A^-1 B/(B - 1),   g_b = J_b r_b,

the cluster-robust ("sandwich") form (Liang and Zeger 1986): what is left over is not white noise
but the twin's own error, alike from sample to sample, and independent samples would be counted far
too often otherwise.

That still leaves out an error of the twin which pulls the same way in every block. How much that
is was measured where the truth is known: on records of the reference model, 95 % of the errors lie
within 2 standard errors once these are multiplied by `MODEL_ERROR`
(``python benchmarks/identification.py --coverage``). On a real rig the twin errs more; then the
standard errors are a lower bound.
"""

import math

import numpy as np

from ematwin.faults import FAULTS
from ematwin.identification.objective import Objective
from ematwin.identification.space import FaultSpace
from ematwin.identification.stretches import Stretches

MODEL_ERROR = 2.5
_BLOCKS = 20
_DIFFERENCE = 2e-3  # of a normalised fault


def standard_errors(
    objective: Objective | Stretches, space: FaultSpace, k: np.ndarray
) -> dict[str, float]:
    """Standard error of each searched fault at a vector ``k`` (8,); infinite if undetermined.

    Takes one simulation for each searched fault and one more.
    """
    free = space.free
    d = len(free)
    rows = np.tile(k, (d + 1, 1))
    # towards the inside, and far enough to see through the roughness of impacts
    signed = np.where(k[free] < 0.5, _DIFFERENCE, -_DIFFERENCE)
    rows[np.arange(1, d + 1), free] += signed
    residuals = objective.residuals(rows)
    if not np.isfinite(residuals).all():
        return dict.fromkeys(space.names, math.inf)
    jacobian = (residuals[1:] - residuals[0]) / signed[:, None]
    size = np.sqrt(np.einsum("ds,ds->d", jacobian, jacobian))
    errors = np.full(d, math.inf)
    # a component that moves the current by less than a millionth of the strongest is not seen
    seen = size > 1e-6 * max(float(size.max()), 1e-300)
    if seen.any():
        scaled = jacobian[seen] / size[seen][:, None]
        values, vectors = np.linalg.eigh(scaled @ scaled.T)
        inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
        blocks = np.array_split(np.arange(residuals.shape[1]), _BLOCKS)
        g = np.array([scaled[:, block] @ residuals[0][block] for block in blocks])
        covariance = inverse @ (g.T @ g) @ inverse * _BLOCKS / (_BLOCKS - 1)
        errors[seen] = MODEL_ERROR * np.sqrt(np.diag(covariance)) / size[seen]
        # nearly the same change of current as a mixture of others: no blocks can tell them apart
        share = np.sqrt(1.0 / np.maximum(np.diag(inverse), 1.0))
        errors[np.flatnonzero(seen)[share < 1e-3]] = math.inf
    return dict(zip((FAULTS[n] for n in free), errors.tolist(), strict=True))
