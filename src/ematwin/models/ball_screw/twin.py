"""The ball-screw twin: stepper motor, screw and nut under a sampled position loop.

docs/ball-screw.md has the equations and their sources; all on the motor shaft, SI.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ematwin.errors import RecordError
from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.models.sections import GRID
from ematwin.numerics.backlash import play
from ematwin.numerics.compile import step
from ematwin.numerics.friction import loaded_friction
from ematwin.numerics.lanes import Traces

LEAST_FRICTION = 0.1  # of that at standstill, where the line falls below


class BallScrewConstants(NamedTuple):
    """Constants of an actuator with its faults, SI, on the motor shaft."""

    per_radian: float  # m of nut for one radian of the screw
    half_gap: float  # rad
    friction: float  # N m, dry friction extrapolated to standstill, no load
    w_fading: float  # rad/s, speed at which the falling friction would vanish
    c_opposing: float  # 1/eta_o - 1
    c_aiding: float  # 1 - eta_a
    load: float  # N m, pushes the nut in the positive sense
    voltage: float  # V
    i_idle: float  # A
    response_time: float  # s
    k_position: float  # 1/s
    k_integral: float  # 1/s^2
    update: float  # steps from one sample of the position loop to the next
    share: float  # of a step in the sampling interval of the recording
    initial_error: float  # m, position error at rest before the first sample


class BallScrewState(NamedTuple):
    """State of actuator and position loop."""

    w: float  # rad/s, screw
    theta: float  # rad, screw
    nut: float  # rad, nut as an angle of the screw
    integral: float  # m s, of the position error
    w_ref: float  # rad/s, held
    wait: float  # steps until the next sample of the loop
    current: float  # A, mean since the last sample of the recording, as far as it went


class BallScrewAnswer(NamedTuple):
    """Compared channels at a sample."""

    current: float  # A, mean over the interval that ends at the sample
    position_error: float  # m


@step
def falling_friction(w, c):
    """Dry friction torque at a speed, N m: a falling line with a floor."""
    share = 1.0 - abs(w) / c.w_fading
    return c.friction * (share if share > LEAST_FRICTION else LEAST_FRICTION)


@step
def drive_torque(w, c):
    """Torque of the motor in steady motion, N m."""
    dry = loaded_friction(w, c.load, falling_friction(w, c), c.c_opposing, c.c_aiding)
    against = dry if w > 0.0 else -dry
    return (against if w != 0.0 else 0.0) - c.load


@step
def ball_screw_step(now, set_point, load, c, dt):
    """Advance by ``dt``; ``set_point`` (m) holds at its start."""
    due = now.wait < 0.5
    error = set_point - c.per_radian * now.nut
    grown = now.integral + error * c.update * dt
    integral = grown if due else now.integral
    asked = (c.k_position * error + c.k_integral * grown) / c.per_radian
    w_ref = asked if due else now.w_ref
    wait = (c.update if due else now.wait) - 1.0
    w = now.w + dt / c.response_time * (w_ref - now.w)
    theta = now.theta + dt * w
    nut = play(theta, now.nut, c.half_gap)
    current = c.i_idle + abs(drive_torque(w, c) * w) / c.voltage
    return BallScrewState(w, theta, nut, integral, w_ref, wait, now.current + c.share * current)


@step
def seen(now, set_point, load, sample, c, interval):
    """The state, which begins another mean of the current, and `BallScrewAnswer`."""
    after = BallScrewState(now.w, now.theta, now.nut, now.integral, now.w_ref, now.wait, 0.0)
    return after, BallScrewAnswer(now.current, set_point - c.per_radian * now.nut)


@step
def ball_screw_at_rest(set_point, c):
    """`BallScrewState` at rest, the nut in the middle of its play."""
    theta = (set_point - c.initial_error) / c.per_radian
    return BallScrewState(0.0, theta, theta, 0.0, 0.0, 0.0, c.i_idle)


ball_screw_traces = Traces(
    BallScrewConstants, BallScrewState, BallScrewAnswer, seen, ball_screw_step
)


def ball_screw_constants(
    actuator: BallScrew, k: Mapping[str, Any], update: int, substeps: int
) -> BallScrewConstants:
    """Constants of the equations in docs/ball-screw.md, numbers or (B,) arrays.

    ``k`` are unknowns by name and parameters by place; steps are as of `steps_of`.
    """
    own = actuator.varied(k, GRID)
    screw, drive, control = own.screw, own.drive, own.controller
    per_radian = screw.lead / (2.0 * math.pi)
    gain = k.get("gain", 1.0)
    return BallScrewConstants(
        per_radian=per_radian,
        half_gap=0.5 * k.get("backlash", screw.backlash) / per_radian,
        friction=screw.friction_force * per_radian * k.get("friction", 1.0),
        w_fading=screw.fading_speed / per_radian,
        c_opposing=1.0 / screw.efficiency_opposing - 1.0,
        c_aiding=1.0 - screw.efficiency_aiding,
        load=k.get("load", 0.0) * per_radian,
        voltage=drive.supply_voltage,
        i_idle=drive.idle_current,
        response_time=drive.response_time,
        k_position=control.position_gain * gain,
        k_integral=control.integral_gain * gain,
        update=float(update),
        share=1.0 / substeps,
        initial_error=k.get("initial_error", 0.0),
    )


def steps_of(actuator: BallScrew, interval: float) -> tuple[int, int]:
    """Steps from one update of the position loop to the next, and from one sample to the next."""
    sample_time, step = actuator.controller.sample_time, actuator.steps.twin
    update = max(1, round(sample_time / step))
    substeps = max(1, round(interval * update / sample_time))
    if abs(substeps * sample_time / update - interval) > 0.01 * interval:
        raise RecordError(
            f"The motions are sampled every {interval:g} s, not a whole number of steps of "
            f"{sample_time / update:g} s. Change controller.sample_time or steps.twin of "
            f"{actuator.name}, or resample the motions."
        )
    return update, substeps
