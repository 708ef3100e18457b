"""One step of a ball-screw actuator under a sampled position loop.

docs/ball-screw.md. On the motor shaft, SI:

    omega_ref = (K_p e + K_i int e dt) / (lead / 2 pi)          updated each sample time, then held
    tau domega/dt = omega_ref - omega                           the motor follows, whatever the load
    T = friction(omega, load) + load                            quasi-static: inertia is left out
    i = i_idle + |T omega| / U                                  the drive takes the mechanical power

The nut is dragged through the backlash as a play: its own friction and that of the guide exceed
the load, so that it stays where it was pushed. Friction falls with speed, as it does in a stepper
drive whose torque falls with speed; Borello's efficiencies add the share of the load.
"""

from typing import NamedTuple

from ematwin.numerics.backlash import play
from ematwin.numerics.compile import step
from ematwin.numerics.friction import loaded_friction

LEAST_FRICTION = 0.1  # of that at standstill, where the line falls below


class BallScrewState(NamedTuple):
    """State of the model."""

    w: float  # rad/s, screw
    theta: float  # rad, screw
    nut: float  # rad, nut as an angle of the screw
    integral: float  # m s, of the position error


@step
def falling_friction(w, friction, w_fading):
    """Dry friction torque at a speed, N m: a falling line with a floor."""
    share = 1.0 - abs(w) / w_fading
    return friction * (share if share > LEAST_FRICTION else LEAST_FRICTION)


@step
def drive_torque(w, load, friction, c):
    """Torque of the motor in steady motion, N m; ``load`` pushes the nut in the positive sense."""
    dry = loaded_friction(
        w, load, falling_friction(w, friction, c.w_fading), c.c_opposing, c.c_aiding
    )
    against = dry if w > 0.0 else -dry
    return (against if w != 0.0 else 0.0) - load


@step
def ball_screw_step(state, w_ref, load, friction, half_gap, c, dt):
    """Advance by ``dt``; gives the state (its integral unchanged) and the current of the drive."""
    w = state.w + dt / c.response_time * (w_ref - state.w)
    theta = state.theta + dt * w
    nut = play(theta, state.nut, half_gap)
    current = c.i_idle + abs(drive_torque(w, load, friction, c) * w) / c.voltage
    return BallScrewState(w, theta, nut, state.integral), current
