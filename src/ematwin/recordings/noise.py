"""Imperfections of the measurement: white noise of each channel; offset and steps of currents."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.recordings.recording import Recording


@dataclass(frozen=True)
class Noise:
    """What sensors and the converter of the current add.

    Parameters
    ----------
    white : float, standard deviation of white noise as a share of the signal's RMS
    offset : float, A, added to each current
    bits : int or None, resolution of the converter of the currents; None for a perfect one
    full_scale : float, A: the converter spans -full_scale to +full_scale and saturates there
    """

    white: float = 0.0
    offset: float = 0.0
    bits: int | None = None
    full_scale: float = 25.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.white) and self.white >= 0.0):
            raise InputError(f"White noise must be a share of at least 0, received {self.white}.")
        if self.white > 1.0:
            hint = f" It looks like per cent; write {self.white / 100.0:g}."
            said = "White noise is a share of the signal's RMS and must be at most 1, received"
            raise InputError(f"{said} {self.white:g}.{hint if self.white >= 2.0 else ''}")
        if not np.isfinite(self.offset):
            raise InputError(f"The offset must be a number of amperes, received {self.offset}.")
        if self.bits is not None and not (isinstance(self.bits, int) and 2 <= self.bits <= 32):
            raise InputError(f"A converter has 2 to 32 bits, received {self.bits}.")
        if not (np.isfinite(self.full_scale) and self.full_scale > 0.0):
            raise InputError(f"full_scale must be positive amperes, received {self.full_scale}.")

    @classmethod
    def of(cls, given: "Noise | float | str | None") -> "Noise | None":
        """Noise from itself, from a share of white noise, or from a text as `parse` takes it."""
        if given is None or isinstance(given, cls):
            return given
        if isinstance(given, str):
            return cls.parse(given)
        if isinstance(given, bool) or not isinstance(given, int | float | np.number):
            raise InputError(
                "noise must be a Noise, such as Noise(white=0.02, bits=12), or the share of white "
                f"noise, such as 0.02; received {given!r}."
            )
        return cls(white=float(given))

    @classmethod
    def parse(cls, text: str) -> "Noise":
        """Noise from ``"white=0.02,offset=0.05,bits=12,full_scale=25"``."""
        values: dict[str, float | int] = {}
        for part in text.split(","):
            name, _, value = (piece.strip() for piece in part.partition("="))
            if name not in cls.__dataclass_fields__:
                raise InputError(
                    f"Noise knows {', '.join(cls.__dataclass_fields__)}; received {part.strip()!r}."
                    " Write for example white=0.02,bits=12."
                )
            if name in values:
                raise InputError(f"Noise gives {name} twice; give it once.")
            try:
                values[name] = int(value) if name == "bits" else float(value)
            except ValueError:
                kind = "whole number" if name == "bits" else "number"
                said = f"Noise {name} must be a {kind}, received {value!r}"
                raise InputError(f"{said}. Correct it.") from None
        return cls(**values)  # type: ignore[arg-type]

    def apply(
        self, recording: Recording, rng: np.random.Generator, also: Iterable[str] = ()
    ) -> Recording:
        """The recording as these sensors would have given it: its currents, and ``also`` others."""
        channels = recording.channels
        currents = ("current_a", "current_b", "current_c", "current")  # in A, stated or not
        known = [name for name in currents if name in channels]
        known += [n for n in channels if recording.units.get(n) == "A" and n not in known]
        seen = {name: self._measure(channels[name], rng) for name in known}
        for name in also:
            if name in channels and name not in seen:
                seen[name] = channels[name] + self._scatter(channels[name], rng)
        return recording.changed(**seen)

    def _scatter(self, signal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        sigma = self.white * float(np.sqrt(np.mean(signal**2)))
        return np.asarray(sigma * rng.standard_normal(signal.size))

    def _measure(self, current: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        seen = current + self.offset + self._scatter(current, rng)
        if self.bits is None:
            return seen
        step = 2.0 * self.full_scale / 2**self.bits
        codes = np.clip(np.round(seen / step), -(2 ** (self.bits - 1)), 2 ** (self.bits - 1) - 1)
        return codes * step
