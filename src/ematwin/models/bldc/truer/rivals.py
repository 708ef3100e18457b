"""What missing turns may be mistaken for: forms of a fault that the parameter file leaves out.

An offset that is fixed in space gives each phase another constant,

    kappa_k ~ 1 + zeta cos(phi - 2 pi k/3),   k = 0, 1, 2,

and so do missing turns, h_k = 1 - short_k. Three numbers h_k are c (1 + zeta cos(phi - 2 pi k/3))
for exactly one c, zeta and phi, so a descent in the other form starts where the first one ended.
A loop of shorted turns brakes, which missing turns do not: where it starts is tried.
"""

import cmath
import math
from collections.abc import Mapping

from ematwin.models.base import OtherForm
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.sections import Eccentricity, ShortedTurns
from ematwin.models.bldc.unknowns import SHORTS

NAMES = frozenset((*SHORTS, "eccentricity"))  # faults that may be taken for one of another form
_THIRD = 2.0 * math.pi / 3.0
_SHORTED = (0.05, 0.15, 0.4)  # of the turns of a phase
_MOST = 0.95  # of the air gap


def other_forms(actuator: BldcActuator, found: Mapping[str, float]) -> tuple[OtherForm, ...]:
    """Forms that the file of an actuator leaves out, and where to look for them.

    ``found`` holds the values of its forms by name.
    """
    forms = []
    if actuator.eccentricity is None:
        forms.append(
            OtherForm(
                _with(actuator, "eccentricity", Eccentricity.example),
                "an eccentricity that is fixed in space",
                "[eccentricity] with turning_share = 0",
                ("eccentricity", "eccentricity_phase"),
                NAMES,
                (fixed_in_space(found),),
            )
        )
    if actuator.shorted_turns is None:
        healthy = {**found, **dict.fromkeys(SHORTS, 0.0)}
        rested = {**healthy, "friction": 0.0, "gain": 0.5}  # what a brake was taken for
        forms.append(
            OtherForm(
                _with(actuator, "shorted_turns", ShortedTurns.example),
                "shorted turns that carry a current of their own",
                "[shorted_turns] with the resistance of the contact",
                SHORTS,
                NAMES,
                tuple(
                    {**start, phase: share}
                    for start in (healthy, rested)
                    for phase in SHORTS
                    for share in _SHORTED
                ),
            )
        )
    return tuple(forms)


def fixed_in_space(found: Mapping[str, float]) -> dict[str, float]:
    """The offset with which each phase has the constant that missing turns give it."""
    left = [1.0 - found.get(name, 0.0) for name in SHORTS]
    mean = max(sum(left) / 3.0, 1e-6)
    offset = sum(h * cmath.exp(1j * _THIRD * k) for k, h in enumerate(left)) * 2.0 / (3.0 * mean)
    start = {**found, **dict.fromkeys(SHORTS, 0.0)}
    start["eccentricity"] = min(abs(offset), _MOST)
    start["eccentricity_phase"] = (cmath.phase(offset) / (2.0 * math.pi) + 0.5) % 1.0
    place = "motor.emf_constant"
    if place in found:
        start[place] = found[place] * mean
    return start


def _with(actuator: BldcActuator, section: str, values: Mapping[str, float]) -> BldcActuator:
    return actuator.changed({f"{section}.{name}": value for name, value in values.items()})
