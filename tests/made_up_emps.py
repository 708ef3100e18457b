"""An axis that does not exist, recorded like EMPS; it shares no code with the twin.

Its friction has what the twin has not: bristles (LuGre), a part that swings with the position, and
a slow drift; its encoder counts micrometres. The reference goes out and back at three speeds.

LuGre: Canudas de Wit, Olsson, Astrom and Lischinsky (1995), IEEE Trans. Automatic Control 40(3).
"""

import math
from functools import cache
from pathlib import Path

import numpy as np

INTERVAL, SUBSTEPS = 1e-3, 8
GAIN, K_POSITION, K_VELOCITY, LIMIT = 35.15, 160.2, 243.5, 10.0
MASS, LAG = 90.0, 4e-4
TRUTH = {"coulomb": (21.0, 24.0), "viscous": (150.0, 205.0)}  # forward, backward
STIFFNESS, DAMPING = 4e6, 2e3  # of the bristles, N/m and N s/m
SWING, PITCH = 1.0, 2.5e-3  # N and m
DRIFT = 0.01  # of the friction, over the recording
COUNT = 1e-6  # m


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
def recorded(periods: int = 2, pulses: bool = False) -> dict[str, np.ndarray]:
    """The variables of a MATLAB file of the benchmark."""
    wanted = reference(periods)
    added = np.zeros(wanted.size)
    if pulses:
        for start in np.arange(300, wanted.size - 100, 700):
            added[start : start + 60] = 5.0
    step = INTERVAL / SUBSTEPS
    x = v = z = u = previous = before = 0.0
    voltage, position = np.empty((2, wanted.size))
    keep = math.exp(-step / LAG)
    for n in range(wanted.size):
        seen = round(x / COUNT) * COUNT
        speed = (seen - before) / (2 * INTERVAL)
        out = K_VELOCITY * (K_POSITION * (wanted[n] - seen) - speed) + added[n]
        out = max(-LIMIT, min(LIMIT, out))
        voltage[n], position[n] = out, seen
        previous, before = seen, previous
        warm = 1.0 + DRIFT * (n / wanted.size - 0.5)
        for _ in range(SUBSTEPS):
            u = out + (u - out) * keep
            side = 0 if v > 0 else 1
            level = TRUTH["coulomb"][side] * warm * (1.0 - 0.4 * math.exp(-abs(v) / 0.01))
            rate = STIFFNESS * abs(v) / level
            # bristles: implicit in their own deflection, which is fast
            z_next = (z + step * v) / (1.0 + step * rate)
            rubbing = STIFFNESS * z_next + DAMPING * math.exp(-abs(v) / 0.01) * (z_next - z) / step
            rubbing += TRUTH["viscous"][side] * warm * v
            swing = SWING * math.sin(2.0 * math.pi * x / PITCH)
            v += step * (GAIN * u - rubbing - swing) / MASS
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
