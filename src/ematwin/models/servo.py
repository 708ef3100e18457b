"""What rotary servo actuators share: normalised faults, and what is drawn.

Faults of a motor with a gear that follows a commanded output position, each from 0 to 1.
"""

from collections.abc import Callable
from typing import Any

from ematwin.models.base import Signal
from ematwin.models.unknown import Unknown
from ematwin.recordings.recording import Recording


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
