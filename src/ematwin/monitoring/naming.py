"""The name of a fault, from what an alarm is made of.

Two ways. From physics alone: the magnitude that has left its healthy spread furthest, in the sense
in which wear moves it. From signatures, where motions with known faults were given at calibration:
the nearest mean of scores, if it is nearer than health is by a good part. Signatures are statistics
of one rig; they carry over to another only as far as that rig is alike.
"""

from dataclasses import dataclass

import numpy as np

from ematwin.monitoring.calibration import Signature
from ematwin.monitoring.population import load_basis

UNNAMED = "unnamed change"
# Fault by the magnitude that it raises.
BY_MAGNITUDE = {
    "friction": "lubrication",
    "backlash": "backlash",
    "roughness": "spalling",
}
_CLEAR = 3.0  # standard deviations of a magnitude, for a name from physics
_EXPLAINED = 0.15  # of the squared scores, for a name from a signature
REACH = 15.0  # standard deviations, the most that one feature counts


@dataclass(frozen=True)
class Name:
    """The name of a fault and where it comes from.

    Attributes
    ----------
    fault : e.g. "lubrication", or `UNNAMED`
    by : "physics", "signature" or ""
    """

    fault: str
    by: str


def named_by_physics(scores: dict[str, float]) -> Name:
    """The fault whose magnitude is furthest above its healthy spread.

    ``scores`` are those of `ematwin.monitoring.measure.REPORTED`, in standard deviations.
    """
    raised = {name: scores[name] for name in BY_MAGNITUDE if scores[name] > _CLEAR}
    if not raised:
        return Name(UNNAMED, "")
    return Name(BY_MAGNITUDE[max(raised, key=lambda name: raised[name])], "physics")


def named_by_signature(
    scores: np.ndarray, load: np.ndarray, load_scale: float, signatures: tuple[Signature, ...]
) -> Name:
    """The fault whose signature is nearest to motions with these scores.

    Parameters
    ----------
    scores : (N, F) array, of motions that are judged together
    load : (N,) array, N
    """
    limited = np.clip(scores, -REACH, REACH)
    basis = load_basis(load, load_scale)
    distances = [float(((limited - basis @ s.coefficients) ** 2).sum()) for s in signatures]
    nearest = int(np.argmin(distances))
    healthy = float((limited**2).sum())
    if distances[nearest] > (1.0 - _EXPLAINED) * healthy:
        return Name(UNNAMED, "")
    return Name(signatures[nearest].fault, "signature")
