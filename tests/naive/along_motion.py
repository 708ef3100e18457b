"""Currents and torques along a given motion in plain Python, written from docs/models.md.

Loops of `truer` answer, each phase is a line of the linear system of `reference`; a modulated
voltage stands across the pair by its mean.
"""

import math

import numpy as np

from . import motor, reference, truer


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
