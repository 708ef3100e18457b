"""Laws that the channels of a PMSM servo satisfy whatever the faults."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from ematwin.models.base import Law, Model
from ematwin.models.pmsm.channels import PHASES, TERMINALS, VOLTAGES, to_rotor
from ematwin.models.servo import current_laws, motion_laws, star_laws
from ematwin.recordings.recording import Recording

_ALONG = 0.1  # of the RMS of the current: what its control lets through along the magnets


def laws(model: Model, recording: Recording, actuator: Any) -> list[Law]:
    """Phases of a star, the drive's control of the current, sides of the gear, speed.

    Voltages may have a part that all phases share, so that their sum tells only of a channel that
    explains it.
    """
    voltages = star_laws(recording, VOLTAGES, "the phase voltages do not add up to zero", np.inf)
    if not _against_each_other(recording):
        text = "the terminal voltages do not add up to zero"
        voltages += star_laws(recording, TERMINALS, text, np.inf)
    return [
        *current_laws(recording),
        *voltages,
        *_rotor_laws(recording, actuator.motor.pole_pairs),
        *motion_laws(model, recording, actuator),
    ]


def _against_each_other(recording: Recording) -> bool:
    """Whether terminals are measured against one of them, which is zero then.

    The other two are line voltages, a sixth of a turn apart, so that they go together; where the
    zero comes from a dead sensor they are a third of a turn apart and oppose each other.
    """
    known = [recording.channels[name] for name in TERMINALS if name in recording.channels]
    others = [values for values in known if values.any()]
    return len(others) == 2 and float(others[0] @ others[1]) > 0.0


def _rotor_laws(recording: Recording, pole_pairs: int) -> list[Law]:
    """The drive holds the current along the magnets at zero, as it reads current and angle.

    It does so with any fault, of its sensors too: it controls the current as they show it. Each two
    phases give that current. Where one channel was computed from the other two, two of these laws
    fail, and one shows which channel is late. A drive that weakens the field breaks all of them,
    and no channel explains it.
    """
    channels = recording.channels
    if not {*PHASES, "motor_position"} <= channels.keys():
        return []
    size = float(np.sqrt(1.5 * np.mean([channels[name] ** 2 for name in PHASES])))

    def rotor(taken: Mapping[str, np.ndarray], known: tuple[str, ...]) -> np.ndarray:
        third = -(taken[known[0]] + taken[known[1]])
        a, b, c = (taken[name] if name in known else third for name in PHASES)
        return to_rotor(a, b, c, pole_pairs * taken["motor_position"])

    def along(known: tuple[str, ...]) -> Law:
        values = {name: channels[name] for name in (*known, "motor_position")}
        text = "phases and motor_position do not give the current that the drive controls"
        return Law(text, values, lambda taken: rotor(taken, known)[0], _ALONG * size)

    return [along(known) for known in combinations(PHASES, 2)]
