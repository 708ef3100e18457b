"""Channel: one signal of the recordings of a kind of actuator."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

NAMED: set[str] = set()  # every channel that some kind of actuator declares


@dataclass(frozen=True)
class Derivation:
    """How a channel follows from others, where a file has those and not the channel itself."""

    formula: str  # for the provenance, such as "set_point - position"
    sources: tuple[str, ...]  # names of the channels that it follows from
    compute: Callable[..., np.ndarray]  # from their values, (S,) in SI, to those of the channel


@dataclass(frozen=True)
class Channel:
    """One named signal.

    Parameters
    ----------
    name : as it is called in a `Recording`
    unit : SI unit
    meaning : for people
    aliases : other names under which files may have it, in lower case with underscores
    side : "motor" or "output", the shaft on which a recording holds it; None if it turns with none
    is_mean : a sample is the mean over the interval that ends at its time, as an integrating
        converter gives it; else the value at that time
    derived : how it follows from others; None if it has to be recorded
    may_rest : one value throughout is no sign of a dead sensor: a current that is held at zero
    refreshed : s, period at which the device samples; a host reads in between; 0 if each read is a
        sample
    stands_in_for : the channel that this one is only there to derive: files may have it instead,
        and recordings read from them hold the other
    """

    name: str
    unit: str
    meaning: str
    aliases: tuple[str, ...] = ()
    side: str | None = None
    is_mean: bool = False
    derived: Derivation | None = None
    stands_in_for: str | None = None
    may_rest: bool = False
    refreshed: float = 0.0

    def __post_init__(self) -> None:
        NAMED.add(self.name)


TIME = Channel("time", "s", "time", aliases=("t",))


def with_time(channels: Sequence[Channel]) -> tuple[Channel, ...]:
    """The channels with time before them, if they have none."""
    if any(channel.name == TIME.name for channel in channels):
        return tuple(channels)
    return (TIME, *channels)


def plain(text: str) -> str:
    """A name as it is compared: lower case, underscores for spaces."""
    return text.strip().casefold().replace(" ", "_")


def channel_called(text: str, channels: Sequence[Channel]) -> Channel | None:
    """The channel that a name or alias means, or None."""
    key = plain(text)
    for channel in channels:
        if key == channel.name or key in channel.aliases:
            return channel
    return None


def derivable(channels: Sequence[Channel], present: Collection[str]) -> list[Channel]:
    """The channels that are not there and follow from those that are."""
    return [
        channel
        for channel in channels
        if channel.name not in present
        and channel.derived is not None
        and all(source in present for source in channel.derived.sources)
    ]
