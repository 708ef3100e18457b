"""How probable a fault is, where a healthy actuator is as likely as a faulty one.

Draws and profiles take each fault to be as likely anywhere in its range, as its interval wants it.
For a probability that is too much: where a recording leaves a fault wide open, "anywhere" is nearly
all outside of healthy, and a healthy gain would be faulty with 80 %. So a fault is also taken to be
absent, within `SMALLEST` of its range, with a probability of its own beforehand: a spike and a slab
(Mitchell and Beauchamp 1988, J. Am. Stat. Assoc. 83, 1023-1032), the spike as wide as that. Draws
within it then count `weight` times.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.constants import BEFOREHAND, SMALLEST
from ematwin.estimation.intervals import Draws
from ematwin.models.unknown import Unknown

_FEWEST = 20.0  # draws that all together must be worth; else each fault is weighed alone


@dataclass(frozen=True)
class Weights:
    """How much draws count where faults may be absent.

    Attributes
    ----------
    by_fault : (N,) arrays of sum 1
    together : whether one array weighs all faults together; else each is weighed as if it were the
        only one that may be absent, and nothing is told of several at once
    """

    by_fault: dict[str, np.ndarray]
    together: bool


def weight(one: Unknown) -> float:
    """How many times likelier "absent" is beforehand than its share of the range makes it."""
    reach = SMALLEST * one.width
    ends = np.clip([one.healthy - reach, one.healthy + reach], one.lower, one.upper)
    if one.logarithmic:
        share = float(np.diff(np.log(ends))[0] / np.log(one.upper / one.lower))
    else:
        share = float(np.diff(ends)[0] / one.width)
    return (1.0 - BEFOREHAND) / BEFOREHAND * (1.0 - share) / share


def is_absent(one: Unknown, drawn: Draws) -> np.ndarray:
    """(N,) whether draws of a fault deviate from healthy by less than `SMALLEST` of its range."""
    return np.asarray(np.abs(drawn.of(one.name) - one.healthy) < SMALLEST * one.width)


def weights(faults: Sequence[Unknown], drawn: Draws) -> Weights:
    """Weights of draws: of all faults together, unless a few draws would outweigh all others."""
    absent = {one.name: is_absent(one, drawn) for one in faults}
    logs = {one.name: np.log(weight(one)) * absent[one.name] for one in faults}
    together = _normalised(np.sum(list(logs.values()), axis=0))
    if 1.0 / float(together @ together) >= _FEWEST:
        return Weights(dict.fromkeys(absent, together), True)
    return Weights({name: _normalised(log) for name, log in logs.items()}, False)


def odds(share: float, one: Unknown, beyond: float | None = None) -> float:
    """The probability of a fault from its share of a flat density.

    Where the share ``beyond`` a threshold is given, the probability of that.
    """
    beyond = share if beyond is None else beyond
    faulty = min(beyond, share)  # what lies within healthy counts more
    counted = faulty + (beyond - faulty) * weight(one)
    return counted / (share + (1.0 - share) * weight(one))


def _normalised(log: np.ndarray) -> np.ndarray:
    found = np.exp(log - log.max())
    return np.asarray(found / found.sum())
