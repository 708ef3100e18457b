"""The monitor model as a readable loop: one equivalent phase, two masses in rigid contact."""

import numpy as np

from . import mechanics, motor


def equivalent_phase(theta_m, faults, actuator):
    """R, L and kappa of the two conducting phases in series."""
    pair = motor.PAIRS[motor.sector(actuator.motor.pole_pairs * theta_m)]
    kappa = motor.kappa(theta_m, faults, actuator)
    h = motor.turns_left(faults)
    resistance = sum(h[k] * actuator.motor.resistance / 2 for k in pair)
    inductance = sum(motor.inductance(h[k], actuator) for k in pair)
    return resistance, inductance, sum(abs(kappa[k]) for k in pair)


def simulate(actuator, faults, command, load, dt):
    """Simulate from rest; arguments as in the naive reference model.

    Returns
    -------
    dict of arrays: mean_current (A) and power (W, electrical) of each step; current, motor,
    motor_speed, output, output_speed after it
    """
    drive, gear = actuator.drive, actuator.transmission
    worn = 1 + 2 * faults.friction
    half_gap = gear.backlash / 2 * (1 + 99 * faults.backlash)
    low, high = gear.travel_low * gear.ratio, gear.travel_high * gear.ratio
    current = x_m = w_m = x_o = w_o = 0.0
    gained = 0.0  # speed, in the last step
    control = actuator.controller
    names = ("mean_current", "current", "motor", "motor_speed", "output", "output_speed", "power")
    rows = []
    for command_now, load_now in zip(command, load, strict=True):
        # all of a step happens in its middle
        x_mid = x_m + w_m * dt / 2
        resistance, inductance, kappa = equivalent_phase(x_mid, faults, actuator)
        touching = abs(abs(x_m - x_o) - half_gap) <= 1e-9
        inertia = actuator.motor.inertia + (gear.output_inertia if touching else 0)
        # the speed there, if all torques stayed; and by how much an ampere more would change it
        w_mid = w_m + gained / 2
        per_ampere = 0 if w_m == 0 else kappa / inertia * dt / 2
        gain = control.position_gain * (0.5 + faults.gain)
        speed_reference = gain * (command_now - x_o - w_o * dt / 2)
        speed_reference = max(-control.speed_limit, min(control.speed_limit, speed_reference))
        # i = g (w_ref - w_mid - per_ampere (i - current)), solved for i
        g = control.speed_gain / actuator.motor.emf_constant
        wanted = g * (speed_reference - w_mid + per_ampere * current) / (1 + g * per_ampere)
        wanted = max(-drive.current_limit, min(drive.current_limit, wanted))
        # the voltage that would bring the current there in one step, if there is so much
        drop = resistance * current + kappa * w_m
        voltage = inductance * (wanted - current) / dt + drop
        voltage = max(-drive.supply_voltage, min(drive.supply_voltage, voltage))
        mean = current + dt * (voltage - drop) / inductance
        # heat, mechanical power and what the inductance takes up
        stored = inductance * (mean - current) / dt * mean
        power = resistance * mean**2 + kappa * w_mid * mean + stored
        before = kappa * current - actuator.motor.viscous_damping * w_m
        current = mean

        dynamic_m = worn * actuator.motor.friction_torque
        # the ripple of the real current has peaks of half a band, which help to break loose
        static_m = max(dynamic_m, gear.static_ratio * dynamic_m - kappa * drive.hysteresis_band / 2)
        dynamic_o = worn * mechanics.loaded_dynamic_torque(
            w_o if w_o != 0 else w_m, -load_now, gear.friction_torque,
            gear.efficiency_opposing, gear.efficiency_aiding,
        )  # fmt: skip
        rotor = {
            "x": x_m, "w": w_m, "before": before,
            "act": kappa * mean - actuator.motor.viscous_damping * w_mid,
            "j": actuator.motor.inertia, "ts": static_m, "td": dynamic_m,
        }  # fmt: skip
        output = {
            "x": x_o, "w": w_o, "act": -load_now, "before": -load_now,
            "j": gear.output_inertia, "ts": gear.static_ratio * dynamic_o, "td": dynamic_o,
        }  # fmt: skip
        x_m, w_m, x_o, w_o, gained = mechanics.two_masses_rigid_contact(rotor, output, half_gap, dt)
        x_o, w_o = mechanics.end_stop(x_o, w_o, low, high)
        x_m, w_m = mechanics.end_stop(x_m, w_m, low - half_gap, high + half_gap)
        rows.append((mean, current, x_m, w_m, x_o, w_o, power))
    return dict(zip(names, np.array(rows).T, strict=True))
