"""The ball-screw twin as a readable loop, in metres and newtons on the nut.

Written from the equations of ``ematwin.models.ball_screw.twin``, which are on the motor shaft:
there is no angle here.
"""

import math

from . import mechanics


def friction_force(speed, load, factor, screw):
    """Dry friction of a moving nut, N: a falling line with a floor, and a share of the load."""
    left = max(1 - abs(speed) / screw.fading_speed, 0.1)
    return mechanics.loaded_dynamic_torque(
        speed, load, factor * screw.friction_force * left,
        screw.efficiency_opposing, screw.efficiency_aiding,
    )  # fmt: skip


def motor_force(speed, load, factor, screw):
    """Force that keeps the nut in motion: it overcomes friction and carries the load."""
    if speed == 0:
        return -load
    return mechanics.sign(speed) * friction_force(speed, load, factor, screw) - load


def simulate(actuator, set_point, interval, friction, backlash, gain, load, initial_error):
    """Current (A, mean over the interval before the sample) and position error (m), as lists."""
    screw, drive, loop = actuator.screw, actuator.drive, actuator.controller
    per_update = round(loop.sample_time / actuator.steps.twin)
    dt = loop.sample_time / per_update
    per_sample = round(interval / dt)

    driven = nut = set_point[0] - initial_error  # driven: where a nut without play would be
    speed = wanted = integral = 0.0
    current, error = [drive.idle_current], [initial_error]
    for k in range((len(set_point) - 1) * per_sample):
        sample, part = divmod(k, per_sample)
        if k % per_update == 0:
            here, there = set_point[sample], set_point[sample + 1]
            e = here + (there - here) * part / per_sample - nut
            integral += e * loop.sample_time
            wanted = gain * (loop.position_gain * e + loop.integral_gain * integral)
        speed += dt * (wanted - speed) / drive.response_time
        driven += dt * speed
        nut = mechanics.play(driven, nut, backlash / 2)
        power = abs(motor_force(speed, load, friction, screw) * speed)
        if part == 0:
            current.append(0.0)
        current[-1] += (drive.idle_current + power / drive.supply_voltage) / per_sample
        if part == per_sample - 1:
            error.append(set_point[sample + 1] - nut)
    assert all(math.isfinite(x) for x in error)
    return current, error
