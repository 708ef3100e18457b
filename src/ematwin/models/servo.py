"""What rotary servo actuators share: normalised faults, and what is drawn.

Faults of a motor with a gear that follows a commanded output position, each from 0 to 1.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ematwin.models.base import Law, Model, Signal
from ematwin.models.unknown import Unknown
from ematwin.recordings.recording import Recording

_SUM = 0.05  # of the RMS of the phases: their sensors and converters differ by less
_BROKEN = 0.2  # of it: no gains of sensors leave as much once the best is taken off
_SLOPE = 0.1  # of the RMS of a speed: how far a drive's own may be from the slope of the position


def normalised_fault(
    name: str,
    meaning: str,
    unit: str,
    physical: Callable[[Any, Any], Any] | None,
    healthy: float = 0.0,
    **more: Any,
) -> Unknown:
    """A fault from 0 to 1; ``unit`` is that of ``physical``, ``more`` as of `Unknown`."""
    return Unknown(
        name, "", meaning, healthy, 0.0, 1.0, physical_unit=unit, physical=physical, **more
    )


def tracking_signals(recording: Recording) -> list[Signal]:
    """How the output follows its command; nothing where its position is not recorded."""
    output = recording.output_position
    if output is None:
        return []
    command = 1e3 * recording.command
    return [
        Signal("Output position", "mrad", 1e3 * output, command),
        Signal("Following error", "mrad", command - 1e3 * output),
    ]


def star_laws(recording: Recording, phases: Sequence[str], text: str, most: float) -> list[Law]:
    """Three phases add up to zero (Kirchhoff); ``most`` as a share of their RMS, as of `Law`."""
    if not set(phases) <= recording.channels.keys():
        return []
    values = {name: recording.channels[name] for name in phases}
    size = float(np.sqrt(np.mean([one**2 for one in values.values()])))

    def total(taken: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.asarray(sum(taken.values()))

    return [Law(text, values, total, _SUM * size, most * size)]


def current_laws(recording: Recording) -> list[Law]:
    """The currents of a star winding add up to zero."""
    names = ("current_a", "current_b", "current_c")
    return star_laws(recording, names, "the phase currents do not add up to zero", _BROKEN)


def motion_laws(model: Model, recording: Recording, actuator: Any) -> list[Law]:
    """Motor and output turn together, but for the gap; a speed is the slope of its position.

    A gap of any size leaves a multiple of the sign of the speed, and the twist of the gear one of
    the load.
    """
    channels, gear = recording.channels, actuator.transmission
    gap = model.unknown(actuator, "backlash")
    widest = gap.physical_value(actuator, gap.upper).value  # rad on the motor shaft
    found = []
    if {"motor_position", "output_position"} <= channels.keys():
        output = channels["output_position"]
        load = channels.get(model.load or "", np.zeros(output.size))
        sides = {
            "motor_position": channels["motor_position"],
            "output_position": np.stack([output, np.sign(np.gradient(output)), load]),
        }

        def apart(taken: Mapping[str, np.ndarray]) -> np.ndarray:
            turned, *shapes = taken["output_position"]
            return np.stack([taken["motor_position"] - gear.ratio * turned, *shapes])

        text = "motor and output do not turn together"
        found.append(Law(text, sides, apart, gear.backlash, play=widest))
    for side in ("motor", "output"):
        position, speed = f"{side}_position", f"{side}_speed"
        if {position, speed} <= channels.keys():
            both = {
                speed: channels[speed],
                position: np.gradient(channels[position], recording.interval),
            }
            size = float(np.sqrt(np.mean(channels[speed] ** 2)))
            text = f"{speed} is not the slope of {position}"
            found.append(Law(text, both, lambda taken: np.subtract(*taken.values()), _SLOPE * size))
    return found
