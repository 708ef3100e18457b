"""The space that is searched: which faults are free, which are held, and in what coordinates.

Box methods search the free components themselves. A descent searches ``z``, where eccentricity and
its phase are replaced by zeta cos(phi) and zeta sin(phi): the phase has no meaning near zeta = 0
and jumps at half a turn, and both would stop a method that follows slopes.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from ematwin.errors import InputError
from ematwin.faults import FAULTS, Faults, check_name, eccentricity_vector

_ZETA, _PHASE = FAULTS.index("eccentricity"), FAULTS.index("eccentricity_phase")


@dataclass(frozen=True)
class FaultSpace:
    """Free and held components of the fault vector.

    Parameters
    ----------
    only : names of the free faults; None frees all eight
    held : values of the others; healthy if not given

    Raises
    ------
    InputError
        If a name is unknown, or none is free.
    """

    only: Iterable[str] | None = None
    held: Faults = field(default_factory=Faults)

    def __post_init__(self) -> None:
        names = FAULTS if self.only is None else tuple(dict.fromkeys(self.only))
        for name in names:
            check_name(name)
        if not names:
            raise InputError("No fault is left to search; name at least one, e.g. friction.")
        object.__setattr__(self, "only", tuple(name for name in FAULTS if name in names))

    @property
    def names(self) -> tuple[str, ...]:
        """Free faults, in the order of `FAULTS`."""
        assert isinstance(self.only, tuple)
        return self.only

    @property
    def free(self) -> np.ndarray:
        """(d,) indices of the free components."""
        return np.array([FAULTS.index(name) for name in self.names])

    @property
    def has_direction(self) -> bool:
        """Whether eccentricity and phase are both free, and searched as a vector in ``z``."""
        return {"eccentricity", "eccentricity_phase"} <= set(self.names)

    def full(self, x: np.ndarray) -> np.ndarray:
        """Fault vectors (N, 8) from free components (N, d)."""
        k = np.tile(self.held.vector, (len(x), 1))
        k[:, self.free] = x
        return k

    @property
    def lower(self) -> np.ndarray:
        """(d,) lower bounds of ``z``."""
        turned = self.has_direction & np.isin(self.free, (_ZETA, _PHASE))
        return np.where(turned, -1.0, 0.0)

    @property
    def upper(self) -> np.ndarray:
        """(d,) upper bounds of ``z``."""
        return np.ones(len(self.names))

    def to_faults(self, z: np.ndarray) -> np.ndarray:
        """Fault vectors (N, 8) from coordinates ``z`` (N, d)."""
        k = self.full(z)
        if self.has_direction:
            along, across = k[:, _ZETA].copy(), k[:, _PHASE].copy()
            k[:, _ZETA] = np.minimum(np.hypot(along, across), 1.0)
            k[:, _PHASE] = np.arctan2(across, along) / (2.0 * np.pi) + 0.5
        return k

    def from_faults(self, k: np.ndarray) -> np.ndarray:
        """Coordinates ``z`` (N, d) of fault vectors (N, 8)."""
        z = np.array(k, dtype=float)
        if self.has_direction:
            z[:, _ZETA], z[:, _PHASE] = eccentricity_vector(k)
        return z[:, self.free]

    def project(self, z: np.ndarray) -> np.ndarray:
        """The nearest points (N, d) that fault vectors can have: in the box, and zeta <= 1."""
        z = np.clip(z, self.lower, self.upper)
        if self.has_direction:
            pair = [self.names.index("eccentricity"), self.names.index("eccentricity_phase")]
            radius = np.hypot(z[:, pair[0]], z[:, pair[1]])
            z[:, pair] /= np.maximum(radius, 1.0)[:, None]
        return z
