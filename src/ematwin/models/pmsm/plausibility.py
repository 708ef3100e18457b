"""Plausibility of a recording of a PMSM servo: channels, units, limits, motion.

What makes a recording useless is an error with the likely cause; what makes it doubtful is a
sentence. The bounds are wide: a faulty actuator must pass, a wrong unit must not.
"""

from collections.abc import Mapping
from itertools import combinations, permutations
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.base import Law
from ematwin.models.plausibility import check_agreement, check_sizes, check_sum
from ematwin.models.pmsm.channels import (
    ROTATING,
    ROTATING_VOLTAGES,
    TERMINALS,
    VOLTAGES,
    to_rotor,
)
from ematwin.models.pmsm.comparison import MOVING
from ematwin.models.pmsm.parameters import PmsmActuator
from ematwin.models.servo import check_motion, current_laws, star_laws
from ematwin.recordings.channel import PHASES
from ematwin.recordings.recording import Recording


def check_phases(recording: Recording) -> None:
    """Raise `RecordError` where some phases are recorded and others are not."""
    for group, use in ((PHASES, "currents"), (VOLTAGES, "voltages"), (ROTATING, "currents"),
                       (ROTATING_VOLTAGES, "voltages"),
                       (TERMINALS, "measured voltages")):  # fmt: skip
        present = [name for name in group if name in recording.channels]
        if present and len(present) < len(group):
            missing = [name for name in group if name not in present]
            raise RecordError(
                f"{recording.name} has {', '.join(present)} but not {', '.join(missing)}: the "
                f"{use} need all of these to be turned into the rotor's frame. Record them, or "
                f"drop {', '.join(present)}."
            )
    if set(PHASES) <= recording.channels.keys() and "motor_position" not in recording.channels:
        if set(ROTATING) <= recording.channels.keys():
            return
        raise RecordError(
            f"{recording.name} has phase currents but no motor_position, which is needed to turn "
            "them into the rotor's frame; record it, or current_d and current_q."
        )


def check_plausible(recording: Recording, actuator: PmsmActuator) -> list[str]:
    """Sentences on doubts about a recording; `RecordError` if it cannot be identified from."""
    check_agreement(recording, actuator)
    control, supply = actuator.controller, actuator.drive.supply_voltage
    for names, limit, unit, most in (
        ((*PHASES, *ROTATING), control.current_limit, "A", 3.0),
        ((*VOLTAGES, *ROTATING_VOLTAGES, *TERMINALS), supply, "V", 1.5),
        (("motor_speed",), control.speed_limit, "rad/s", 3.0),
    ):
        said = f"{actuator.name} is limited to {limit:.4g} {unit}"
        check_sizes(recording.channels, names, limit, unit, said, most)
    check_motion(recording, actuator)
    _check_order(recording, actuator)
    doubts = [*_check_voltages(recording), *check_sum(recording)]
    return doubts + _check_start(recording, actuator)


def _check_order(recording: Recording, actuator: PmsmActuator) -> None:
    """Raise if phases are swapped: the drive holds the current along the magnets at zero."""
    if not {*PHASES, "motor_position"} <= recording.channels.keys():
        return
    angle = actuator.motor.pole_pairs * recording.channels["motor_position"]
    phases = [recording.channels[name] for name in PHASES]
    along = {}
    for order in permutations(range(3)):
        d, q = to_rotor(phases[order[0]], phases[order[1]], phases[order[2]], angle)
        along[order] = float(np.sqrt(np.mean(d**2) / max(np.mean(d**2 + q**2), 1e-30)))
    given, best = along[0, 1, 2], min(along, key=along.__getitem__)
    if given > 0.5 and along[best] < 0.2:  # of the current, RMS
        # phase_order names the phases that the given channels carry: the inverse of `best`
        carried = "".join("abc"[best.index(n)] for n in range(3))
        raise RecordError(
            "The phases are swapped: the drive holds the current along the magnets at zero, and "
            f"{100.0 * given:.0f} % of the current as recorded lies there, and "
            f'{100.0 * along[best]:.0f} % with phase_order = "{carried}". Give that in the map.'
        )


def _check_voltages(recording: Recording) -> list[str]:
    channels = recording.channels
    if set(ROTATING_VOLTAGES) <= channels.keys():
        return []
    if set(VOLTAGES) <= channels.keys() or set(TERMINALS) <= channels.keys():
        if "motor_position" in channels:
            return []
        return ["Without motor_position the phase voltages are not used. Record it."]
    return [
        "There are no voltages: lost flux, shorted turns, resistances and the gains of current "
        "sensors are hard to tell apart without. Record voltage_d and voltage_q as commanded, or "
        "terminal_voltage_a, terminal_voltage_b and terminal_voltage_c as measured."
    ]


def _check_start(recording: Recording, actuator: PmsmActuator) -> list[str]:
    motor = recording.channels.get("motor_position")
    if motor is None or len(motor) < 10:
        return []
    count = max(2, min(len(motor), round(5e-3 * recording.sample_rate)))
    speed = abs(float(motor[count - 1] - motor[0])) / ((count - 1) * recording.interval)
    if speed > MOVING * actuator.controller.speed_limit:
        return [
            f"The recording begins in motion ({speed:.3g} rad/s of the motor), and what the loops "
            "had integrated by then is not known. Begin it at rest."
        ]
    return []


def laws(recording: Recording, actuator: Any) -> list[Law]:
    """Phases of a star, and the drive's control of the current.

    Voltages may have a part that all phases share, so that their sum tells only of a channel that
    explains it.
    """
    voltages = star_laws(recording, VOLTAGES, "the phase voltages do not add up to zero", np.inf)
    # Terminals may be measured against one of them, which is zero then. The other two are line
    # voltages, which go together; beside a dead sensor two phases oppose.
    known = [recording.channels[name] for name in TERMINALS if name in recording.channels]
    moving = [values for values in known if values.any()]
    if len(moving) != 2 or float(moving[0] @ moving[1]) <= 0.0:
        text = "the terminal voltages do not add up to zero"
        voltages += star_laws(recording, TERMINALS, text, np.inf)
    rotor = _rotor_laws(recording, actuator.motor.pole_pairs)
    return [*current_laws(recording), *voltages, *rotor]


def _rotor_laws(recording: Recording, pole_pairs: int) -> list[Law]:
    """The drive holds the current along the magnets at zero, as it reads current and angle.

    It does so with any fault. Each two phases give that current: where one channel was computed
    from the other two, two of these laws fail, and one shows which channel is late.
    """
    channels = recording.channels
    if not {*PHASES, "motor_position"} <= channels.keys():
        return []
    size = float(np.sqrt(1.5 * np.mean([channels[name] ** 2 for name in PHASES])))

    def along(known: tuple[str, ...]) -> Law:
        def left(taken: Mapping[str, np.ndarray]) -> np.ndarray:
            third = -(taken[known[0]] + taken[known[1]])
            a, b, c = (taken[name] if name in known else third for name in PHASES)
            return np.asarray(to_rotor(a, b, c, pole_pairs * taken["motor_position"])[0])

        values = {name: channels[name] for name in (*known, "motor_position")}
        text = "phases and motor_position do not give the current that the drive controls"
        return Law(text, values, left, 0.1 * size)

    return [along(known) for known in combinations(PHASES, 2)]
