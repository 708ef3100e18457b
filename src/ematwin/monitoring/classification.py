"""Name a fault from the components of a change.

Two ways. From physics alone: the quantity that has left its healthy spread furthest, in the sense
in which wear moves it. From signatures, where recordings with known faults were given at
calibration: the nearest mean of scores, if it is nearer than health is by a good part. That is a
matched filter: it sees a known fault well before the index does, and what drifts between occasions
seldom looks like one. Signatures are statistics of one rig; they carry over to another only as far
as that rig is alike.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.constants import SIGMAS
from ematwin.models.base import Reported
from ematwin.monitoring.population import basis

# Share of the squared mean scores, for a name from a signature. Chosen on runs 1 to 5 of
# docs/real-recordings.md, each judged by the signatures of the others, and with drift made up on
# the healthy ones: at 0.15 up to a fifth of drifting motions are named, at 0.2 up to 7 %, at 0.25
# slight spalling is missed.
_EXPLAINED = 0.2
REACH = 15.0  # standard deviations, the most that one feature counts


@dataclass(frozen=True)
class Name:
    """The name of a fault and where it comes from.

    Attributes
    ----------
    fault : e.g. "lubrication"
    by : "physics" or "signature"
    """

    fault: str
    by: str


@dataclass(frozen=True)
class Signature:
    """Mean scores of recordings with a known fault, over the covariate.

    Attributes
    ----------
    fault : its name
    coefficients : (3, F) or (1, F) array, as in `Population`
    source : of the data it was learnt from
    """

    fault: str
    coefficients: np.ndarray
    source: str


def named_by_physics(scores: Mapping[str, float], reported: Sequence[Reported]) -> Name | None:
    """The fault whose quantity has left its healthy spread furthest, as wear moves it; or None.

    Parameters
    ----------
    scores : of the reported quantities, in healthy standard deviations, by name
    reported : says which fault each quantity names, and in which sense
    """
    clear = []
    for one in reported:
        score = abs(scores[one.name]) if one.either else scores[one.name]
        # how small a change may be, the healthy runs themselves say
        if one.named and score > SIGMAS:
            clear.append((score, one.named))
    return Name(max(clear)[1], "physics") if clear else None


def named_by_signature(
    scores: np.ndarray,
    covariate: np.ndarray,
    scale: float | None,
    signatures: Sequence[Signature],
) -> Name | None:
    """The fault whose signature is nearest to recordings with these scores; None if none is near.

    Parameters
    ----------
    scores : (N, F) array, of recordings that are judged together, by their mean
    covariate : (N,) array, SI
    scale : of the covariate, as in `Population`
    """
    limited = np.clip(scores, -REACH, REACH).mean(0)
    terms = basis(covariate, scale).mean(0)
    distances = [float(((limited - terms @ s.coefficients) ** 2).sum()) for s in signatures]
    nearest = int(np.argmin(distances))
    healthy = float((limited**2).sum())
    if distances[nearest] > (1.0 - _EXPLAINED) * healthy:
        return None
    return Name(signatures[nearest].fault, "signature")
