"""How badly candidates explain a recording of a PMSM servo (docs/pmsm.md).

Its channels pass one low-pass, which keeps twice the electrical frequency, where a fault of one
phase appears, and are thinned as the low-pass allows. Each is weighed by its recorded noise and by
the error of the twin.
"""

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.base import Model
from ematwin.models.comparison import Candidates, Comparison, correlation_time
from ematwin.models.plausibility import check_enough, check_moves
from ematwin.models.pmsm.channels import ROTATING_VOLTAGES, TERMINALS, VOLTAGES, in_rotor_frame
from ematwin.models.pmsm.parameters import PmsmActuator
from ematwin.models.pmsm.unknowns import backlash_factor, constants_of
from ematwin.numerics.side_by_side import by_candidate, cores, side_by_side
from ematwin.numerics.signals import LowPass, white_noise
from ematwin.recordings.recording import Recording

CUTOFF = 800.0  # Hz
LOWEST_CUTOFF = 200.0  # Hz, for recordings that are sampled slowly
_RATE = 4.0  # times the cutoff: the least rate at which a low-pass acts as one
REFERENCE_ERROR = 0.001  # of what corrects the twin, of the RMS of a channel
SETTLED = 0.2  # s that a drive holds its first position before a simulation or recording begins
MOVING = 0.05  # of the speed limit: what begins faster does not begin at rest
_CAPTIONS = {
    "current_q": ("Torque current", "A"),
    "current_d": ("Magnetising current", "A"),
    "voltage_q": ("Voltage, q", "V"),
    "voltage_d": ("Voltage, d", "V"),
    "motor_speed": ("Motor speed", "rad/s"),
    "following_error": ("Following error, on the motor shaft", "rad"),
}
COMPARED = tuple(_CAPTIONS)


class PmsmComparison(Comparison):
    """Weighted squares between a batch of candidates and a recording."""

    whitened = True
    model_error, has_reference = Model.model_error, True

    def __init__(
        self, recording: Recording, actuator: PmsmActuator, *, threads: int | None = None
    ) -> None:
        self.recording, self.actuator = recording, actuator
        self.threads = threads or cores()
        check_enough(recording)
        rate = recording.sample_rate
        tick = actuator.controller.current_time
        cutoff = min(CUTOFF, rate / _RATE, 1.0 / (_RATE * tick))
        if cutoff < LOWEST_CUTOFF:
            raise RecordError(
                f"The record is sampled at {rate:.6g} Hz and the currents of {actuator.name} are "
                f"controlled at {1.0 / tick:.6g} Hz; {_RATE * LOWEST_CUTOFF:g} Hz are needed, so "
                "that the ripple of a faulty phase is seen. Record faster."
            )
        self.low_pass = LowPass(cutoff)
        self.substeps = actuator.substeps(actuator.steps.monitor)
        self.step = tick / self.substeps
        self.every = max(1, int(1.0 / (3.0 * cutoff * tick)))
        last = float(recording.time[-1] - recording.time[0])
        self._ticks = np.arange(math.floor(last / tick + 1e-6) + 1) * tick
        self._time = recording.time - recording.time[0]
        alike = self._time.size == self._ticks.size
        self._on_each_tick = alike and np.allclose(self._time, self._ticks, atol=1e-9)
        ratio = actuator.transmission.ratio
        load = recording.channels.get("load", np.zeros(len(recording)))
        self.command = self._on_ticks(recording.channels["command"] * ratio)
        self.load = self._on_ticks(load / ratio)
        signals = signals_of(recording, actuator)
        self._measured = only_measured(recording)
        check_moves(signals["current_q"])
        self.start = first_state(recording, actuator, signals)
        self._rows = [n for n, name in enumerate(COMPARED) if name in signals]
        self._hold()
        self._left: np.ndarray | None = None
        self._set(signals)

    def _hold(self) -> None:
        """Let a candidate hold the first position before a recording that begins at rest.

        That is its first command, as in a simulation, unless the command begins with a step. Where
        motor and output stand then, and the integrals of the loops, depend on the faults.
        """
        self.before = 0
        if abs(self.start[1]) > MOVING * self.actuator.controller.speed_limit:
            return
        self.before = self.actuator.whole_ticks(SETTLED)
        self.start[[1, 3, 4, 5]] = 0.0
        widest = backlash_factor(1.0) * self.actuator.transmission.backlash
        if abs(self.command[0] - self.start[2]) <= widest:
            self.start[2] = self.command[0]
        self.command = np.concatenate([np.full(self.before, self.start[2]), self.command])
        self.load = np.concatenate([np.full(self.before, self.load[0]), self.load])

    def _set(self, signals: Mapping[str, np.ndarray]) -> None:
        """Form the compared traces from signals (S,) by name."""
        rate = self.recording.sample_rate
        self._signals = dict(signals)
        self._filtered = {n: self.low_pass.apply(trace, rate) for n, trace in signals.items()}
        self._target = self.thinned(self._filtered)
        self._weigh(0.003)  # of the RMS of a channel

    def _weigh(self, model_error: float) -> None:
        """Weigh channels by their noise and by the error of a model, as a share of their RMS."""
        power = np.zeros(len(COMPARED))
        noise, passed = power.copy(), self.low_pass.noise_gain(self.recording.sample_rate)
        for n in self._rows:
            power[n] = float(np.mean(self._filtered[COMPARED[n]] ** 2))
            noise[n] = passed * white_noise(self._signals[COMPARED[n]]) ** 2
        noise = noise if self._left is None else self._left
        for pair in (power[:2], power[2:4]):  # both currents have one size, and both voltages
            pair[:] = pair.sum()
        error = noise + model_error**2 * power
        self._weights = np.zeros(len(COMPARED))
        counts = [n for n in self._rows if error[n] > 0.0]
        self._weights[counts] = 1.0 / error[counts]
        measured = self.thinned(self._filtered)
        kept = measured.shape[1] * len(self._rows)
        self.scale = float(np.sum(self._weights[:, None] * measured**2))
        each = max(1.0, 2.0 * self.low_pass.cutoff * float(self._ticks[-1]))
        self.independent = each * len(self._rows)
        self.noise = math.sqrt(kept / self.independent)
        self.expected_misfit = math.sqrt(kept / self.scale)

    def _on_ticks(self, values: np.ndarray) -> np.ndarray:
        """Values (S,) at the ticks of the current loops."""
        if self._on_each_tick:
            return np.ascontiguousarray(values)
        return np.interp(self._ticks, self._time, values)

    def thinned(self, traces: Mapping[str, np.ndarray]) -> np.ndarray:
        """Traces (S,) by name as the kernel takes them, (6, kept); zero where there is none."""
        kept = -(-self._ticks.size // self.every)
        found = np.zeros((len(COMPARED), kept))
        for name, trace in traces.items():
            found[COMPARED.index(name)] = self._on_ticks(trace)[:: self.every]
        return found

    def with_missed(self, missed: Mapping[str, np.ndarray]) -> "PmsmComparison":
        """The same comparison, the error of the twin, (S,), subtracted from the recording."""
        other = copy.copy(self)
        known = {name: trace for name, trace in missed.items() if name in self._signals}
        other._target = self.thinned(self._filtered) - self.thinned(known)
        other._weigh(REFERENCE_ERROR)
        return other

    def reweighed(self, residuals: np.ndarray) -> "PmsmComparison":
        """The same comparison with each channel weighed by its residuals, (K,) in all."""
        other = copy.copy(self)
        counted = self.independent / residuals.size
        other._left = np.zeros(len(COMPARED))
        for n, left in zip(self._rows, residuals.reshape(len(self._rows), -1), strict=True):
            alike = max(1.0, counted * correlation_time(left))
            weight = self._weights[n]
            other._left[n] = alike * float(np.mean(left**2)) / weight if weight > 0.0 else 0.0
        other._weigh(REFERENCE_ERROR)
        return other

    def exact(self, values: Mapping[str, float]) -> dict[str, np.ndarray] | None:
        """Low-passed response of the reference, (S,) arrays; None where it begins in motion."""
        if self.before == 0:
            return None
        from ematwin.models.pmsm.simulate import channels_of, reference_columns

        actuator = self.actuator.varied(values)
        ratio = actuator.transmission.ratio
        substeps = actuator.substeps(actuator.steps.reference)
        columns = reference_columns(
            actuator, values, self.command / ratio, self.load * ratio, float(self.start[2]) / ratio,
            substeps, 1,
        )  # fmt: skip
        found = channels_of({n: column[self.before :] for n, column in columns.items()}, actuator)
        recorded = self.recording
        answer = recorded.changed(**{
            name: np.interp(self._time, self._ticks, trace)
            for name, trace in found.items()
            if name in recorded.channels
        })  # fmt: skip
        signals = signals_of(answer, actuator)
        return {n: self.low_pass.apply(x, recorded.sample_rate) for n, x in signals.items()}

    def averaged(self, others: Sequence[Comparison]) -> "PmsmComparison":
        """The mean of this recording and others over the same command."""
        signals = [self._signals, *(o._signals for o in others if isinstance(o, PmsmComparison))]
        other = copy.copy(self)
        other._set({n: np.mean([one[n] for one in signals], axis=0) for n in self._signals})
        return other

    def measured(self) -> dict[str, np.ndarray]:
        """The recorded traces, (S,) arrays."""
        return dict(self._filtered)

    def captions(self) -> dict[str, tuple[str, str]]:
        """What each is."""
        said = f"({self.low_pass.cutoff:g} Hz low-pass)"
        return {
            name: (f"{title} {said}", unit)
            for name, (title, unit) in _CAPTIONS.items()
            if name in self._filtered
        }

    def costs(self, candidates: Candidates, count: int) -> np.ndarray:
        """Sums of weighted squares (B,); infinite where a candidate diverged."""
        constants = constants_of(self.actuator, candidates, self.step)
        costs, _ = self._simulated(constants, count, self._target, self.every, keep=False)
        return np.where(np.isfinite(costs), costs, np.inf)

    def residuals(self, candidates: Candidates, count: int) -> np.ndarray:
        """Weighted residuals (B, K), channel after channel."""
        constants = constants_of(self.actuator, candidates, self.step)
        return self.left_by(self._simulated(constants, count, self._target, self.every)[1])

    def answers_of(self, actuators: Sequence[PmsmActuator]) -> np.ndarray:
        """Low-passed answers (B, 6, kept) of B healthy actuators whose loops sample alike."""
        each = np.array([constants_of(one, {}, self.step) for one in actuators], dtype=float)
        return self._simulated(each.T, len(each), self._target, self.every)[1]

    def left_by(self, answers: np.ndarray) -> np.ndarray:
        """Weighted residuals (B, K) of answers (B, 6, kept), channel after channel."""
        left = answers[:, self._rows] - self._target[self._rows]
        left *= np.sqrt(self._weights[self._rows])[:, None]
        return np.asarray(left.reshape(len(answers), -1))

    def responses(self, candidates: Candidates, count: int) -> dict[str, np.ndarray]:
        """Response of the twin, low-passed, (B, S) arrays by name."""
        full = np.zeros((len(COMPARED), self._ticks.size))
        full[:, 0] = self._target[:, 0]
        constants = constants_of(self.actuator, candidates, self.step)
        answer = self._simulated(constants, count, full, 1)[1]
        found = {COMPARED[n]: answer[:, n].copy() for n in self._rows}
        if self._on_each_tick:
            return found
        return {
            name: np.stack([np.interp(self._time, self._ticks, row) for row in rows])
            for name, rows in found.items()
        }

    def _simulated(
        self, fields: Any, count: int, target: np.ndarray, every: int, *, keep: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Costs (B,), not finite where one diverged, and, if kept, answers (B, 6, K)."""
        from ematwin.models.pmsm.batch import monitor_scores
        from ematwin.numerics.lanes import LANES

        constants, costs = by_candidate(fields, count), np.empty(count)
        answer = np.empty((count, 7, target.shape[1]) if keep else (0, 0, 0))
        taps = self.low_pass.taps(1.0 / self.actuator.controller.current_time, 0.0)[:5]
        ticks = np.array(self.actuator.ticks)

        def work(part: slice) -> None:
            monitor_scores(
                constants[part], self.command, self.load, self.before, self.start, self.step,
                self.substeps, ticks, taps, target, self._weights, every, self._measured,
                costs[part], answer[part],
            )  # fmt: skip

        side_by_side(work, [slice(n, n + LANES) for n in range(0, count, LANES)], self.threads)
        lost = ~np.isfinite(constants).all(axis=1)
        costs[lost] = math.nan
        if keep:
            answer[lost] = math.nan
        return costs, answer[:, : len(COMPARED)]


def only_measured(recording: Recording) -> bool:
    """Whether voltages were measured at the terminals, and those commanded are not recorded."""
    commanded = (set(ROTATING_VOLTAGES), set(VOLTAGES))
    present = recording.channels.keys()
    return set(TERMINALS) <= present and not any(group <= present for group in commanded)


def signals_of(recording: Recording, actuator: PmsmActuator) -> dict[str, np.ndarray]:
    """Recorded traces of `COMPARED`, (S,) arrays by name."""
    pairs, ratio = actuator.motor.pole_pairs, actuator.transmission.ratio
    currents = in_rotor_frame(recording, "current", pairs)
    assert currents is not None, "`check_channels` lets no such recording pass"
    found = {"current_q": currents[1], "current_d": currents[0]}
    quantity = "terminal_voltage" if only_measured(recording) else "voltage"
    voltages = in_rotor_frame(recording, quantity, pairs)
    if voltages is not None:
        found |= {"voltage_q": voltages[1], "voltage_d": voltages[0]}
    channels = recording.channels
    if "motor_position" in channels:
        found["motor_speed"] = np.gradient(channels["motor_position"], recording.interval)
    elif "motor_speed" in channels:
        found["motor_speed"] = channels["motor_speed"]
    if "output_position" in channels:
        found["following_error"] = ratio * (channels["command"] - channels["output_position"])
    return found


def first_state(
    recording: Recording, actuator: PmsmActuator, signals: Mapping[str, np.ndarray]
) -> np.ndarray:
    """(6,) angle and speed of the motor as read, angle and speed of the output, i_d and i_q.

    Where an angle is not recorded, the motor stands where the output is, and the output where the
    command is. Motion starts from rest; the current that was there is taken from the first
    milliseconds.
    """
    ratio, channels = actuator.transmission.ratio, recording.channels
    count = max(1, round(0.005 * recording.sample_rate))
    output = channels.get("output_position")
    motor = channels.get("motor_position")
    theta_o = ratio * float(channels["command"][0] if output is None else output[0])
    theta_m = theta_o if motor is None else float(motor[0])
    if output is None and motor is not None:
        theta_o = theta_m
    speed = signals.get("motor_speed")
    w_m = 0.0 if speed is None else float(np.mean(speed[:count]))
    i_d, i_q = (float(np.mean(signals[name][:count])) for name in ("current_d", "current_q"))
    return np.array([theta_m, w_m, theta_o, w_m, i_d, i_q])
