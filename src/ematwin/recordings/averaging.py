"""Recordings that are sampled faster than a comparison needs, at a rate that it does."""

from collections.abc import Collection

import numpy as np

from ematwin.numerics.signals import means as mean_of_each
from ematwin.recordings.recording import Recording

_ROUNDING = 1e-6  # of a ratio of rates


def averaged(recording: Recording, rate: float, means: Collection[str]) -> Recording:
    """The recording at a rate of ``rate`` (Hz) or a little more; itself where it has no double.

    Parameters
    ----------
    means : channels whose samples are means over the interval that ends at their time, which they
        are afterwards as well; of all others the value at that time is kept
    """
    own = recording.sample_rate
    many = int(own / rate + _ROUNDING)
    if many < 2:
        return recording

    def taken(name: str, values: np.ndarray) -> np.ndarray:
        return mean_of_each(values, many) if name in means else values[::many].copy()

    said = f"samples were averaged from {own:.6g} to {own / many:.6g} Hz, as many as are compared"
    return recording.changed(
        time=recording.time[::many].copy(),
        provenance={
            **recording.provenance, "changed": [*recording.provenance.get("changed", []), said]
        },
        **{name: taken(name, values) for name, values in recording.channels.items()},
    )  # fmt: skip
