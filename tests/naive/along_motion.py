"""Currents along a given motion, and an output that follows it, in plain Python.

Written from docs/models.md. Loops of `truer` answer, each phase is a line of the linear system of
`reference`; a modulated voltage stands across the pair by its mean.
"""

import math

import numpy as np

from . import mechanics, motor, reference, truer


def currents(actuator, faults, command, motion, dt):
    """Mean phase currents (S, 3) of each step; command (S,), motion (3, S) on the motor shaft.

    ``motion`` holds angle and speed of the motor and the angle of the output.
    """
    drive = actuator.drive
    windings = truer.Windings(actuator, faults)
    speed_loop = truer.SpeedLoop(actuator, faults, dt)
    modulated = actuator.current_loop is not None
    current_loop = truer.CurrentLoop(actuator, dt) if modulated else None
    now, sign, rows = np.zeros(3), 1, []
    for asked, theta, speed, output in zip(command, *motion, strict=True):
        emf = [k * speed for k in windings.kappa(theta)]
        sector = motor.sector(actuator.motor.pole_pairs * theta)
        pair = motor.gates(sector, 1)
        limit = drive.current_limit
        wanted = max(-limit, min(limit, speed_loop.demand(asked, output, speed, theta)))
        along = float(np.dot(pair, now))
        if modulated:
            volts = current_loop.answer(wanted, along / 2)
            volts -= actuator.current_loop.lost_voltage * max(-1, min(1, along / 2 / 0.1))
        else:
            seen = math.copysign(max(abs(now)), along)
            if seen > wanted + drive.hysteresis_band / 2:
                sign = -1
            elif seen < wanted - drive.hysteresis_band / 2:
                sign = 1
            volts = sign * drive.supply_voltage
        charge, left = np.zeros(3), dt
        while left > 0:
            legs = reference.leg_voltages(
                pair, now, emf, windings.resistance, windings.inductance, drive
            )
            for leg in range(3):
                if pair[leg] != 0:
                    legs[leg] = (drive.supply_voltage + pair[leg] * volts) / 2
            slope, _ = reference.slopes(legs, now, emf, windings.resistance, windings.inductance)
            blocked = [
                k for k in range(3) if pair[k] == 0 and now[k] * (now[k] + left * slope[k]) < 0
            ]
            part = -now[blocked[0]] / slope[blocked[0]] if blocked else left
            after = now + part * slope
            after[blocked] = 0.0
            charge += part * (now + after) / 2
            now, left = after, left - part if blocked else 0
        rows.append(charge / dt)
    return np.array(rows)


def output(actuator, faults, start, motion, load, dt):
    """Angles (S + 1,) of an output that friction holds, beside a motor.

    ``start`` are its angle and speed, ``motion`` (2, S) those of the motor in the middle of each
    step, ``load`` (S,) the torque there; all on the motor shaft.
    """
    gear = actuator.transmission
    worn = 1 + 2 * faults.friction
    half_gap = gear.backlash / 2 * (1 + 99 * faults.backlash)
    angle, speed = start
    found = [angle]
    for motor_angle, motor_speed, pushes in zip(*motion, load, strict=True):
        active = mechanics.contact_torque(
            motor_angle, motor_speed, angle, speed, half_gap, gear.contact_stiffness,
            gear.contact_damping,
        ) - pushes  # fmt: skip
        dynamic = worn * mechanics.loaded_dynamic_torque(
            speed if speed != 0 else active, -pushes, gear.friction_torque,
            gear.efficiency_opposing, gear.efficiency_aiding,
        )  # fmt: skip
        speed = mechanics.next_speed(
            speed, active, gear.output_inertia, gear.static_ratio * dynamic, dynamic, dt
        )
        angle += dt * speed
        found.append(angle)
    return np.array(found)
