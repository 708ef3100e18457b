"""Sobol points, scrambled: an even cover of a box.

Sobol (1967), with the direction numbers of Joe and Kuo (2008, SIAM J. Sci. Comput. 30,
2635-2654), scrambled by random lower triangular matrices and a shift (Matousek 1998, J. Complexity
14, 527-556). The points equal ``scipy.stats.qmc.Sobol``, whose import takes longer than a
search, and which gives those of more dimensions than searches have.
"""

from typing import Any

import numpy as np

_BITS = 30


class Sobol:
    """Points of a sequence; a child of the generator draws the scrambling."""

    def __init__(self, dimensions: int, rng: np.random.Generator) -> None:
        self._others: Any = None
        if dimensions > len(_DIRECTIONS):
            from scipy.stats import qmc

            self._others = qmc.Sobol(dimensions, rng=rng)
            return
        (rng,) = rng.spawn(1)
        powers = 2 ** np.arange(_BITS, dtype=np.uint32)
        shift = rng.integers(2, size=(dimensions, _BITS), dtype=np.uint32) @ powers
        lower = np.tril(rng.integers(2, size=(dimensions, _BITS, _BITS), dtype=np.uint32))
        lower[:, np.arange(_BITS), np.arange(_BITS)] = 1
        plain = np.array([_columns(*each) for each in _DIRECTIONS[:dimensions]], dtype=np.uint32)
        bits = (plain[:, :, None] >> np.arange(_BITS - 1, -1, -1, dtype=np.uint32)) & 1
        mixed = np.einsum("dpk,djk->djp", lower, bits) % 2  # the highest bit first
        self._directions = (mixed * powers[::-1]).sum(axis=2, dtype=np.uint32)
        self._next = shift.astype(np.uint32)
        self._drawn = 0

    def random(self, count: int) -> np.ndarray:
        """The next points (``count``, d), in [0, 1)."""
        if self._others is not None:
            return np.asarray(self._others.random(count))
        found = np.empty((count, self._next.size))
        for n in range(count):
            found[n] = self._next
            self._drawn += 1
            lowest = (self._drawn & -self._drawn).bit_length() - 1  # Gray code
            self._next ^= self._directions[:, lowest]
        return found / 2.0**_BITS


def _columns(polynomial: int, first: tuple[int, ...]) -> list[int]:
    """Direction numbers of a dimension, as integers of `_BITS` bits."""
    if polynomial == 1:
        found = [1] * _BITS
    else:
        degree = polynomial.bit_length() - 1
        found = list(first)
        for j in range(degree, _BITS):
            new = found[j - degree]
            for k in range(degree):
                if (polynomial >> (degree - 1 - k)) & 1:
                    new ^= found[j - k - 1] << (k + 1)
            found.append(new)
    return [number << (_BITS - 1 - n) for n, number in enumerate(found)]


# Primitive polynomial of each dimension, as bits, and its first direction numbers.
_DIRECTIONS = (
    (1, (1,)), (3, (1,)), (7, (1, 3)), (11, (1, 3, 1)), (13, (1, 1, 1)), (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)), (37, (1, 1, 5, 5, 17)), (41, (1, 1, 5, 5, 5)), (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)), (59, (1, 1, 1, 3, 11)), (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)), (91, (1, 1, 1, 15, 21, 21)), (97, (1, 3, 1, 13, 27, 49)),
    (103, (1, 1, 1, 15, 7, 5)), (109, (1, 3, 1, 15, 13, 25)), (115, (1, 1, 5, 5, 19, 61)),
)  # fmt: skip
