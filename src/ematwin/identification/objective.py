"""The objective of identification: how badly a fault vector explains a record.

A record is prepared once: its equivalent current is formed and filtered, the weights of the
misfit follow from it, and command and load are put on the time base of the monitor model. A batch
of candidates is then simulated and scored without keeping traces.
"""

import copy
import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ematwin.errors import RecordError
from ematwin.plant.constants import kernel_constants
from ematwin.plant.parameters import Actuator
from ematwin.signals.envelope import current_envelope, signed_current
from ematwin.signals.filters import LowPass
from ematwin.signals.misfit import SlopeWeighting
from ematwin.signals.record import Record

_SHORTEST = 100  # samples: fewer cannot tell eight faults apart
_KEPT = 12_000  # samples of a response: more are thinned, as far as the low-pass allows
_OVERSAMPLING = 8.0  # rate of kept samples over the cutoff, at least


class Objective:
    """Misfit (paper, eq. 2) of a batch of fault vectors against a record.

    Parameters
    ----------
    record : Record
        Drives the monitor model with its command and load, from its first position and speed.
    actuator : Actuator
    low_pass : filter of both currents
    weighting : weights of the misfit
    rectify : compare magnitudes; None compares signed currents where the record has the rotor
        angle, else magnitudes
    threads : threads that share a batch; None takes one for each core

    Attributes
    ----------
    target : (S,) array, A, the filtered equivalent current of the record
    weights : (S,) array, s/A
    step, substeps : step of the monitor model (s), and how many make a sampling interval
    rectify : whether magnitudes are compared
    threads : threads that share a batch

    Raises
    ------
    RecordError
        If the record is too short or constant.
    InputError
        If it is sampled too slowly for the filter.
    """

    def __init__(
        self,
        record: Record,
        actuator: Actuator,
        *,
        low_pass: LowPass | None = None,
        weighting: SlopeWeighting | None = None,
        rectify: bool | None = None,
        threads: int | None = None,
    ) -> None:
        if len(record) < _SHORTEST:
            raise RecordError(
                f"The record has {len(record)} samples; at least {_SHORTEST} are needed to tell "
                "faults apart. Record longer or faster."
            )
        low_pass = low_pass or LowPass()
        self._weighting = weighting or SlopeWeighting()
        self.record = record
        self.actuator = actuator
        signed = None if rectify else signed_current(record, actuator.motor.pole_pairs)
        if rectify is False and signed is None:
            raise RecordError(
                "A signed comparison needs phase currents with motor_position, or a signed "
                "current; compare magnitudes instead."
            )
        self.rectify = signed is None
        current = current_envelope(record) if signed is None else signed
        if np.ptp(current) == 0.0:
            raise RecordError(
                f"The current of the record is constant ({current[0]:g} A): nothing moved. "
                "Check the channel, or record a motion."
            )
        self._current = current
        self._filter(low_pass)
        self.substeps = max(1, math.ceil(record.interval / actuator.steps.monitor - 1e-9))
        self.step = record.interval / self.substeps
        ratio = actuator.transmission.ratio
        self._command = record.command * ratio
        load = np.zeros(len(record)) if record.load is None else record.load
        self._load = load / ratio
        self._state = initial_state(record, actuator, None if self.rectify else float(current[0]))
        self._constants = kernel_constants(actuator)
        self._kept = _KEPT
        self.threads = threads or os.cpu_count() or 1
        self._pool: ThreadPoolExecutor | None = None

    def with_cutoff(self, cutoff: float) -> "Objective":
        """The same comparison through another low-pass (Hz); shares what does not change."""
        other = copy.copy(self)
        other._filter(LowPass(cutoff))
        return other

    def parts(self, starts: list[int], samples: int) -> "list[Objective]":
        """The same comparison over stretches of the record, each from its recorded state.

        Parameters
        ----------
        starts : first samples of the stretches, rising
        samples : length of each; it ends with the sample at which another may start

        Returns
        -------
        list of Objective, of one thread each
        """
        from scipy.signal import lfilter

        b, a, z = self._taps[:3], np.r_[1.0, self._taps[3:5]], self._taps[5:]
        record = _with_speeds(self.record)
        parts, filtered = [], 0
        for start in starts:
            # the filter goes on from the recorded current, so that a stretch has no transient
            _, z = lfilter(b, a, self._current[filtered : start + 1], zi=z)
            filtered = start + 1
            span = slice(start, start + samples + 1)
            part = copy.copy(self)
            part.record = record.changed(**{name: c[span] for name, c in record.columns()})
            part._current, part.target = self._current[span], self.target[span]
            part._command, part._load = self._command[span], self._load[span]
            part.weights = self.weights[span].copy()
            part.weights[0] = 0.0
            current = None if self.rectify else float(self._current[start])
            part._state = initial_state(part.record, self.actuator, current)
            part._taps = np.concatenate([self._taps[:5], z])
            part._kept = max(8, _KEPT // len(starts))
            part.threads, part._pool = 1, None
            parts.append(part)
        return parts

    def _filter(self, low_pass: LowPass) -> None:
        """Form target, weights and filter for a low-pass."""
        record = self.record
        self.low_pass = low_pass
        self.target = low_pass.apply(self._current, record.sample_rate)
        self.weights = self._weighting.weights(self.target, record.interval)
        self.weights[0] = 0.0  # the twin starts there; nothing has been simulated yet
        for start, stop in record.provenance.get("masked_s", []):
            # filled by the reader; the filter remembers it for a while afterwards
            masked = (record.time >= start) & (record.time <= stop + 1.0 / low_pass.cutoff)
            self.weights[masked] = 0.0
        self._taps = low_pass.taps(record.sample_rate, float(self._current[0]))

    def __call__(self, k: np.ndarray) -> np.ndarray:
        """Costs (B,) of fault vectors (B, 8), A s; infinite where the simulation diverged."""
        return self._run(k, 0)[0]

    def responses(self, k: np.ndarray) -> np.ndarray:
        """Filtered currents (B, S) of fault vectors (B, 8), A."""
        return self._run(k, self.target.size)[1]

    def residuals(self, k: np.ndarray) -> np.ndarray:
        """Weighted residuals (B, K): the sum of their squares is the cost.

        Of a long record only every so many samples are kept, weighted accordingly: the low-pass
        leaves nothing in between, and memory stays bounded.
        """
        rate = self.record.sample_rate
        most = max(1, int(rate / (_OVERSAMPLING * self.low_pass.cutoff)))
        size = self.target.size
        wished = min(most, -(-size // self._kept))
        kept = -(-size // wished)
        stride = -(-size // kept)
        response = self._run(k, kept)[1][:, : -(-size // stride)]
        thin = slice(None, None, stride)
        response -= self.target[thin]
        response *= np.sqrt(stride * self.weights[thin])
        return response

    def relative_misfit(self, cost: float) -> float:
        """Root of the cost over that of a twin without any current: 0 is a perfect fit."""
        return math.sqrt(cost / float(np.sum(self.weights * self.target**2)))

    def _run(self, k: np.ndarray, kept: int) -> tuple[np.ndarray, np.ndarray]:
        from ematwin.kernels.batch import LANES, monitor_scores

        count = len(k)
        blocks = -(-count // LANES)
        lanes = np.empty((blocks * LANES, 8))
        lanes[:count] = k
        lanes[count:] = k[-1]
        costs = np.empty(len(lanes))
        status = np.empty(len(lanes), dtype=np.int64)
        response = np.empty((len(lanes), kept) if kept else (0, 0))

        def work(first: int, last: int) -> None:
            part = slice(first * LANES, last * LANES)
            monitor_scores(
                lanes[part], self._command, self._load, self._state, self._constants, self.step,
                self.substeps, self._taps, self.rectify, self.target, self.weights,
                costs[part], status[part], response[part],
            )  # fmt: skip

        shares = np.array_split(np.arange(blocks), min(self.threads, blocks))
        spans = [(int(share[0]), int(share[-1]) + 1) for share in shares]
        if len(spans) == 1:
            work(*spans[0])
        else:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(self.threads, thread_name_prefix="ematwin")
            list(self._pool.map(lambda span: work(*span), spans))
        return costs[:count], response[:count]

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_pool": None}  # threads stay where they are


def _with_speeds(record: Record) -> Record:
    """The record with speeds from its positions where it has none.

    Slopes over a millisecond: those from one sample to the next are mostly an encoder's steps.
    """
    half = max(1, round(0.5e-3 * record.sample_rate))
    n = np.arange(len(record))
    before, after = np.maximum(n - half, 0), np.minimum(n + half, len(record) - 1)
    speeds = {}
    for side in ("motor", "output"):
        position = getattr(record, f"{side}_position")
        if position is not None and getattr(record, f"{side}_speed") is None:
            span = record.time[after] - record.time[before]
            speeds[f"{side}_speed"] = (position[after] - position[before]) / span
    return record.changed(**speeds) if speeds else record


def initial_state(record: Record, actuator: Actuator, current: float | None) -> np.ndarray:
    """State (5,) of the monitor model at the first sample.

    Recorded positions and speeds are taken where they are known. Else the motor stands where the
    output is, the output where the command is, and speeds are the slopes of the positions.
    """
    ratio = actuator.transmission.ratio
    dt = record.interval
    if record.output_position is not None:
        theta_o = float(record.output_position[0]) * ratio
        w_o = float(record.output_position[1] - record.output_position[0]) * ratio / dt
    elif record.motor_position is not None:
        theta_o = float(record.motor_position[0])
        w_o = float(record.motor_position[1] - record.motor_position[0]) / dt
    else:
        theta_o = float(record.command[0]) * ratio
        w_o = 0.0
    if record.output_speed is not None:
        w_o = float(record.output_speed[0]) * ratio
    theta_m, w_m = theta_o, w_o
    if record.motor_position is not None:
        theta_m = float(record.motor_position[0])
        w_m = float(record.motor_position[1] - record.motor_position[0]) / dt
    if record.motor_speed is not None:
        w_m = float(record.motor_speed[0])
    return np.array([current or 0.0, w_m, theta_m, w_o, theta_o])
