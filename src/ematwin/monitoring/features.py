"""Features of a motion: the magnitudes of the twin, and statistics of what it leaves unexplained.

The first kind comes from the model: friction, backlash, gain. The second from statistics: means of
the residual in each phase, and its power in bands of frequency (roughness) where the phase is
steady. Each feature says which it is.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ematwin.monitoring.phases import Phase

MODEL = ("friction", "backlash", "gain")
_PARTS = 4  # of a transient
# Edges of the bands as shares of the Nyquist frequency: slow swaying, stick and slip, one turn of
# the screw and its harmonics, balls and sensor.
BANDS = (0.03, 0.16, 0.32, 0.45, 0.72, 1.0)
CHANNELS = ("current", "error")


@dataclass(frozen=True)
class Layout:
    """Which features a set of motions has.

    Attributes
    ----------
    names : of the features
    kinds : "model", "mean" or "band", one for each
    """

    phases: tuple[Phase, ...]
    names: tuple[str, ...]
    kinds: tuple[str, ...]

    @classmethod
    def of(cls, phases: list[Phase]) -> "Layout":
        """The features of motions with these phases."""
        names, kinds = list(MODEL), ["model"] * len(MODEL)
        for channel in CHANNELS:
            for phase in phases:
                if phase.steady:
                    names.append(f"{channel} mean, {phase.title}")
                    kinds.append("mean")
                    for n in range(len(BANDS) - 1):
                        names.append(f"{channel} band {n + 1}, {phase.title}")
                        kinds.append("band")
                else:
                    for n in range(_PARTS):
                        names.append(f"{channel} part {n + 1}, {phase.title}")
                        kinds.append("mean")
        return cls(tuple(phases), tuple(names), tuple(kinds))

    def values(
        self, magnitudes: np.ndarray, current: np.ndarray, position_error: np.ndarray
    ) -> np.ndarray:
        """Features (F,) of one motion.

        Parameters
        ----------
        magnitudes : (5,) array, as in `ematwin.monitoring.twin.MAGNITUDES`
        current, position_error : (S,) arrays, residuals, A and m
        """
        found = [float(magnitudes[n]) for n in range(len(MODEL))]
        for residual in (current, position_error):
            for phase in self.phases:
                part = residual[phase.samples]
                if phase.steady:
                    found.append(float(part.mean()))
                    found += band_levels(part)
                else:
                    found += [float(piece.mean()) for piece in np.array_split(part, _PARTS)]
        return np.array(found)


def band_levels(residual: np.ndarray) -> list[float]:
    """Natural logarithm of the amplitude in each band of `BANDS`."""
    window = np.hanning(residual.size)
    spectrum = np.abs(np.fft.rfft((residual - residual.mean()) * window)) ** 2
    power = spectrum / float(window @ window)
    shares = np.linspace(0.0, 1.0, power.size)  # of the Nyquist frequency
    levels = []
    for low, high in pairwise(BANDS):
        inside = (shares >= low) & (shares < high if high < 1.0 else shares <= high)
        mean = float(power[inside].mean()) if inside.any() else 0.0
        levels.append(0.5 * float(np.log(mean + 1e-18)))
    return levels
