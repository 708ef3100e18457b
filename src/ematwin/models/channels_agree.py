"""Whether the channels of a recording agree with each other; the sentence names one that does not.

A sensor that is dead, frozen or late looks like a fault of the actuator. It is told from one by
laws that hold whatever the faults: currents of a star winding add up to zero, an output turns with
its motor, a controller gives what its inputs ask for. A kind states its laws (`Model.laws`); here
they are tested:

- a channel stands still if it repeats its value exactly, and the law holds except while it does;
- a channel is late if the law holds once it is taken some time earlier;
- a channel is dead if it has nothing in common with the value that the others imply;
- channels contradict each other if a law is broken and none of these explains it.

A gain is none of these: it leaves nothing once the channel is divided by it. Without any law a
channel is still told to be dead where it stands still, or holds nothing but noise, while the
command moves.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.numerics.signals import white_noise
from ematwin.recordings.cleaning import runs
from ematwin.recordings.recording import Recording
from ematwin.showing.text import listed

if TYPE_CHECKING:
    from ematwin.models.base import Model

LATEST = 0.02  # s: later than the filter of any sensor and the cycle of any field bus
_APART = 0.1  # of what is left, at most, where a channel that moves is sound
_FEWEST = 8  # equal samples: a converter that rounds repeats a value now and then
_MOVES = 0.1  # of its range: the command moves


@dataclass(frozen=True)
class Law:
    """What channels of one recording satisfy whatever the faults."""

    text: str  # what does not hold, e.g. "the phase currents do not add up to zero"
    # (S,) by name, or (n, S) where a channel counts in several ways; the first is the channel
    channels: Mapping[str, np.ndarray]
    # residual of the law for such arrays, (S,), a constant where it holds; or (1 + m, S): the
    # residual and m shapes that faults may leave, in any multiples
    left: Callable[[Mapping[str, np.ndarray]], np.ndarray]
    slack: float  # RMS of what actuators may leave besides, in the unit of ``left``
    # RMS from which the law is broken though no channel explains it; infinite if causes that are
    # not recorded may break it
    most: float = np.inf
    # range of the residual while a sound channel stands still or reverses; a delay that changes it
    # by less is none
    play: float = 0.0


def checked(model: "Model", recording: Recording, actuator: Any) -> tuple[list[str], list[str]]:
    """Sentences on doubts about a recording, and on channels that forbid a verdict.

    Raises `RecordError` if it contradicts itself or the actuator; the channel is named where one is
    the cause.
    """
    model.check_channels(recording)
    _check_unit_of_time(model, recording)
    found = contradictions(model, recording, actuator)
    try:
        doubts = model.check(recording, actuator)
    except RecordError as error:
        named = [text for names, text in found.items() if len(names) == 1]
        if named:
            raise RecordError(f"{recording.name}: {' '.join(named)}") from error
        raise
    return doubts, list(found.values())


def _check_unit_of_time(model: "Model", recording: Recording) -> None:
    """Refuse times in ms that were read as seconds: a simulation of them hardly ends."""
    ratio = recording.interval * model.sample_rate
    time = recording.provenance.get("columns", {}).get("time")
    stated = not isinstance(time, dict) or time.get("unit_from") != "assumed"
    if ratio > 300.0 and not stated:  # less may be a slow logger
        raise RecordError(
            f"{recording.name} has a sample every {recording.interval:.4g} s, {ratio:.0f} times "
            f"the {1e3 / model.sample_rate:.3g} ms of the kind {model.kind}, and nobody stated the "
            'unit of time: it looks like ms. State it in the map or in the name, as in "time [ms]".'
        )


def contradictions(
    model: "Model", recording: Recording, actuator: Any
) -> dict[tuple[str, ...], str]:
    """Sentences on channels that stand still, are late or contradict others, by the channels."""
    command = recording.channels[model.command]
    if len(recording) < 100 or not np.ptp(command) > 0.0:  # of fewer nothing can be said
        return {}
    laws = model.laws(recording, actuator)
    needed = {name for group in model.required for part in group for name in part}
    needed |= {name for law in laws for name in law.channels}
    sensors = {
        channel.name: channel.name in needed and not channel.may_rest
        for channel in model.channels
        if channel.name in recording.channels and channel.name not in (model.command, model.load)
    }
    found: dict[tuple[str, ...], str] = {
        (name,): f"{name} holds nothing but noise while {model.command} moves; check that sensor."
        for name, must_move in sensors.items()
        if must_move and _is_noise(recording.channels[name])
    }
    for law in laws:
        named = {name for names in found for name in names}
        names, sentence = _Trial(model, recording, law).cause()
        if names and not named & law.channels.keys():
            found[names] = sentence
    for name, must_move in sensors.items():
        sentence = _unmoved(model, recording, name, must_move)
        if sentence and (name,) not in found:
            found[name,] = sentence
    return found


def _unmoved(model: "Model", recording: Recording, name: str, must_move: bool) -> str:
    """The sentence on a channel that stands still while the command moves; "" if none does."""
    # of a part, one that has noise elsewhere counts, if the value is not an end of its range
    command, values = recording.channels[model.command], recording.channels[name]
    first, last = max(_repeats(values), key=lambda ends: ends[1] - ends[0], default=(0, 0))
    if last - first <= 0.1 * values.size:  # longer shows without a law
        return ""
    if np.ptp(command[first:last]) <= _MOVES * np.ptp(command):
        return ""
    held, others = values[first], np.delete(values, slice(first, last))
    if others.size == 0:
        return _still(model, recording, name, held, [], [model.command]) if must_move else ""
    is_noisy = white_noise(others) > 0.0 and np.mean(np.diff(others) == 0.0) < _MOVES
    if is_noisy and others.min() < held < others.max():
        return _still(model, recording, name, held, [(first, last)], [model.command])
    return ""


def _is_noise(values: np.ndarray) -> bool:
    """Whether values (S,) are white noise: no two of them are alike for being close in time."""
    about = values - values.mean()
    power = float(about @ about)
    if values.size <= 200 or power == 0.0:
        return False
    alike = [abs(float(about[lag:] @ about[:-lag])) for lag in range(1, 21)]
    # four standard deviations of a correlation of white noise
    return max(alike) < 4.0 / np.sqrt(values.size) * power


class _Trial:
    """A law of one recording, and what its channels would have to be for it to hold."""

    def __init__(self, model: "Model", recording: Recording, law: Law) -> None:
        self._model, self._recording, self._law = model, recording, law
        size = len(recording)
        samples = np.arange(0, size, max(1, size // 2000))
        self._whole = samples[recording.measured[samples]]  # samples of a law
        self._residual = self._rows(np.arange(size))[0]
        self._noise = white_noise(self._residual)
        self._plain = self._left(self._whole)

    def cause(self) -> tuple[tuple[str, ...], str]:
        """The channel that breaks the law, or those that may, and a sentence on it.

        None where a gain explains it, or what an actuator and noise may leave.
        """
        if self._plain <= self._law.slack:
            return (), ""
        for name in self._law.channels:
            if stretches := self._still(name):
                held = np.ravel(self._law.channels[name])[stretches[0][0]]
                where = [] if stretches[0] == (0, len(self._recording)) else stretches
                siblings = [other for other in self._law.channels if other != name]
                return (name,), _still(self._model, self._recording, name, held, where, siblings)
        follows = {name: self._follows(name) for name in self._law.channels}
        linear = {name: one for name, one in follows.items() if one is not None}
        # a gain may be off by 0.3: faults of sensors reach 0.2, and a law sees two of them
        gains = {name: 1.0 / np.clip(gain, 0.7, 1.3) for name, (gain, _) in linear.items()}
        each = (self._left(self._whole, {name: times}) for name, times in gains.items())
        least = min(each, default=self._plain)
        if least <= self._law.slack:
            return (), ""
        late, lag = self._latest()
        # of its power a quarter at most is left
        early = self._early(lag)
        explains = lag and self._left(early, {}, late, lag) <= 0.5 * least
        changes = self._rows(early)[0] - self._rows(early, {}, late, lag)[0]
        if explains and np.ptp(changes) > self._law.play:
            return (late,), (
                f"{late} is {1e3 * lag * self._recording.interval:.2g} ms late: {self._law.text}, "
                "and do if it is taken so much earlier. Check that sensor, its filter and its "
                "clock."
            )
        names = tuple(self._law.channels)
        # a third dead phase leaves the others a correlation of 0.5
        dead = tuple(key for key, (_, alike) in linear.items() if alike < 0.3)
        if len(linear) == len(names) and len(dead) == 1:
            others = listed([key for key in names if key not in dead])
            return dead, (
                f"{dead[0]} does not follow {others}: {self._law.text}, and it has nothing of what "
                "they make of it. Check that sensor."
            )
        if least <= self._law.most and len(dead) < len(names):
            return (), ""
        return names, (
            f"{listed(names)} contradict each other: {self._law.text}, and neither a gain nor a "
            "delay of one of them explains it. Check these sensors, their order and scales."
        )

    def _rows(
        self, samples: np.ndarray, times: Mapping[str, float] = {}, late: str = "", lag: int = 0
    ) -> np.ndarray:
        """Residual and shapes (1 + m, K) of the law at some samples.

        ``times`` multiplies channels; the channel ``late`` is taken ``lag`` samples later.
        """
        taken = {
            name: values[..., samples + (lag if name == late else 0)] * times.get(name, 1.0)
            for name, values in self._law.channels.items()
        }
        return np.atleast_2d(self._law.left(taken))

    def _left(self, samples: np.ndarray, *changes: Any) -> float:
        """RMS of the residual of `_rows`, without noise, shapes and a few false reads."""
        rows = self._rows(samples, *changes)
        shapes = np.vstack([np.ones(samples.size), rows[1:]]).T
        kept = np.ones(samples.size, dtype=bool)
        for _ in range(2):
            best = np.linalg.lstsq(shapes[kept], rows[0, kept], rcond=None)[0]
            rest = np.abs(rows[0] - shapes @ best)
            kept = rest <= np.quantile(rest, [0.98])[0]  # false reads, ends, corners of a command
        rest = rest[kept]
        return float(np.sqrt(max(0.0, np.mean(rest**2) - self._noise**2)))

    def _follows(self, name: str) -> tuple[float, float] | None:
        """Gain on the value that the others imply, and correlation; None if it is not linear."""
        none, one, two = (self._rows(self._whole, {name: times})[0] for times in (0.0, 1.0, 2.0))
        share, expected = one - none, none.mean() - none
        share -= share.mean()
        sizes = float(np.linalg.norm(share)), float(np.linalg.norm(expected))
        if min(sizes) == 0.0 or not np.allclose(two - one, one - none, atol=1e-6 * sizes[0]):
            return None
        product = float(share @ expected)
        return product / sizes[1] ** 2, product / (sizes[0] * sizes[1])

    def _still(self, name: str) -> list[tuple[int, int]]:
        """Stretches in which a channel stands still and the law does not hold, if it does else."""
        found = [
            (first, last)
            for first, last in _repeats(np.atleast_2d(self._law.channels[name])[0])
            if np.ptp(self._residual[first:last]) > self._law.play
        ]  # fmt: skip
        still = np.zeros(len(self._recording), dtype=bool)
        for first, last in found:
            still[first:last] = True
        moving = self._whole[~still[self._whole]]
        most = max(self._law.slack, _APART * self._plain)
        if moving.size > _FEWEST and self._left(moving) > most:
            return []
        longest = max((last - first for first, last in found), default=0)
        return [ends for ends in found if ends[1] - ends[0] > _APART * longest]

    def _early(self, lag: int) -> np.ndarray:
        """Samples that have another one ``lag`` later."""
        return self._whole[self._whole < len(self._recording) - lag]

    def _latest(self) -> tuple[str, int]:
        """The channel and the delay, in samples, with which least is left; 0 if there is none."""
        recording = self._recording
        most = int(min(LATEST * recording.sample_rate, 0.05 * len(recording)))
        if most < 1:
            return "", 0
        here = self._early(most)
        # each longer than the one before by the same share
        lags = sorted(set(np.geomspace(1, most, 40).astype(int).tolist()))
        name, lag = min(
            ((name, lag) for name in self._law.channels for lag in lags),
            key=lambda one: self._left(here, {}, *one),
        )
        near = range(max(1, lag - lag // 8), min(most, lag + lag // 8) + 1)
        return name, min(near, key=lambda lag: self._left(here, {}, name, lag))


def _repeats(values: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of equal values (S,), as (first, one past the last)."""
    alike = runs(np.diff(values) == 0.0)
    return [(first, end + 1) for first, end in alike if end + 1 - first >= _FEWEST]


def _still(
    model: "Model", recording: Recording, name: str, held: float,
    stretches: Sequence[tuple[int, int]], others: Sequence[str],
) -> str:  # fmt: skip
    """The sentence on a channel that stands still in some stretches, or throughout."""
    unit = recording.units.get(name, model.channel(name).unit)
    when = ""
    if stretches:
        first, last = stretches[0]
        start, stop = (1e3 * float(recording.time[n]) for n in (first, last - 1))
        when = f" from {start:.4g} ms on" if last == len(recording) else (
            f" from {start:.4g} to {stop:.4g} ms"
        )  # fmt: skip
        when += f" and {len(stretches) - 1} more times" * (len(stretches) > 1)
    verb = "moves" if len(others) == 1 else "move"
    return (
        f"{name} stands still at {held + 0.0:.4g} {unit}{when} while {listed(others)} {verb}; "
        "check that sensor."
    )
