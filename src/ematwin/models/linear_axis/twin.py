"""The twin of a linear axis: force by voltage, mass, friction that differs by direction.

docs/linear-axis.md has the equations and their sources; all at the carriage, SI.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.linear_axis.parameters import LinearAxis
from ematwin.models.sections import GRID
from ematwin.numerics.compile import step
from ematwin.numerics.lanes import Traces
from ematwin.numerics.scalar import clip
from ematwin.recordings.recording import Recording


class AxisConstants(NamedTuple):
    """Constants of an axis, SI."""

    mobility: float  # 1/kg
    dry_forward: float  # N
    dry_backward: float  # N
    standstill: float  # friction at standstill over Coulomb friction, less 1
    per_fading: float  # s/m
    viscous_forward: float  # N s/m
    viscous_backward: float  # N s/m
    gain: float  # N/V
    offset: float  # N
    decay: float  # exp(-dt/T_d)
    lagging: float  # mean of exp(-t/T_d) over a step
    limit: float  # V
    k_position: float  # 1/s
    k_velocity: float  # V s/m
    closed: float  # 1: the controller drives; 0: the command is the voltage


class AxisState(NamedTuple):
    """State of carriage and controller."""

    x: float  # m
    v: float  # m/s
    u: float  # V, what the force follows
    x_1: float  # m, one sample before
    x_2: float  # m, two samples before
    output: float  # V, held by the controller


class AxisAnswer(NamedTuple):
    """Compared channels at a sample."""

    voltage: float  # V
    position: float  # m


@step
def friction_force(v, forward, c):
    """Friction force at a speed whose direction is known, N, positive against positive motion."""
    ratio = v * c.per_fading
    rising = 1.0 + c.standstill / (1.0 + ratio * ratio)
    dry = c.dry_forward if forward else -c.dry_backward
    viscous = c.viscous_forward if forward else c.viscous_backward
    return dry * rising + viscous * v


@step
def from_rest(push, time, c):
    """Speed after some time from rest under a constant force: none if friction holds it."""
    forward = push > 0.0
    left = push - friction_force(0.0, forward, c)
    loose = left > 0.0 if forward else left < 0.0
    return time * c.mobility * left if loose else 0.0 * left  # NaN stays NaN


@step
def axis_step(now, command, pulse, c, dt):
    """Advance by ``dt`` under the voltage that the controller holds.

    Midpoint rule; where the carriage turns, it goes on from rest for the rest of the step.
    """
    gap = now.u - now.output
    push = c.gain * (now.output + gap * c.lagging) - c.offset
    v = now.v
    rest = v == 0.0
    forward = v > 0.0
    v_mid = v + 0.5 * dt * c.mobility * (push - friction_force(v, forward, c))
    v_mid = 0.0 if v * v_mid < 0.0 else v_mid  # friction of this direction down to rest
    v_run = v + dt * c.mobility * (push - friction_force(v_mid, forward, c))
    turns = v * v_run < 0.0
    share = v / (v - v_run) if turns else 1.0
    share = 0.0 if rest else share  # of the step until rest
    left = (1.0 - share) * dt
    v_loose = from_rest(push, left, c)
    stops = rest | turns
    x = now.x + 0.5 * dt * share * v + 0.5 * (left * v_loose if stops else dt * v_run)
    return AxisState(
        x, v_loose if stops else v_run, now.output + gap * c.decay, now.x_1, now.x_2, now.output
    )


@step
def controlled(now, command, pulse, sample, c, interval):
    """The controller at a sample: `AxisState` with its output, V, and `AxisAnswer`.

    k_v (k_p (q_ref - q) - dq_f/dt), q_f the mean of the last two samples, so that its difference
    spans two intervals; then the pulse, then the limit.
    """
    speed = (now.x - now.x_2) * (0.5 / interval)
    output = c.k_velocity * (c.k_position * (command - now.x) - speed) + pulse
    output = clip(output, -c.limit, c.limit) if c.closed > 0.0 else command
    return AxisState(now.x, now.v, now.u, now.x, now.x_1, output), AxisAnswer(output, now.x)


@step
def axis_at_rest(reference, c):
    """`AxisState` at rest at a reference."""
    return AxisState(reference, 0.0, 0.0, reference, reference, 0.0)


axis_traces = Traces(AxisConstants, AxisState, AxisAnswer, controlled, axis_step)


FIRST = 20  # samples from which the first state is taken; the published scores leave them out


def axis_constants(actuator: LinearAxis, k: Mapping[str, Any]) -> AxisConstants:
    """Constants of candidates, numbers or (B,) arrays.

    ``k`` are faults by name and parameters by place; what it does not name is healthy.
    """
    own = actuator.varied(k, GRID)
    friction, drive, control = own.friction, own.drive, own.controller
    dry = friction.coulomb * k.get("friction", 1.0)
    dry_side = np.sqrt(friction.coulomb_ratio * k.get("dry_asymmetry", 1.0))
    viscous = friction.viscous * k.get("viscous", 1.0)
    viscous_side = np.sqrt(friction.viscous_ratio * k.get("viscous_asymmetry", 1.0))
    interval = actuator.controller.sample_time
    steps = interval / actuator.steps.within(interval) / drive.response_time
    decay = np.exp(-steps)
    return AxisConstants(
        mobility=1.0 / own.carriage.mass,
        dry_forward=dry / dry_side,
        dry_backward=dry * dry_side,
        standstill=friction.standstill_ratio - 1.0,
        per_fading=1.0 / friction.fading_speed,
        viscous_forward=viscous / viscous_side,
        viscous_backward=viscous * viscous_side,
        gain=drive.gain * k.get("drive_gain", 1.0),
        offset=drive.offset,
        decay=decay,
        lagging=(1.0 - decay) / steps,
        limit=drive.voltage_limit,
        k_position=control.position_gain * k.get("position_gain", 1.0),
        k_velocity=control.velocity_gain,
        closed=1.0,
    )


def follow(
    actuator: LinearAxis, recording: Recording, candidates: Mapping[str, np.ndarray], count: int, *,
    closed: bool = True,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Voltage (V) and position (m), (B, S) by name, of candidates that follow a recording.

    The controller drives them along the reference, or the recorded voltage, where the loop is not
    ``closed``; pulses are added where it has them. They start in the state from which the recorded
    voltage leads them closest to the first 20 recorded positions; at rest at the reference, or the
    first position, where a channel is missing.

    `RecordError` if it is not sampled with the controller, or lacks a channel that drives.
    """
    actuator.check_interval(recording)
    channels, interval = recording.channels, actuator.controller.sample_time
    for name in () if closed else ("voltage", "position"):
        if name not in channels:
            raise RecordError(
                f"{recording.name} has no {name}, which an open-loop simulation needs; it has "
                f"{', '.join(channels)}."
            )
    controlled = axis_constants(actuator, candidates)
    driven = controlled._replace(closed=0.0)
    rest: Any = np.zeros((3, count))
    x, v, u = rest

    def answers(
        channels: Mapping[str, np.ndarray], constants: AxisConstants
    ) -> dict[str, np.ndarray]:
        # it came at the same speed
        state = AxisState(x, v, u, x - interval * v, x - 2.0 * interval * v, 0.0)
        command = channels["reference" if constants.closed else "voltage"]
        return axis_traces(
            command, channels.get("pulses"), constants, state, interval,
            actuator.steps.within(interval), count=count,
        )  # fmt: skip

    x += channels["position" if "position" in channels else "reference"][0]
    if {"position", "voltage"} <= channels.keys():
        u += channels["voltage"][0]
        first = {name: trace[: FIRST + 1] for name, trace in channels.items()}
        time = np.arange(first["position"].size) * recording.interval
        straight = np.linalg.pinv(np.column_stack([np.ones_like(time), time]))
        # the first state changes the friction under which it is found
        for _ in range(3 if time.size > 2 else 0):
            away = straight @ (first["position"] - answers(first, driven)["position"]).T
            x, v = x + away[0], v + away[1]
    return answers(channels, controlled if closed else driven)
