"""An axis that does not exist, recorded like EMPS; it shares no code with the twin.

Its friction has what the twin has not: bristles (LuGre), a part that swings with the position, and
a slow drift; its encoder counts micrometres. The reference goes out and back at three speeds.

LuGre: Canudas de Wit, Olsson, Astrom and Lischinsky (1995), IEEE Trans. Automatic Control 40(3).
"""

import math
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

INTERVAL, SUBSTEPS = 1e-3, 8
GAIN, K_POSITION, K_VELOCITY, LIMIT = 35.15, 160.2, 243.5, 10.0
DAMPING = 2e3  # of the bristles, N s/m
COUNT = 1e-6  # m


class Axis(NamedTuple):
    """What an axis is."""

    mass: float = 90.0  # kg
    lag: float = 4e-4  # s
    coulomb: tuple[float, float] = (21.0, 24.0)  # N, forward and backward
    viscous: tuple[float, float] = (150.0, 205.0)  # N s/m
    low: float = 0.6  # share of the Coulomb friction that is left at standstill
    stiffness: float = 4e6  # N/m, of the bristles
    swing: float = 1.0  # N
    pitch: float = 2.5e-3  # m
    drift: float = 0.01  # of the friction, over the recording


AXIS = Axis()


def any_axis(seed: int) -> Axis:
    """An axis drawn at random, near enough to EMPS for its template."""
    random = np.random.default_rng(seed)

    def both(middle: float) -> tuple[float, float]:
        level, ratio = middle * random.uniform(0.7, 1.4), np.exp(random.normal(0.0, 0.15))
        return float(level / ratio), float(level * ratio)

    return Axis(
        mass=random.uniform(75.0, 120.0), lag=random.uniform(1e-4, 8e-4), coulomb=both(21.0),
        viscous=both(190.0), low=random.uniform(0.4, 1.3),
        stiffness=float(10.0 ** random.uniform(6.0, 7.0)), swing=random.uniform(0.0, 1.5),
        pitch=random.uniform(2e-3, 5e-3), drift=random.normal(0.0, 0.01),
    )  # fmt: skip


def reference(periods: int) -> np.ndarray:
    """(S,) array, m: trapezoids of 42, 83 and 125 mm/s out and back, with stops between them."""
    corners, speeds = [0.0], [0.0]
    for speed, hold in ((0.042, 0.4), (0.083, 0.8), (0.125, 1.0), (-0.042, 0.4), (-0.083, 0.8),
                        (-0.125, 1.0)):  # fmt: skip
        for value, time in ((speed, 0.06), (speed, hold), (0.0, 0.06)):
            corners.append(corners[-1] + time)
            speeds.append(value)
    samples = round(corners[-1] / INTERVAL)
    one = np.interp(np.arange(samples) * INTERVAL, corners, speeds)
    return np.cumsum(np.tile(one, periods)) * INTERVAL


@cache
def recorded(periods: int = 2, pulses: bool = False, axis: Axis = AXIS) -> dict[str, np.ndarray]:
    """The variables of a MATLAB file of the benchmark."""
    wanted = reference(periods)
    added = np.zeros(wanted.size)
    if pulses:
        for start in np.arange(300, wanted.size - 100, 700):
            added[start : start + 60] = 5.0
    step = INTERVAL / SUBSTEPS
    x = v = z = u = previous = before = 0.0
    voltage, position = np.empty((2, wanted.size))
    keep = math.exp(-step / axis.lag)
    for n in range(wanted.size):
        seen = round(x / COUNT) * COUNT
        speed = (seen - before) / (2 * INTERVAL)
        out = K_VELOCITY * (K_POSITION * (wanted[n] - seen) - speed) + added[n]
        out = max(-LIMIT, min(LIMIT, out))
        voltage[n], position[n] = out, seen
        previous, before = seen, previous
        warm = 1.0 + axis.drift * (n / wanted.size - 0.5)
        for _ in range(SUBSTEPS):
            u = out + (u - out) * keep
            side = 0 if v > 0 else 1
            level = axis.coulomb[side] * warm * (1.0 - (1.0 - axis.low) * math.exp(-abs(v) / 0.01))
            rate = axis.stiffness * abs(v) / level
            # bristles: implicit in their own deflection, which is fast
            z_next = (z + step * v) / (1.0 + step * rate)
            rubbing = (
                axis.stiffness * z_next + DAMPING * math.exp(-abs(v) / 0.01) * (z_next - z) / step
            )
            rubbing += axis.viscous[side] * warm * v
            swing = axis.swing * math.sin(2.0 * math.pi * x / axis.pitch)
            v += step * (GAIN * u - rubbing - swing) / axis.mass
            x += step * v
            z = z_next
    column = {"t": np.arange(wanted.size) * INTERVAL, "qg": wanted, "qm": position, "vir": voltage}
    found = {name: values[:, None] for name, values in column.items()}
    found |= {"gtau": np.array([[GAIN]]), "kp": np.array([[K_POSITION]])}
    found |= {"kv": np.array([[K_VELOCITY]])}
    return found | ({"pulses_N": added[:, None]} if pulses else {})


def write(path: Path, *, periods: int = 2, pulses: bool = False, **changed: object) -> Path:
    """A file like those of the benchmark; ``changed`` replaces variables, None leaves one out."""
    from scipy.io import savemat

    content = {**recorded(periods, pulses), **changed}
    savemat(path, {name: values for name, values in content.items() if values is not None})
    return path
