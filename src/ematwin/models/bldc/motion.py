"""How motor and output of a recording move, with what was not recorded of it.

docs/models.md, "Forms that no file states". Recorded positions are splines; an output that was not
recorded follows the motor, and a motor that was not moves as the recorded currents drive it.
"""

import copy
import math
from typing import Any

import numpy as np

from ematwin.models.bldc.along_currents import MOVES, OF_GEAR, OF_MOTOR, Masses, Noise
from ematwin.models.bldc.channels import phase_currents, signed_current, trapezoid_shape
from ematwin.models.bldc.commutations import commutations, divided
from ematwin.models.bldc.constants import fault_state, kernel_constants, truer_constants
from ematwin.models.bldc.counts import (
    CUTOFF,
    SmoothingSpline,
    recorded_anew,
    step_by_noise,
    steps_of,
)
from ematwin.models.bldc.faults import ZERO, fault_vector
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.phase_sensors import balanced
from ematwin.models.bldc.reference_step import ReferenceState, move_masses
from ematwin.models.bldc.simulate import INPUT_INTERVAL, TimeGrid, reference_answer
from ematwin.models.bldc.stretches import initial_state
from ematwin.models.bldc.zeros import counted
from ematwin.models.optional import Values, with_values
from ematwin.numerics.compile import loop, step
from ematwin.numerics.scalar import THIRD_TURN
from ematwin.recordings.recording import Recording

_SHOWN = 0.15  # of the commutations that the commanded travel takes, at least
_FOLLOWS = ("friction", "backlash", "load_gain", "load_offset", ZERO)


@step
def between(values, g, s):  # type: ignore[no-untyped-def]
    """The value at a share ``s`` of the way from a point of an array to the next."""
    return values[g] + s * (values[g + 1] - values[g])


@loop
def output_along(k, motion, load, spacing, substeps, c, truer):  # type: ignore[no-untyped-def]
    """Angles and speeds (2, G) of an output that a motor pushes which moves as it was recorded.

    Parameters
    ----------
    k : (8,) array, fault vector
    motion : (2, G) array, angle and speed of the motor; the output begins beside it, at its speed
    load : (G,) array, N m on the motor shaft
    spacing, substeps : s, of these points, and steps between them
    c, truer : as of `batch.reference_trace`
    """
    fault = fault_state(k, c.half_gap)
    found = np.empty((2, load.size))
    theta_o, w_o, bent_o, dt = motion[0, 0], motion[1, 0], 0.0, spacing / substeps
    for g in range(load.size):
        found[0, g], found[1, g] = theta_o, w_o
        for n in range(substeps if g < load.size - 1 else 0):
            s = (n + 0.5) / substeps
            now = ReferenceState(
                0.0, 0.0, 0.0, between(motion[1], g, s), between(motion[0], g, s), w_o, theta_o,
                1.0, 0.0, 0.0, 0.0, 0.0, bent_o,
            )  # fmt: skip
            pushes = between(load, g, s)
            _, _, w_o, theta_o, _, bent_o = move_masses(now, 0.0, pushes, fault, c, truer, dt)
    return found


def has_motion(recording: Recording, actuator: BldcActuator) -> bool:
    """Whether currents are there that the motor's position, or commutations, put to phases."""
    currents = _currents(recording, actuator)
    if currents is None or recording.motor_position is not None:
        return currents is not None
    seen = commutations(currents, recording.sample_rate, actuator)
    if currents.ndim > 1:
        return seen.when.size > 0
    # a comparator's current hardly dips, and ripple resembles a few
    travel = float(np.abs(np.diff(recording.command)).sum()) * actuator.transmission.ratio
    return seen.when.size * seen.turn > _SHOWN * travel


def _currents(recording: Recording, actuator: BldcActuator) -> np.ndarray | None:
    """Phase currents (S, 3), A, or one that is signed (S,); None without either."""
    currents = phase_currents(recording)
    if currents is None:
        currents = signed_current(recording, actuator.motor.pole_pairs)
    return currents


class Motion:
    """The motion of a recording, all on the motor shaft.

    ``motor`` and ``output`` are splines of the angles, ``recorded`` the angles as they came. An
    output that was not recorded has those of the motor, which it ``follows`` (`followed`). A motor
    that was not recorded moves as recorded currents drive both ``masses``, at ``values``.
    """

    def __init__(
        self, recording: Recording, actuator: BldcActuator, values: Values | None = None
    ) -> None:
        recording = counted(balanced(recording), actuator)
        self.rate, ratio = recording.sample_rate, actuator.transmission.ratio
        inertia = actuator.motor.inertia
        self.share = inertia / (inertia + actuator.transmission.output_inertia)  # of the motor
        self.first_sample = recording.first_sample  # s, of sampled loops
        self.time = np.arange(len(recording)) / self.rate
        self.command = recording.channels["command"] * ratio
        self.load = recording.channels.get("load", np.zeros(len(recording))) / ratio
        currents = _currents(recording, actuator)
        assert currents is not None
        motor, output = recording.motor_position, recording.output_position
        self._current = None if currents.ndim > 1 else currents
        self.currents = currents
        self.sheet: Any = actuator
        self.values = values or {}
        self._output = None if output is None else output * ratio
        self.masses: Masses | None = None
        self.follows = output is None and motor is not None
        # steps of encoders, rad, 0 without; and of counts as noisy as the positions
        self.counts = steps_of(recording, actuator)
        if motor is None:
            near = None if self._current is None else self._near(recording)
            self.masses = self.driven(near).at(actuator, self.values)
        if self.follows:
            self.counts = self.counts[0], self.counts[0]
        positions = self._completed(motor)
        self.steps = tuple(
            0.0 if recorded is None else counts or step_by_noise(position)
            for counts, recorded, position in zip(
                self.counts, (motor, motor if self.follows else output), positions, strict=True
            )
        )
        self._move(*positions, CUTOFF)

    def driven(self, near: np.ndarray | None = None) -> Masses:
        """Both masses as the currents drive them, whether or not the motor's angle was recorded."""
        step = 0.0 if self._output is None else self.counts[1] or step_by_noise(self._output)
        return Masses(
            self.currents, self.load, self.rate, float(self.command[0]), self.sheet, near,
            self._output, step / math.sqrt(12.0),
        )  # fmt: skip

    def _near(self, recording: Recording) -> np.ndarray:
        """Angle (S,) near which the motor is: the output's, or else that of the closed loop."""
        if self._output is not None:
            return np.asarray(self.command[0] + self._output - self._output[0])
        start = initial_state(recording, self.sheet, None)[:5]
        answer = reference_answer(recording, self.sheet, self.values, start)
        assert answer.motor_position is not None
        return answer.motor_position

    @property
    def moves(self) -> tuple[str, ...]:
        """Faults, load and sensors by name on which what was not recorded of it depends."""
        return tuple(MOVES) if self.masses is not None else _FOLLOWS if self.follows else ()

    @property
    def sections(self) -> tuple[str, ...]:
        """Sections of an actuator on which that depends."""
        return OF_GEAR if self.masses is None else (*OF_GEAR, *OF_MOTOR)

    def _completed(self, motor: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Angles (S,) of motor and output; those of ``masses`` where they were not recorded."""
        output = self._output
        if motor is not None:
            return motor, motor if output is None else output
        assert self.masses is not None
        moved = self.masses.moved(self.sheet, self.values)
        return moved.motor, moved.output if output is None else output

    def at(self, values: Values, noise: Noise | None, ahead: bool) -> "Motion":
        """The same where the currents drive both masses at other values, parameters among them.

        ``noise`` and ``ahead`` are as of `Masses.at`.
        """
        if self.masses is None:
            return self
        other = copy.copy(self)
        other.sheet, other.values = with_values(self.sheet, values), values
        other.masses = self.masses.at(other.sheet, values, noise, ahead)
        other._move(*other._completed(None), self.cutoff)
        return other

    def _move(self, motor: np.ndarray, output: np.ndarray, cutoff: float) -> None:
        """Lay splines through positions (S,), rad on the motor shaft; noisy ones are smoothed."""
        self.cutoff, self.recorded = cutoff, (motor, output)
        self.motor, self.output = (
            SmoothingSpline(self.time, position, cutoff if step else math.inf)
            for position, step in zip((motor, output), self.steps, strict=True)
        )
        if self._current is not None:
            self.currents = divided(self._current, motor, self.rate, self.sheet)
        # a mean belongs to the middle of its interval
        electrical = self.sheet.motor.pole_pairs * self.motor(self.time - 0.5 / self.rate)
        self.trapezoids = trapezoid_shape(electrical[:, None] - THIRD_TURN * np.arange(3))

    def followed(self, time: np.ndarray, actuator: Any, values: Values | None = None) -> np.ndarray:
        """Angles and speeds (2, T) of an output that follows the motor, at uniform times, s."""
        # faster wiggles of counts would shake the output off the face that pushes it
        motor, given = self.smoother(500.0).motor, values or {}  # Hz
        actuator = with_values(actuator, given)
        spacing, ratio = float(time[1] - time[0]), actuator.transmission.ratio
        inner = math.ceil(spacing / INPUT_INTERVAL - 1e-9)
        fine = time[0] + spacing / inner * np.arange(inner * (time.size - 1) + 1)
        load = given.get("load_gain", 1.0) * np.interp(fine, self.time, self.load)
        found = output_along(
            fault_vector(given), np.array([motor(fine), motor(fine, 1)]),
            load + given.get("load_offset", 0.0) / ratio, spacing / inner,
            math.ceil(spacing / inner / actuator.steps.reference - 1e-9),
            kernel_constants(actuator), truer_constants(actuator),
        )  # fmt: skip
        return np.asarray(found[:, ::inner])

    def grid(self, samples: int) -> TimeGrid:
        """Times of so many samples, and between them where the motor's angle was recorded."""
        step = INPUT_INTERVAL if self.masses is None else 1.0 / self.rate
        return TimeGrid(step, (samples - 0.5) / self.rate, self.rate)

    def states(self, grid: TimeGrid, actuator: Any, values: Values) -> np.ndarray:
        """Angle and speed of the motor and angle of the output (3, T) at times of a `grid`.

        What was not recorded moves as at these values. The output is counted as the command is.
        """
        zero = values.get(ZERO, 0.0)
        if self.masses is not None:
            moved = self.masses.moved(actuator, values)
            seen = moved.output + zero if self._output is None else self.output.values
            return np.array([moved.motor, moved.speed, seen])[:, : grid.samples]
        every = grid.samples, grid.decimation
        motor, output = self.motor, self.output
        if self.follows:
            followed = self.followed(grid.time, actuator, values)[0] + zero
            return np.array([motor.finely(*every), motor.finely(*every, 1), followed])
        return np.array([motor.finely(*every), motor.finely(*every, 1), output.finely(*every)])

    def twist(self) -> np.ndarray:
        """Angle (S,) by which the motor is ahead of the output."""
        return self.motor.values - self.output.values

    def recorded_anew(self, seed: int = 0) -> "Motion | None":
        """The motion with other noise of what was recorded; None if that is clean."""
        # it differs from this one as this one does from the truth
        if self.masses is None and not any(self.steps):
            return None
        other, splines = copy.copy(self), (self.motor, self.output)
        motor, output = (
            recorded_anew(spline.values, position, size, counts > 0.0)
            for spline, position, size, counts in zip(
                splines, self.recorded, self.steps, self.counts, strict=True
            )
        )
        if self.masses is not None:
            other.masses = self.masses.seen_anew(seed)
            other._output = None if self._output is None else output
            motor, output = other._completed(None)
        other._move(motor, output, self.cutoff)
        return other

    def smoother(self, cutoff: float) -> "Motion":
        """The motion with noise smoothed further, Hz; itself if it has none."""
        if not any(self.steps):
            return self
        other = copy.copy(self)
        other._move(*self.recorded, cutoff)
        return other

    def alike(self, trace: np.ndarray) -> np.ndarray:
        """A trace (S,) smoothed as the positions are."""
        return SmoothingSpline(self.time, trace, self.cutoff).values if any(self.steps) else trace
