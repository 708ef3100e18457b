"""Whether the sampled loops of a drive settle, with the motor alone and without friction."""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from ematwin.numerics.linear_algebra import largest_share, spectral_radius

# 64 sets of parameters are kept: most of a Jacobian's columns leave the loops as they are


def check_speed_loop(actuator: Any) -> None:
    """Raise ValueError unless the sampled speed loop settles; the message gives the limit."""
    loop = actuator.speed_loop
    given = loop, actuator.controller, actuator.encoder, actuator.motor.inertia
    if loop is None or _speed_settles(*given, 1.0):
        return
    low = largest_share(lambda share: _speed_settles(*given, share))
    advice = "lower the gains" if low == 0.0 else "sample faster or lower the gains"
    raise ValueError(
        f"the speed loop is unstable at speed_loop.sample_time = {loop.sample_time:.3g} s with "
        f"a delay of {loop.delay:.3g} s: with these gains and the motor alone it must be below "
        f"{low * loop.sample_time:.3g} s, the delay in proportion; {advice}"
    )


def check_current_loop(actuator: Any) -> None:
    """Raise ValueError unless the loops settle behind the sampled current loop."""
    loop = actuator.current_loop
    given = loop, actuator.controller, actuator.motor
    if loop is None or _current_settles(*given, 1.0):
        return
    said = (
        f"with current_loop.sample_time = {loop.sample_time:.3g} s and a delay of "
        f"{loop.delay:.3g} s"
    )
    if not _current_settles(*given, 0.0):
        raise ValueError(f"the current loop is unstable {said}: sample faster or lower its gains")
    low = largest_share(lambda share: _current_settles(*given, share))
    raise ValueError(
        f"the speed loop is unstable {said}: behind such a current loop, and with the motor "
        f"alone, controller.speed_gain must be below {low * actuator.controller.speed_gain:.3g} "
        "N*m*s/rad; lower it, or sample the current faster"
    )


@lru_cache(maxsize=64)
def _speed_settles(loop: Any, control: Any, encoder: Any, inertia: float, share: float) -> bool:
    """Whether the speed loop settles at a share of its sample time and delay.

    With an encoder it knows the mean speed of the last sample time, filtered.
    """
    span, delay = share * loop.sample_time, share * loop.delay
    if span == 0.0:
        return True
    k_i = loop.integral_gain * span
    k_p = control.speed_gain + k_i
    position, speed, asked, integral, before, seen = np.eye(6)
    known = speed
    if encoder is not None:
        tau = encoder.filter_time
        passed = -math.expm1(-span / tau) if tau > 0.0 else 1.0
        known = seen + passed * ((position - before) / span - seen)
    error = -control.position_gain * position - known
    answer = k_p * error + integral
    # position, speed, torque asked for before, integral, position and speed known before
    system = np.array([
        position + span * speed,
        speed + (delay * asked + (span - delay) * answer) / inertia,
        answer, integral + k_i * error, position, known,
    ])  # fmt: skip
    kept = [0, 1, 2, *([3] if k_i > 0.0 else []), *([] if encoder is None else [4, 5])]
    return spectral_radius(system[np.ix_(kept, kept)]) < 1.0


@lru_cache(maxsize=64)
def _current_settles(loop: Any, control: Any, motor: Any, share: float) -> bool:
    """Whether the loops settle with a share of the speed gain; 0 is the current loop alone."""
    span = loop.sample_time
    decay = math.exp(-motor.resistance * span / motor.inductance)
    per_volt = (1.0 - decay) / motor.resistance
    # what is asked for by position, speed, current, voltage asked for before, integral
    demand = -share * control.speed_gain / motor.emf_constant
    error = np.array([demand * control.position_gain, demand, -1.0, 0.0, 0.0])
    answer = loop.proportional_gain * error + np.eye(5)[4]
    late = loop.delay / span
    half = 0.5 * span * motor.emf_constant / motor.inertia
    system = np.zeros((5, 5))
    system[2] = per_volt * (late * np.eye(5)[3] + (1.0 - late) * answer)
    system[2] += np.array([0.0, -per_volt * motor.emf_constant, decay, 0.0, 0.0])
    system[1] = half * system[2] + np.array([0.0, 1.0, half, 0.0, 0.0])
    system[0] = 1.0, span, 0.0, 0.0, 0.0
    system[3] = answer
    system[4] = np.eye(5)[4] + loop.integral_gain * span * error
    kept = [n for n in range(5) if n < 4 or loop.integral_gain > 0.0]
    kept = kept if share > 0.0 else [n for n in kept if n > 1]
    return spectral_radius(system[np.ix_(kept, kept)]) < 1.0
