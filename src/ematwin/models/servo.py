"""What rotary servo actuators share: normalised faults, and what of them is reported and drawn.

Faults of a motor with a gear that follows a commanded output position, each from 0 to 1.
"""

from collections.abc import Callable, Iterable
from typing import Any

from ematwin.models.base import Reported, Signal
from ematwin.models.unknown import Unknown
from ematwin.recordings.recording import Recording

_LEAST = 0.2  # of its range: no healthy run is so far from the others


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


def reported_magnitudes(unknowns: Iterable[Unknown]) -> tuple[Reported, ...]:
    """Each magnitude as it is searched; a direction is no finding of its own."""
    return tuple(
        Reported(
            one.name,
            "",
            one.meaning,
            named=one.name,
            least=_LEAST,
            either=one.lower < one.healthy,
        )
        for one in unknowns
        if one.direction_of is None
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
