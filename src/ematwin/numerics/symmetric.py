"""Inverse and eigenvalues of symmetric matrices that may be nearly singular."""

import numpy as np


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
