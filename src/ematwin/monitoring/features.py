"""Features of a recording: magnitudes of faults, and statistics of the residual.

The first kind comes from the model. The second from statistics: means of the residual of each
channel in each phase, and its power in bands of frequency where the phase is steady. Each feature
says which it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ematwin.models.phases import Phase

_PARTS = 4  # of a transient
# Edges of the bands as shares of the Nyquist frequency. In a recording of a ball screw at 25 Hz
# they are slow swaying, stick and slip, one turn of the screw and its harmonics, balls and sensor.
BANDS = (0.03, 0.16, 0.32, 0.45, 0.72, 1.0)


@dataclass(frozen=True)
class Layout:
    """Which features the recordings of a command have."""

    phases: tuple[Phase, ...]  # of the command
    magnitudes: tuple[str, ...]  # names of the faults whose values are features
    channels: tuple[str, ...]  # names of the channels whose residuals give features
    names: tuple[str, ...]  # of the features
    kinds: tuple[str, ...]  # "model", "mean" or "band", one for each

    @classmethod
    def of(
        cls,
        phases: Sequence[Phase],
        magnitudes: Sequence[str],
        channels: Sequence[str],
        short: Mapping[str, str] | None = None,
    ) -> "Layout":
        """The features of recordings with these phases; ``short`` renames channels in them."""
        found = [(name, "model") for name in magnitudes]
        for channel in channels:
            said = (short or {}).get(channel, channel)
            for phase in phases:
                if phase.steady:
                    found.append((f"{said} mean, {phase.title}", "mean"))
                    bands = range(1, len(BANDS))
                    found += [(f"{said} band {n}, {phase.title}", "band") for n in bands]
                else:
                    parts = range(1, _PARTS + 1)
                    found += [(f"{said} part {n}, {phase.title}", "mean") for n in parts]
        names, kinds = zip(*found, strict=True)
        return cls(tuple(phases), tuple(magnitudes), tuple(channels), names, kinds)

    def of_channels(self) -> np.ndarray:
        """(C, F) array of bool: the statistics of the residual of each channel."""
        first, count = len(self.magnitudes), len(self.channels)
        own = (np.arange(len(self.names)) - first) * count // max(1, len(self.names) - first)
        return np.array([(own == n) & (np.array(self.kinds) != "model") for n in range(count)])

    def values(
        self, magnitudes: Mapping[str, float], residuals: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Features (F,) of one recording.

        Parameters
        ----------
        magnitudes : values by name
        residuals : (S,) array of each channel
        """
        found = [float(magnitudes[name]) for name in self.magnitudes]
        for residual in residuals:
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
