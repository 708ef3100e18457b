"""One step of a ball-screw actuator under a sampled position loop.

docs/ball-screw.md. On the motor shaft, SI:

    omega_ref = (K_p e + K_i int e dt) / (lead / 2 pi)          updated each sample time, then held
    tau domega/dt = omega_ref - omega                           the motor follows, whatever the load
    T = friction(omega, load) + load                            quasi-static: inertia is left out
    i = i_idle + |T omega| / U                                  the drive takes the mechanical power

The nut is dragged through the backlash as a play: friction of nut and guide exceeds the load, so
that the nut stays where it was pushed. Friction falls with speed, as it does in a stepper
drive whose torque falls with speed; Borello's efficiencies add the share of the load.
"""

from typing import NamedTuple

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
