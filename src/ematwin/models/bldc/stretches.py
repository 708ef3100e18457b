"""Stretches of a recording on the monitor model's time base, and candidates over them.

Electrical power counts beside the equivalent current where voltages or the supply's current were
recorded (docs/models.md, "Electrical power"). Under current control a sensor that reads 3 % too
much looks like a torque constant that is 3 % smaller: the voltage for each ampere tells them apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ematwin.models.bldc.channels import PHASES, VOLTAGES
from ematwin.models.bldc.constants import V_SUPPLY
from ematwin.models.bldc.counts import steps_of
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.comparison import Candidates
from ematwin.numerics.filters import compare
from ematwin.numerics.signals import LowPass, filtered
from ematwin.recordings.recording import Recording

# Relative error of the twin's power, against the reference model with means of 50 us: 0.8 to 2.1 %
# on three recordings, of which 0.9 to 1.8 % are the product of means in place of the mean product.
_TWIN_ERROR = 0.02
_PAIRS = tuple(zip(PHASES, VOLTAGES, strict=True))


@dataclass(frozen=True)
class Power:
    """Recorded electrical power."""

    watts: np.ndarray  # (S,)
    by_phases: bool  # made of phase currents, whose sensors it shares
    nominal_supply: float | None = None  # V that multiplied a bus current, if none was recorded

    def of(self, recording: Recording) -> np.ndarray:
        """The power (S,) of an answer of the reference model, formed as this was."""
        x = recording.channels
        return _by_phases(x) if self.by_phases else x["bus_current"] * x["bus_voltage"]

    def error(self, filtered: np.ndarray, low_pass: LowPass, sample_rate: float) -> float:
        """Standard deviation of the residual of a filtered twin, W."""
        noise = low_pass.passed_noise(self.watts, filtered, sample_rate)
        return float(np.sqrt(noise + _TWIN_ERROR**2 * np.mean(filtered**2)))


def _by_phases(channels: Mapping[str, np.ndarray]) -> np.ndarray:
    return np.sum([channels[i] * channels[v] for i, v in _PAIRS], axis=0)


def recorded_power(recording: Recording, actuator: BldcActuator) -> Power | None:
    """The electrical power of a recording; None where it does not tell it."""
    channels = recording.channels
    if {*PHASES, *VOLTAGES} <= channels.keys():
        return Power(_by_phases(channels), by_phases=True)
    if "bus_current" not in channels:
        return None
    current = channels["bus_current"]
    if "bus_voltage" in channels:
        return Power(current * channels["bus_voltage"], by_phases=False)
    supply = actuator.drive.supply_voltage
    return Power(current * supply, by_phases=False, nominal_supply=supply)


@dataclass(frozen=True)
class PowerStretches:
    """Recorded power, to be compared."""

    recorded: Power
    target: np.ndarray  # (S,), W, filtered
    weights: np.ndarray  # (S,), 1/W^2
    states: np.ndarray  # (N, 2), of the low-pass at the first sample of each stretch


@dataclass(frozen=True)
class Stretches:
    """Stretches of one recording, all of the same length; the whole one may be the only one."""

    command: np.ndarray  # (S,), rad on the motor shaft, of the whole recording
    load: np.ndarray  # (S,), N m on the motor shaft
    target: np.ndarray  # (S,), A, filtered equivalent current
    weights: np.ndarray  # (S,), s/A
    starts: np.ndarray  # (N,) samples at which each begins; they count nothing themselves
    samples: int  # of each stretch
    states: np.ndarray  # (N, 7), of the monitor model at each start
    taps: np.ndarray  # (N, 7), of the low-pass and its state at each start
    kept: int  # samples of a response over a stretch, at most
    thinned: int  # from one of these to the next, at most
    power: PowerStretches | None = None  # where it counts

    def __len__(self) -> int:
        return len(self.starts)

    def cut(
        self, recording: Recording, actuator: BldcActuator, length: float, currents: np.ndarray,
        rectified: bool,
    ) -> "Stretches":  # fmt: skip
        """Stretches of a whole recording, of a ``length`` (s); each ends where another may start.

        The low-pass starts each as the recorded currents (S,), A, and power left it.
        """
        size, most = len(recording), 400  # of a longer recording as many, evenly spread
        samples = max(2, round(length * recording.sample_rate))
        starts = np.arange(0, max(1, size - samples), samples)
        if len(starts) > most:
            starts = starts[np.linspace(0, len(starts) - 1, most).astype(int)]
        recording, power = with_speeds(recording), self.power
        states = [
            initial_state(recording, actuator, None if rectified else float(currents[n]), n)
            for n in starts.tolist()
        ]
        if power is not None:
            taps = np.r_[self.taps[0, :5], power.states[0]]
            taps = _taps_at(starts, taps, power.recorded.watts)
            # contiguous, as of a whole recording: another layout compiles the kernel once more
            power = replace(power, states=np.ascontiguousarray(taps[:, 5:]))
        return replace(
            self, starts=starts, samples=min(samples + 1, size), states=np.stack(states),
            taps=_taps_at(starts, self.taps[0], currents), kept=max(8, self.kept // len(starts)),
            power=power,
        )  # fmt: skip

    @property
    def stride(self) -> int:
        """Samples from one of a response that is kept to the next."""
        wished = min(max(1, self.thinned), -(-self.samples // self.kept))
        return -(-self.samples // -(-self.samples // wished))

    @property
    def shown(self) -> int:
        """How many samples of a response over a stretch are kept."""
        return -(-self.samples // self.stride)

    def places(self, stride: int) -> np.ndarray:
        """(N, K) integer array: every so many samples of each stretch, from its start on."""
        return self.starts[:, None] + np.arange(0, self.samples, stride)

    def weighted(self, weights: np.ndarray, stride: int) -> np.ndarray:
        """(N, K) weights, of (S,) ones, of every so many samples; of each start none."""
        found = stride * weights[self.places(stride)]
        found[:, 0] = 0.0
        return found

    def compare(
        self, rows: np.ndarray, target: np.ndarray, weights: np.ndarray, late: np.ndarray | None
    ) -> None:
        """Change kept rows (B, N K) to weighted residuals.

        ``late`` (B,) is by how many samples the target is ahead of each row; None is not at all.
        """
        stride = self.stride
        places = self.places(stride)
        if late is None:
            rows -= target[places].ravel()
            rows *= np.sqrt(self.weighted(weights, stride)).ravel()
            return
        apart = rows.reshape(len(rows), *places.shape)
        compare(apart, target, np.sqrt(stride * weights), self.starts, stride, late)
        apart[:, :, 0] *= 0.0


@dataclass(frozen=True)
class Batch:
    """Candidates of a batch."""

    faults: np.ndarray  # (B, 8)
    constants: np.ndarray | None  # (B, 32), or None if all share them
    sensor: Candidates  # gains, offsets and delays of the sensors by name, (B,) each

    def distinct(self) -> tuple[np.ndarray, np.ndarray]:
        """Candidates (N,) that differ beside their sensors, and which of these each (B,) is."""
        # columns of a Jacobian that differ by a sensor alone need one simulation
        rows = self.faults if self.constants is None else np.hstack([self.faults, self.constants])
        places: dict[bytes, int] = {}
        back = [places.setdefault(row.tobytes(), len(places)) for row in rows]
        return np.unique(back, return_index=True)[1], np.array(back)

    def part(self, rows: slice | np.ndarray) -> "Batch":
        """Some of the candidates."""
        constants = None if self.constants is None else self.constants[rows]
        sensor = {name: values[rows] for name, values in self.sensor.items()}
        return Batch(self.faults[rows], constants, sensor)

    def late(self, interval: float) -> np.ndarray | None:
        """By how many samples (B,) the command of a candidate came late; None if it did not."""
        skew = self.sensor.get("skew")
        return None if skew is None else skew / interval

    def sensed(self, response: np.ndarray) -> np.ndarray:
        """Responses (B, K), changed in place, as current sensors show them, but for the clock."""
        if "current_gain" in self.sensor:
            response *= self.sensor["current_gain"][:, None]
        if "current_offset" in self.sensor:
            response += self.sensor["current_offset"][:, None]
        return response

    def sensed_power(self, power: Power, watts: np.ndarray, response: np.ndarray) -> np.ndarray:
        """Power (B, K) as it would be recorded beside currents (B, K), but for the clock."""
        sensor = self.sensor
        if "voltage_drop" in sensor:
            watts = watts + sensor["voltage_drop"][:, None] * np.abs(response)
        gain = np.ones(len(watts)) * sensor.get("power_gain", 1.0)
        if power.by_phases:
            gain *= sensor.get("current_gain", 1.0)
        elif power.nominal_supply is not None and self.constants is not None:
            gain *= power.nominal_supply / self.constants[:, V_SUPPLY]
        offset = np.zeros(len(watts)) + sensor.get("power_offset", 0.0)
        return np.asarray(gain[:, None] * watts + offset[:, None])


def tasks(parts: int, blocks: int, width: int, threads: int) -> list[tuple[slice, slice]]:
    """Stretches and rows of candidates that are simulated at a time: a share for each thread."""
    most = 8  # blocks of lanes over a whole recording: an interrupt waits for one task
    if parts > 1:
        each = max(1, -(-parts // max(threads, -(-blocks // most))))
        return [(slice(n, n + each), slice(None)) for n in range(0, parts, each)]
    each = max(1, min(most, blocks // threads))
    every = slice(None)
    return [(every, slice(n * width, (n + each) * width)) for n in range(0, blocks, each)]


def joined(answers: np.ndarray, count: int) -> np.ndarray:
    """The first rows (count, N K) of answers (N, B, K)."""
    parts, _, kept = answers.shape
    return answers[:, :count].transpose(1, 0, 2).reshape(count, parts * kept)


def with_speeds(recording: Recording) -> Recording:
    """The recording with speeds from its positions where it has none."""
    # slopes over a millisecond: those of single samples are mostly an encoder's steps
    half = max(1, round(0.5e-3 * recording.sample_rate))
    n = np.arange(len(recording))
    before, after = np.maximum(n - half, 0), np.minimum(n + half, len(recording) - 1)
    speeds = {}
    for side in ("motor", "output"):
        position = recording.channels.get(f"{side}_position")
        if position is not None and f"{side}_speed" not in recording.channels:
            span = recording.time[after] - recording.time[before]
            speeds[f"{side}_speed"] = (position[after] - position[before]) / span
    return recording.changed(**speeds) if speeds else recording


def initial_state(
    recording: Recording, actuator: BldcActuator, current: float | None, first: int = 0
) -> np.ndarray:
    """State (7,) of the monitor model at a sample.

    Speeds of counts are slopes over a millisecond. Where it was not recorded, the motor stands
    where the output is, the output where the command is, and speeds are slopes of positions.
    """
    ratio, dt = actuator.transmission.ratio, recording.interval
    if recording.motor_speed is None and any(steps_of(recording, actuator)):
        recording = with_speeds(recording)
    output, motor = recording.output_position, recording.motor_position

    def seen(position: np.ndarray, scale: float) -> tuple[float, float]:
        angle, after = position[first], position[first + 1]
        return float(angle) * scale, float(after - angle) * scale / dt

    if output is not None:
        theta_o, w_o = seen(output, ratio)
    elif motor is not None:
        theta_o, w_o = seen(motor, 1.0)
    else:
        theta_o, w_o = float(recording.command[first]) * ratio, 0.0
    if recording.output_speed is not None:
        w_o = float(recording.output_speed[first]) * ratio
    theta_m, w_m = (theta_o, w_o) if motor is None else seen(motor, 1.0)
    if recording.motor_speed is not None:
        w_m = float(recording.motor_speed[first])
    now = current or 0.0
    return np.array([now, w_m, theta_m, w_o, theta_o, 0.0, now])


def _taps_at(starts: np.ndarray, taps: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """(N, 7) taps of a filter at each start, as a recorded signal (S,) has left it there."""
    found, done = np.tile(taps, (len(starts), 1)), 0
    for row, start in zip(found, starts.tolist(), strict=True):
        _, row[5:] = filtered(taps, signal[done : start + 1])
        taps = row
        done = start + 1
    return found
