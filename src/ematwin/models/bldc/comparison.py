"""How badly candidates explain a recording of a brushless actuator (docs/models.md, "The misfit").

A recording is prepared once. A batch of candidates is then simulated and scored without traces.
`restarted` compares stretch by stretch, each simulated anew from its recorded state: multiple
shooting (Bock and Plitt 1984, Proc. 9th IFAC World Congress, 242-247) with states that were
measured, so that only the faults are left to find. An error of the twin lasts to the end of its
stretch: near the torque at which a motor stalls, the misfit over the whole recording jumps from
vector to vector. A vector that explains the whole recording is still the better answer.
"""

import copy
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Self

import numpy as np

from ematwin.models.bldc import faults as table
from ematwin.models.bldc.channels import PHASES, equivalent_current
from ematwin.models.bldc.constants import constants_by_candidate, kernel_constants
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.phase_sensors import balanced
from ematwin.models.bldc.stretches import (
    Batch,
    Power,
    PowerStretches,
    Stretches,
    initial_state,
    joined,
    recorded_power,
    tasks,
)
from ematwin.models.bldc.zeros import counted, turned
from ematwin.models.comparison import Candidates, Comparison, Placed, one_candidate
from ematwin.models.plausibility import check_enough, check_moves
from ematwin.numerics.filters import advanced
from ematwin.numerics.side_by_side import by_candidate, cores, side_by_side
from ematwin.numerics.signals import LowPass, SlopeWeighting, filtered, means, white_noise
from ematwin.recordings.recording import Recording

SMOOTH_CUTOFF = 100.0  # Hz: misfits of currents low-passed there have wide basins
KEPT = 5_000  # samples of a response: more are thinned, as far as the low-pass allows
_OVERSAMPLING = 8.0  # rate of kept samples over the cutoff, at least
_STRETCH = 0.005  # s; at 10 to 20 ms some twins still stalled within a stretch


class BldcComparison(Comparison):
    """Misfit (paper, eq. 2) of a batch of candidates against a recording.

    Currents are signed where the recording has the rotor angle, unless to ``rectify``, else sizes.
    It has ``current`` and ``target`` (S,), A, the equivalent current as it is and filtered, and
    ``weights`` (S,), s/A. `RecordError` for a recording that is too short or constant, `InputError`
    for one that is sampled too slowly for the filter.
    """

    kept = KEPT  # samples of a response, at most
    _stands_for = 1  # samples as recorded, each sample
    model_error, has_reference = table.MODEL_ERROR, True
    power: Power | None = None  # where it counts as evidence
    _filtered_power: PowerStretches | None = None
    _missed: Mapping[str, np.ndarray] | None = None
    _passed: LowPass | None = None  # by what was missed

    def __init__(
        self, recording: Recording, actuator: BldcActuator, *, low_pass: LowPass | None = None,
        rectify: bool = False, threads: int | None = None,
    ) -> None:  # fmt: skip
        check_enough(recording)
        recording = counted(balanced(recording), actuator)
        self.recording, self.actuator = recording, actuator
        self.current, self.rectify = equivalent_current(
            recording, actuator.motor.pole_pairs, rectify
        )
        self.unplaced = recording.motor_position is None and PHASES[0] in recording.channels
        check_moves(self.current)
        self._white_noise = white_noise(self.current)
        self._stepped(actuator.steps.monitor)
        ratio = actuator.transmission.ratio
        self.command = recording.command * ratio
        self.load = recording.channels.get("load", np.zeros(len(recording))) / ratio
        current = None if self.rectify else float(self.current[0])
        self.state = initial_state(recording, actuator, current)
        self.constants = kernel_constants(actuator)
        unseen = {
            place
            for place, *_ in actuator.parameters()
            if place.partition(".")[0] in table.REFERENCE_ALONE
        }
        unseen |= {table.HELD} if actuator.integrates else set()
        shows_rotor = self.unplaced or recording.motor_position is not None
        if unseen and (self.unplaced or (shows_rotor and recording.output_position is None)):
            unseen |= {table.ZERO}
        self.unseen = frozenset(unseen)
        self.ignores = frozenset(table.POWER) | ({table.HELD, table.ZERO} - self.unseen)
        self.threads = threads or cores()
        self._filter(low_pass or LowPass())

    def with_missed(self, missed: Mapping[str, np.ndarray]) -> "BldcComparison":
        """With the errors of the twin in filtered current (A) and power (W) subtracted."""
        other = copy.copy(self)
        other._missed, other._passed = dict(missed), self.low_pass
        other._filter(self.low_pass)
        return other

    def exact(self, values: Mapping[str, float]) -> dict[str, np.ndarray] | None:
        """Filtered current (A) and, if it counts, power (W) of the reference, (S,) arrays."""
        if not self.has_reference:
            return None
        shown = self._shown(*self._answered(values), self.batch(one_candidate(values), 1))
        return {name: rows[0] for name, rows in shown.items()}

    def exact_residuals(self, values: Mapping[str, float]) -> np.ndarray | None:
        """Weighted residuals (K,) of the reference, without the monitor model and its error."""
        if not self.has_reference:
            return None
        if self._missed is None or self._missed:
            return self.with_missed({}).exact_residuals(values)
        current, watts = self._answered(values)
        some = slice(None, None, self.stretches.stride)
        parts = self._compared(
            self.stretches, self.batch(one_candidate(values), 1), current[:, some].copy(),
            None if watts is None else watts[:, some].copy(),
        )  # fmt: skip
        return np.concatenate(parts, axis=1)[0]

    def _answered(self, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray | None]:
        """Filtered current and, if it counts, power (1, S) of the reference, without sensors."""
        from ematwin.models.bldc.simulate import reference_answer

        answer = reference_answer(self.recording, self.actuator, values, self.state[:5])
        current, _ = equivalent_current(answer, self.actuator.motor.pole_pairs, self.rectify)
        current[0] = self.current[0]  # as the twin's: nothing has been simulated yet
        response, watts = filtered(self.taps, current)[0][None], None
        if (known := self._filtered_power) is not None:
            power = known.recorded.of(answer)
            power[0] = known.target[0]
            watts = filtered(np.r_[self.taps[:5], known.states[0]], power)[0][None]
        return response, watts

    def _shown(
        self, response: np.ndarray, watts: np.ndarray | None, batch: Batch
    ) -> dict[str, np.ndarray]:
        """Filtered currents and powers (B, S), changed in place, as sensors show them."""
        late, found = batch.late(self.recording.interval), {}
        if watts is not None and self.power is not None:
            found["power"] = batch.sensed_power(self.power, watts, response)
        found["current"] = batch.sensed(response)
        return found if late is None else {n: advanced(rows, late) for n, rows in found.items()}

    def with_evidence(self) -> "BldcComparison":
        """With the electrical power, where voltages or the current of the supply tell it."""
        power = recorded_power(self.recording, self.actuator)
        if power is None:
            return self
        other = copy.copy(self)
        other.power = power
        unseen = {"voltage_drop"} if power.by_phases else set()
        other.ignores = self.ignores - set(table.POWER) | unseen
        other._cut()
        return other

    def coarse(self) -> "BldcComparison":
        """With longer steps and fewer samples, within the limits of stability and low-pass."""
        return self._coarse(self.low_pass, KEPT)

    def smoothed(self) -> "BldcComparison":
        """The coarse one through a low-pass of `SMOOTH_CUTOFF` at most."""
        return self._coarse(LowPass(min(SMOOTH_CUTOFF, self.low_pass.cutoff)), KEPT // 5)

    def _filtered_missed(self, name: str) -> np.ndarray | float:
        """Error of the twin in a channel (S,), which passed a low-pass as wide or wider."""
        trace = (self._missed or {}).get(name)
        if trace is None or self._passed == self.low_pass:
            return 0.0 if trace is None else trace
        return self.low_pass.apply(trace, self.recording.sample_rate)

    def _coarse(self, low_pass: LowPass, kept: int) -> "BldcComparison":
        """With one sample, of currents and power the mean, for so many as a long step takes."""
        stable = self.actuator.largest_stable_step("monitor")
        longest = min(2.0 * self.actuator.steps.monitor, stable)
        recording, rate = self.recording, self.recording.sample_rate
        stride = max(1, int(min(longest * rate + 1e-9, rate / (_OVERSAMPLING * low_pass.cutoff))))
        other, some = copy.copy(self), slice(None, None, stride)
        other.recording = recording.changed(**{name: x[some] for name, x in recording.columns()})
        # copies: machine code for arrays with gaps would be compiled apart
        other.command, other.load = self.command[some].copy(), self.load[some].copy()
        other.current = means(self.current, stride)
        if self._missed is not None:
            other._missed = {name: trace[some] for name, trace in self._missed.items()}
        other._white_noise = self._white_noise / math.sqrt(stride)
        if self.power is not None:
            other.power = replace(self.power, watts=means(self.power.watts, stride))
        other.kept, other._stands_for = min(kept, self.kept), stride * self._stands_for
        other._filter(low_pass)
        return other._stepped(longest)

    def refined(self) -> "BldcComparison":
        """With shorter steps: impacts in a gap that is hardly wider than one are late otherwise."""
        return copy.copy(self)._stepped(0.25 * self.step)

    def _stepped(self, longest: float) -> Self:
        """This, with steps of the monitor model of at most ``longest`` seconds."""
        self.substeps = max(1, math.ceil(self.recording.interval / longest - 1e-9))
        self.step = self.recording.interval / self.substeps
        return self

    def placed(self, values: Mapping[str, float]) -> Placed | None:
        """Counted from where phase currents show the rotor, where its angle was not recorded."""
        if not self.unplaced:
            return None
        from ematwin.models.bldc.simulate import reference_answer

        # a fast model that lacks loops lags behind
        answer = reference_answer(self.recording, self.actuator, values, self.state[:5])
        current, _ = equivalent_current(answer, self.actuator.motor.pole_pairs)
        assert answer.motor_position is not None
        behind = turned(self.recording, self.actuator, current, answer.motor_position)
        return None if behind is None else behind.placed(self.recording, self.actuator)

    def restarted(self) -> "BldcComparison | None":
        """By stretches, each from its recorded positions; None without positions."""
        if not {"motor_position", "output_position"} <= self.recording.channels.keys():
            return None
        other = copy.copy(self)
        other.length, other.has_reference, other.unplaced = _STRETCH, False, False
        other.unseen = frozenset()
        other._cut()
        return other

    @property
    def whole(self) -> Stretches:
        """The whole recording, as one stretch."""
        return Stretches(
            self.command, self.load, self.target, self.weights, np.zeros(1, dtype=np.int64),
            self.target.size, self.state[None], self.taps[None], self.kept,
            int(self.recording.sample_rate / (_OVERSAMPLING * self.low_pass.cutoff)),
            self._filtered_power,
        )  # fmt: skip

    def _cut(self) -> None:
        """Form the stretches that are compared, and the power where it counts."""
        self._filtered_power = None if self.power is None else self._compared_power(self.power)
        self.stretches = self.whole
        if self.length is not None:
            self.stretches = self.whole.cut(
                self.recording, self.actuator, self.length, self.current, self.rectify
            )
            weights = self.stretches.weighted(self.weights, 1)
            self.scale = float(np.sum(weights * self.target[self.stretches.places(1)] ** 2))
        if self.power is not None:
            self.evidence = len(self.stretches) * self.stretches.shown

    def _compared_power(self, power: Power) -> PowerStretches:
        """The power to compare: its squares add up to `independent`."""
        rate = self.recording.sample_rate
        target = self.low_pass.apply(power.watts, rate)
        error = power.error(target, self.low_pass, rate)
        counting = self.weights > 0.0
        weights = counting * self.independent / (counting.sum() * error**2)
        states = self.low_pass.taps(rate, float(target[0]))[None, 5:]
        return PowerStretches(power, target - self._filtered_missed("power"), weights, states)

    def _filter(self, low_pass: LowPass) -> None:
        """Form target, weights and filter for a low-pass."""
        recording, self.low_pass = self.recording, low_pass
        self.target = low_pass.apply(self.current, recording.sample_rate)
        self.weights = self._stands_for * SlopeWeighting().weights(self.target, recording.interval)
        self.weights[0] = 0.0  # the twin starts there; nothing has been simulated yet
        if self._missed is not None:  # what a sensor that is off showed first is forgotten then
            self.weights[recording.time <= recording.time[0] + 1.0 / low_pass.cutoff] = 0.0
        for start, stop in recording.provenance.get("masked_s", []):  # filled by the reader
            masked = (recording.time >= start) & (recording.time <= stop + 1.0 / low_pass.cutoff)
            self.weights[masked] = 0.0
        self.taps = low_pass.taps(recording.sample_rate, float(self.current[0]))
        self.scale = float(np.sum(self.weights * self.target**2))
        # behind the low-pass a recording holds so many independent samples
        self.independent = max(1.0, 2.0 * low_pass.cutoff * float(np.ptp(recording.time)))
        # relative misfit to healthy records of the reference model, and misfit of that to
        # simulators of other make (0.0 to 0.18 %)
        self.expected_misfit = 0.003 if self._missed is None else 0.002
        self.noise = self.expected_misfit * math.sqrt(self.scale / self.independent)
        self.target = self.target - self._filtered_missed("current")
        passed = self._white_noise**2 * low_pass.noise_gain(recording.sample_rate)
        self.recorded_noise = math.sqrt(passed * float(np.sum(self.weights)) / self.scale)
        self._cut()

    def costs(self, candidates: Candidates, count: int) -> np.ndarray:
        """Costs (B,), A s; infinite where the simulation diverged."""
        return self.costs_within(candidates, count, np.full(count, np.inf))

    def costs_within(self, candidates: Candidates, count: int, limits: np.ndarray) -> np.ndarray:
        """Costs (B,), A s; infinite above a limit, where the simulation is stopped early."""
        batch = self.batch(candidates, count)
        if not batch.sensor:
            return self.run(self.stretches, batch, 0, limits=limits)[0]
        from ematwin.numerics.lanes import LANES

        # what a sensor shows is known of whole answers only: as many at a time as memory allows,
        # and of long ones as many samples as a residual keeps
        every, many, most = replace(self.stretches, power=None), count, 4_000_000  # samples
        samples = len(every) * every.samples
        if samples * LANES <= most:
            every, many = replace(every, kept=every.samples), most // samples
        parts = (batch.part(slice(n, n + many)) for n in range(0, count, many))
        left = (self.residuals_of(every, part)[0] for part in parts)
        costs = np.concatenate([np.einsum("bs,bs->b", one, one) for one in left])
        return np.where(np.isfinite(costs), costs, np.inf)

    def responses(self, candidates: Candidates, count: int) -> dict[str, np.ndarray]:
        """Filtered equivalent currents and, if it counts, powers, (B, S) arrays, A and W."""
        batch = self.batch(candidates, count)
        _, response, watts = self.run(self.whole, batch, self.target.size)
        return self._shown(response, None if self.power is None else watts, batch)

    def measured(self) -> dict[str, np.ndarray]:
        """The filtered equivalent current of the recording, (S,) array, A."""
        return {"current": self.target}

    def captions(self) -> dict[str, tuple[str, str]]:
        """The equivalent current and its filter."""
        how = f"{'magnitude' if self.rectify else 'signed'}, {self.low_pass.cutoff:g} Hz low-pass"
        return {"current": (f"Equivalent current ({how})", "A")}

    def residuals(self, candidates: Candidates, count: int) -> np.ndarray:
        """Weighted residuals (B, K), the evidence last."""
        parts = self.residuals_of(self.stretches, self.batch(candidates, count))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def residuals_of(self, stretches: Stretches, batch: Batch) -> list[np.ndarray]:
        """Weighted residuals (B, K) over stretches: of the current and, as evidence, the power."""
        chosen, back = batch.distinct()
        costs, response, watts = self.run(stretches, batch.part(chosen), stretches.shown)
        if len(chosen) < len(back):
            costs, response, watts = costs[back], response[back], watts[back]
        response[~np.isfinite(costs)] = np.nan  # a friction that is no number holds all at rest
        return self._compared(stretches, batch, response, watts)

    def _compared(
        self, stretches: Stretches, batch: Batch, response: np.ndarray, watts: np.ndarray | None
    ) -> list[np.ndarray]:
        """Currents (B, K), and power where it counts, changed in place to weighted residuals."""
        late, found, power = batch.late(self.recording.interval), [], stretches.power
        if watts is not None and power is not None:
            watts = batch.sensed_power(power.recorded, watts, response)
            stretches.compare(watts, power.target, power.weights, late)
            found.append(watts)
        response = batch.sensed(response)
        stretches.compare(response, stretches.target, stretches.weights, late)
        return [response, *found]

    def batch(self, candidates: Candidates, count: int) -> Batch:
        """Candidates as the kernel takes them."""
        given = [candidates.get(one.name, one.healthy) for one in table.UNKNOWNS]
        faults = by_candidate(given, count)
        sensor = {name: candidates[name] for name in table.SENSOR if name in candidates}
        return Batch(faults, constants_by_candidate(self.actuator, candidates, count), sensor)

    def run(
        self, stretches: Stretches, batch: Batch, kept: int, limits: np.ndarray | float = np.inf
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Costs (B,) summed over N stretches, responses and, if it counts, power, W, (B, N kept).

        ``kept`` samples of each stretch are kept. Costs above ``limits`` (B,) are infinite.
        """
        from ematwin.models.bldc.batch import monitor_scores
        from ematwin.numerics.lanes import LANES

        count, parts = len(batch.faults), len(stretches)
        blocks = -(-count // LANES)
        missing = (0, blocks * LANES - count), (0, 0)
        faults = np.pad(batch.faults, missing, "edge")
        each = None if batch.constants is None else np.pad(batch.constants, missing, "edge")
        within = np.pad(np.full(count, limits), missing[0], "edge")
        costs = np.empty((parts, len(faults)))
        response = np.empty((*costs.shape, kept))
        power = stretches.power if kept else None
        watts = np.empty((*costs.shape, 0 if power is None else kept))
        loops = None
        # currents of shorted turns are zero at the start: within 0.1 ms they forget it
        if self.actuator.shorted_turns is not None:
            loops = np.zeros((parts, 4))
            theta_e = self.constants.pole_pairs * stretches.states[:, 2]
            loops[:, 3] = np.floor(theta_e / (math.pi / 3.0) - 0.5) % 6.0

        def work_on(task: tuple[slice, slice]) -> None:
            some, rows = task
            monitor_scores(
                faults[rows], stretches.command, stretches.load, stretches.starts[some],
                stretches.samples, stretches.states[some], self.constants,
                None if each is None else each[rows], self.step, self.substeps,
                stretches.taps[some], self.rectify, stretches.target, stretches.weights,
                costs[some, rows], response[some, rows],
                None if power is None else (power.states[some], watts[some, rows]),
                within[rows], None if loops is None else loops[some],
            )  # fmt: skip

        side_by_side(work_on, tasks(parts, blocks, LANES, self.threads), self.threads)
        return costs.sum(axis=0)[:count], joined(response, count), joined(watts, count)
