"""Chart: the coordinates in which slopes are followed.

Box methods search the values of the unknowns themselves. A descent searches ``z``: each value as
a share of its range (or of its logarithm's range), and a magnitude with its direction as the two
components of a vector. A direction has no meaning where its magnitude is zero, and jumps at half a
turn; both would stop a method that follows slopes.
"""

from collections.abc import Sequence

import numpy as np

from ematwin.models.unknown import Unknown

_TURN = 2.0 * np.pi


class Chart:
    """Values (N, d) of some unknowns to coordinates ``z`` (N, d) and back.

    Attributes
    ----------
    unknowns : tuple of Unknown
    names : of the coordinates: names of unknowns, vectors by component
    lower, upper : (d,) arrays, bounds of ``z``
    pairs : places of the magnitudes and directions that are components of a vector
    widths : (d,) array, ranges of the unknowns, or of their logarithms
    """

    def __init__(self, unknowns: Sequence[Unknown]) -> None:
        self.unknowns = tuple(unknowns)
        names = [unknown.name for unknown in unknowns]
        self.pairs = tuple(
            (names.index(unknown.direction_of), n)
            for n, unknown in enumerate(unknowns)
            if unknown.direction_of in names
        )
        self.lower, self.upper = np.zeros(len(names)), np.ones(len(names))
        for radius, direction in self.pairs:
            self.lower[[radius, direction]] = -1.0
            names[radius], names[direction] = f"{names[radius]} x", f"{names[radius]} y"
        self.names = tuple(names)
        self._log = np.array([unknown.logarithmic for unknown in unknowns], dtype=bool)
        bounds = np.array([[unknown.lower, unknown.upper] for unknown in unknowns]).reshape(-1, 2)
        bounds[self._log] = np.log(bounds[self._log])
        self._low = bounds[:, 0]
        self.widths = bounds[:, 1] - self._low

    def from_unit(self, u: np.ndarray) -> np.ndarray:
        """Values (N, d) of shares (N, d) of their ranges, or of the ranges of their logarithms."""
        x = np.asarray(self._low + u * self.widths)
        x[:, self._log] = np.exp(x[:, self._log])
        return x

    def from_values(self, values: np.ndarray) -> np.ndarray:
        """Coordinates ``z`` (N, d) of values (N, d)."""
        z = np.array(values, dtype=float)
        z[:, self._log] = np.log(z[:, self._log])
        z = (z - self._low) / self.widths
        for radius, direction in self.pairs:
            phi = _TURN * (z[:, direction] - 0.5)
            z[:, radius], z[:, direction] = z[:, radius] * np.cos(phi), z[:, radius] * np.sin(phi)
        return z

    def to_values(self, z: np.ndarray) -> np.ndarray:
        """Values (N, d) of coordinates ``z`` (N, d)."""
        x = np.array(z, dtype=float)
        for radius, direction in self.pairs:
            along, across = x[:, radius].copy(), x[:, direction].copy()
            x[:, radius] = np.minimum(np.hypot(along, across), 1.0)
            x[:, direction] = np.arctan2(across, along) / _TURN + 0.5
        return self.from_unit(x)

    def project(self, z: np.ndarray) -> np.ndarray:
        """The nearest points (N, d) that values can have: in the box, magnitudes at most 1."""
        z = np.clip(z, self.lower, self.upper)
        for pair in self.pairs:
            radius = np.hypot(z[:, pair[0]], z[:, pair[1]])
            z[:, list(pair)] /= np.maximum(radius, 1.0)[:, None]
        return z

    def standard_errors(self, z: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(d,) errors, in values, of a covariance (d, d) at ``z`` (d,), both in coordinates.

        For a logarithmic unknown, the error of the logarithm.
        """
        errors = np.sqrt(np.diag(covariance)) * self.widths
        for radius, direction in self.pairs:
            # across the vector an error turns it; along it, it changes the magnitude
            size = float(np.hypot(z[radius], z[direction]))
            across = max(errors[radius], errors[direction])
            errors[radius] = across
            errors[direction] = across / (2.0 * np.pi * size) if size > 2.0 * across else np.inf
        return np.asarray(errors)
