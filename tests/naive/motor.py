"""The trapezoidal motor and its commutation, from the equations, with ``math`` alone."""

import math

# Which leg is high and which is low for positive torque, by sector of 60 electrical degrees
# from 30 degrees on: the pair whose back-EMFs are on their flats.
PAIRS = ((0, 1), (0, 2), (1, 2), (1, 0), (2, 0), (2, 1))


def trapezoid(theta):
    """Flat at +1 from 30 to 150 degrees, at -1 from 210 to 330, straight lines between."""
    degrees = math.degrees(theta) % 360
    if degrees < 30:
        return degrees / 30
    if degrees < 150:
        return 1.0
    if degrees < 210:
        return (180 - degrees) / 30
    if degrees < 330:
        return -1.0
    return (degrees - 360) / 30


def sector(theta_e):
    return int(((math.degrees(theta_e) - 30) % 360) // 60)


def gates(sector_number, sign):
    """Drive of each leg: 1 high, -1 low, 0 off."""
    first, second = PAIRS[sector_number]
    legs = [0, 0, 0]
    legs[first] = sign
    legs[second] = -sign
    return legs


def turns_left(faults):
    return [1 - faults.short_a, 1 - faults.short_b, 1 - faults.short_c]


def inductance(h, actuator):
    """Self-inductance goes with the square of the turns; a share lies outside them."""
    whole = actuator.motor.inductance / 2
    share = actuator.motor.leakage_share
    return share * whole + (1 - share) * whole * h**2


def gap_factor(theta_m, phase, faults, actuator):
    """The air gap that a phase sees: part of the offset turns with the rotor, the rest does not."""
    turning = 1.0 if actuator.eccentricity is None else actuator.eccentricity.turning_share
    angle = 2 * math.pi * (faults.eccentricity_phase - 0.5) - 2 * math.pi * phase / 3
    wave = turning * math.cos(theta_m + angle) + (1 - turning) * math.cos(angle)
    return 1 + faults.eccentricity * wave


def kappa(theta_m, faults, actuator):
    """EMF constants of the three phases, V s/rad."""
    k_e = actuator.motor.emf_constant / 2
    theta_e = actuator.motor.pole_pairs * theta_m
    return [
        h
        * k_e
        * trapezoid(theta_e - 2 * math.pi * k / 3)
        * gap_factor(theta_m, k, faults, actuator)
        for k, h in enumerate(turns_left(faults))
    ]


def current_reference(command, output, motor_speed, faults, actuator):
    """Cascaded controller: position, speed, current; positions on the motor shaft."""
    gain = actuator.controller.position_gain * (0.5 + faults.gain)
    limit = actuator.controller.speed_limit
    speed_reference = max(-limit, min(limit, gain * (command - output)))
    torque = actuator.controller.speed_gain * (speed_reference - motor_speed)
    current = torque / actuator.motor.emf_constant
    return max(-actuator.drive.current_limit, min(actuator.drive.current_limit, current))
