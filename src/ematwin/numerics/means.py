"""A trace with fewer samples, each the mean of those that it stands for."""

import numpy as np


def means(trace: np.ndarray, stride: int) -> np.ndarray:
    """The first sample of a trace (S,), then the mean of each ``stride`` samples after it.

    ``(1 + (S - 1) // stride,)``: each stands at the last of its samples, as a current that was
    recorded as a mean does.
    """
    count = (trace.size - 1) // stride
    parts = trace[1 : 1 + count * stride].reshape(count, stride)
    return np.concatenate([trace[:1], parts.mean(axis=1)])
