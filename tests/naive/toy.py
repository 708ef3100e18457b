"""Comparisons whose right answers can be worked out by hand: features on orthogonal bases."""

import numpy as np

from ematwin import Recording
from ematwin.models.comparison import Comparison
from ematwin.models.unknown import Unknown

NOISE, SAMPLES = 0.1, 400
BASES = np.linalg.qr(np.random.default_rng(5).standard_normal((SAMPLES, 4)))[0].T * np.sqrt(SAMPLES)


class OneChannel(Comparison):
    """A recording ``y`` (S,) with noise of a size, beside `responses`, which subclasses have."""

    model_error = 1.0

    def __init__(self, y, noise):
        self.recording = Recording(1e-3 * np.arange(y.size), {"y": y})
        self.actuator, self.noise, self.independent = None, noise, float(y.size)
        self.scale = float((y**2).sum())

    def measured(self):
        return {"y": self.recording.y}

    def captions(self):
        return {"y": ("y", "")}

    def residuals(self, candidates, count):
        return self.responses(candidates, count)["y"] - self.recording.y


class Toy(OneChannel):
    """Answers with features (B, 4) of its unknowns on orthogonal bases of mean square 1."""

    def __init__(self, features, seed=1, noise=None, **truth):
        self.features = features
        here = {name: np.array([value]) for name, value in truth.items()}
        noise = NOISE * np.random.default_rng(seed).standard_normal(SAMPLES)
        noise -= BASES.T @ (BASES @ noise) / SAMPLES  # the best point is the truth
        super().__init__(np.asarray(features(here))[0] @ BASES + noise, NOISE)

    def responses(self, candidates, count):
        return {"y": self.features(candidates) @ BASES}


class Line(OneChannel):
    """y = slope t + offset in 50 samples."""

    def __init__(self, slope, offset=0.0, noise=1.0):
        self.t = np.linspace(0.0, 1.0, 50)
        super().__init__(slope * self.t + offset, noise)

    def responses(self, candidates, count):
        slope, offset = (
            np.broadcast_to(candidates[name], count)[:, None] for name in ("slope", "offset")
        )
        return {"y": slope * self.t + offset}


def fault(name, **more):
    given = {"healthy": 0.0, "lower": 0.0, "upper": 1.0} | more
    return Unknown(name, "", "", **given)


def stacked(*columns):
    count = max(np.size(one) for one in columns)
    rows = [np.broadcast_to(one, count) for one in columns]
    return np.stack([*rows, *[np.zeros(count)] * (4 - len(rows))], axis=1)
