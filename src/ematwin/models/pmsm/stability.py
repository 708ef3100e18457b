"""Whether the sampled loops are stable, and up to which sample time.

Each loop is linear between its limits. Its transition over one period of its slowest sampler is a
matrix, made column by column from the recursion itself: all eigenvalues must lie within the unit
circle (e.g. Franklin, Powell and Workman 1998, Digital Control of Dynamic Systems, chapter 5).

- current: one winding, voltage held for a sample and one sample late;
- speed: the motor alone, as in the gap, under the speed loop around that current loop;
- position: motor and output on the gear's spring, under all three.
"""

import math
from functools import partial
from typing import Any

import numpy as np

from ematwin.errors import ParameterError
from ematwin.numerics.linear_algebra import largest_share, spectral_radius


def check_loops(actuator: Any) -> None:
    """Raise `ParameterError` if a loop is unstable at its sample time; the limit is said."""
    control = actuator.controller
    for loop, name in (("current", "current_time"), ("speed", "speed_time"),
                       ("position", "position_time")):  # fmt: skip
        own = getattr(control, name)
        stable = partial(_is_stable, actuator, loop, own)
        if stable(1.0):
            continue
        limit = own * largest_share(stable)
        advice = (
            f"it is stable up to {1e6 * limit:.3g} us; shorten it or lower the gains"
            if limit > 1e-6 * own  # of a sample time: a limit below is none
            else "no sample time makes it stable; lower the gains"
        )
        raise ParameterError(
            f"the {loop} loop is unstable at controller.{name} = {1e6 * own:.4g} us: {advice}"
        )


def _is_stable(actuator: Any, loop: str, own: float, share: float) -> bool:
    """Whether a loop is stable at a share of its sample time ``own``, s."""
    return loop_radius(actuator, loop, share * own) <= 1.0 + 1e-9  # of the unit circle


def loop_radius(actuator: Any, loop: str, sample_time: float) -> float:
    """Largest magnitude of the eigenvalues of a loop over its sample time, s.

    Faster loops keep their times, or take this one where theirs would be longer.
    """
    if loop == "current":
        motor = actuator.motor
        return max(
            spectral_radius(_current_loop(actuator, inductance, sample_time, np.eye(3)))
            for inductance in (motor.inductance_d, motor.inductance_q)
        )
    control = actuator.controller
    current = min(control.current_time, sample_time)
    speed = min(control.speed_time, sample_time) if loop == "position" else sample_time
    counts = (max(1, round(speed / current)), max(1, round(sample_time / current)))
    rigid = loop == "speed"
    period = sample_time / counts[1]
    return spectral_radius(_cascade(actuator, period, counts, rigid, np.eye(10)))


def _current_loop(actuator: Any, inductance: float, period: float, x: np.ndarray) -> np.ndarray:
    """Current, integrator and pending voltage after a sample; rows of (3, columns)."""
    control, resistance = actuator.controller, actuator.motor.resistance
    current, integral, pending = x
    voltage = integral - control.current_gain * current
    integral = integral - control.current_integral * period * current
    decay = math.exp(-resistance * period / inductance)
    current = decay * current + (1.0 - decay) / resistance * pending
    return np.stack([current, integral, voltage])


def _cascade(
    actuator: Any, period: float, counts: tuple[int, int], rigid: bool, x: np.ndarray
) -> np.ndarray:
    """All loops over one sample of the slowest; rows of (10, columns).

    The motor's EMF is left out: the drive decouples it.
    """
    motor, control, gear = actuator.motor, actuator.controller, actuator.transmission
    k_t = 1.5 * motor.pole_pairs * motor.flux
    inductance, resistance = motor.inductance_q, motor.resistance
    decay = math.exp(-resistance * period / inductance)
    current, integral, pending, w_m, th_m, w_o, th_o, total, before, reference = x
    w_ref = 0.0 * w_m if rigid else -control.position_gain * th_o
    pieces = 4  # steps of the mechanics
    dt = period / pieces
    for n in range(counts[1]):
        if n % counts[0] == 0:
            speed_time = counts[0] * period
            error = w_ref - (th_m - before) / speed_time
            reference = (control.speed_gain * error + total) / control.torque_constant
            total = total + control.speed_integral * speed_time * error
            before = th_m
        error = reference - current
        voltage = integral + control.current_gain * error
        integral = integral + control.current_integral * period * error
        mean = current
        current = decay * current + (1.0 - decay) / resistance * pending
        torque = k_t * 0.5 * (mean + current)
        pending = voltage
        for _ in range(pieces):
            spring = 0.0 if rigid else gear.stiffness * (th_m - th_o) + gear.damping * (w_m - w_o)
            w_m = w_m + dt / motor.inertia * (torque - spring - motor.viscous_damping * w_m)
            w_o = w_o + dt / gear.output_inertia * (spring - gear.viscous_damping * w_o)
            th_m, th_o = th_m + dt * w_m, th_o + dt * w_o
    if rigid:  # where it stands is of no account
        th_m, before = th_m - th_m, before - th_m
        w_o, th_o = 0.0 * w_o, 0.0 * th_o
    return np.stack([current, integral, pending, w_m, th_m, w_o, th_o, total, before, reference])
