"""The monitor model as a readable loop: one equivalent phase, two masses in rigid contact."""

import numpy as np

from . import mechanics, motor

NAMES = ("mean_current", "current", "motor", "motor_speed", "output", "output_speed", "power")


class TwoMasses:
    """Motor and output with dry friction, a rigid gap and end stops, from rest."""

    def __init__(self, actuator, faults):
        gear = actuator.transmission
        self.actuator, self.worn = actuator, 1 + 2 * faults.friction
        self.half_gap = gear.backlash / 2 * (1 + 99 * faults.backlash)
        self.ends = gear.travel_low * gear.ratio, gear.travel_high * gear.ratio
        self.x_m = self.w_m = self.x_o = self.w_o = 0.0
        self.gained = 0.0  # speed, in the last step

    def touching(self):
        return abs(abs(self.x_m - self.x_o) - self.half_gap) <= 1e-9

    def move(self, act, before, kappa, load, dt):
        """One step with a torque on the motor, and that of the step before."""
        drive, gear = self.actuator.drive, self.actuator.transmission
        dynamic_m = self.worn * self.actuator.motor.friction_torque
        # the ripple of the real current has peaks of half a band, which help to break loose
        static_m = max(dynamic_m, gear.static_ratio * dynamic_m - kappa * drive.hysteresis_band / 2)
        dynamic_o = self.worn * mechanics.loaded_dynamic_torque(
            self.w_o if self.w_o != 0 else self.w_m, -load, gear.friction_torque,
            gear.efficiency_opposing, gear.efficiency_aiding,
        )  # fmt: skip
        rotor = {
            "x": self.x_m, "w": self.w_m, "before": before, "act": act,
            "j": self.actuator.motor.inertia, "ts": static_m, "td": dynamic_m,
        }  # fmt: skip
        output = {
            "x": self.x_o, "w": self.w_o, "act": -load, "before": -load,
            "j": gear.output_inertia, "ts": gear.static_ratio * dynamic_o, "td": dynamic_o,
        }  # fmt: skip
        self.x_m, self.w_m, self.x_o, self.w_o, self.gained = mechanics.two_masses_rigid_contact(
            rotor, output, self.half_gap, dt
        )
        low, high = self.ends
        self.x_o, self.w_o = mechanics.end_stop(self.x_o, self.w_o, low, high)
        self.x_m, self.w_m = mechanics.end_stop(
            self.x_m, self.w_m, low - self.half_gap, high + self.half_gap
        )


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
    body = TwoMasses(actuator, faults)
    current = 0.0
    control = actuator.controller
    rows = []
    for command_now, load_now in zip(command, load, strict=True):
        # all of a step happens in its middle
        x_mid = body.x_m + body.w_m * dt / 2
        resistance, inductance, kappa = equivalent_phase(x_mid, faults, actuator)
        touching = body.touching()
        inertia = actuator.motor.inertia + (gear.output_inertia if touching else 0)
        # the speed there, if all torques stayed; and by how much an ampere more would change it
        w_mid = body.w_m + body.gained / 2
        per_ampere = 0 if body.w_m == 0 else kappa / inertia * dt / 2
        gain = control.position_gain * (0.5 + faults.gain)
        speed_reference = gain * (command_now - body.x_o - body.w_o * dt / 2)
        speed_reference = max(-control.speed_limit, min(control.speed_limit, speed_reference))
        # i = g (w_ref - w_mid - per_ampere (i - current)), solved for i
        g = control.speed_gain / actuator.motor.emf_constant
        wanted = g * (speed_reference - w_mid + per_ampere * current) / (1 + g * per_ampere)
        wanted = max(-drive.current_limit, min(drive.current_limit, wanted))
        # the voltage that would bring the current there in one step, if there is so much
        drop = resistance * current + kappa * body.w_m
        voltage = inductance * (wanted - current) / dt + drop
        voltage = max(-drive.supply_voltage, min(drive.supply_voltage, voltage))
        mean = current + dt * (voltage - drop) / inductance
        # heat, mechanical power and what the inductance takes up
        stored = inductance * (mean - current) / dt * mean
        power = resistance * mean**2 + kappa * w_mid * mean + stored
        before = kappa * current - actuator.motor.viscous_damping * body.w_m
        current = mean

        body.move(
            kappa * mean - actuator.motor.viscous_damping * w_mid, before, kappa, load_now, dt
        )
        rows.append((mean, current, body.x_m, body.w_m, body.x_o, body.w_o, power))
    return dict(zip(NAMES, np.array(rows).T, strict=True))
