"""The monitor model as a readable loop: one equivalent phase, two masses in rigid contact."""

import math

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
        self.gained = 0.0  # speed, in a step with the last acceleration

    def touching(self):
        return abs(abs(self.x_m - self.x_o) - self.half_gap) <= 1e-9

    def move(self, act, before, kappa, load, dt):
        """One step with a torque on the motor, and that of the step before.

        Gives what an impact did to the speed of the motor, and the share of the step left after it.
        """
        drive, gear = self.actuator.drive, self.actuator.transmission
        dynamic_m = self.worn * self.actuator.motor.friction_torque
        # the ripple of the real current has peaks of half a band, which help to break loose
        static_m = max(dynamic_m, gear.static_ratio * dynamic_m - kappa * drive.hysteresis_band / 2)
        dynamic_o = mechanics.output_friction(self.w_o, self.w_m, load, self.worn, gear)
        rotor = {
            "x": self.x_m, "w": self.w_m, "before": before, "act": act,
            "j": self.actuator.motor.inertia, "ts": static_m, "td": dynamic_m,
        }  # fmt: skip
        output = {
            "x": self.x_o, "w": self.w_o, "act": -load, "before": -load,
            "j": gear.output_inertia, "ts": gear.static_ratio * dynamic_o, "td": dynamic_o,
        }  # fmt: skip
        self.x_m, self.w_m, self.x_o, self.w_o, gains, jump, left = (
            mechanics.two_masses_rigid_contact(rotor, output, self.half_gap, dt)
        )
        self.gained = gains * dt
        return jump, left

    def push(self, impulse):
        """Push both, while they touch."""
        inertia = self.actuator.motor.inertia + self.actuator.transmission.output_inertia
        self.w_m += impulse / inertia
        self.w_o += impulse / inertia

    def hold(self):
        """Stop both at the ends of the travel."""
        low, high = self.ends
        self.x_o, self.w_o = mechanics.end_stop(self.x_o, self.w_o, low, high)
        self.x_m, self.w_m = mechanics.end_stop(
            self.x_m, self.w_m, low - self.half_gap, high + self.half_gap
        )


def equivalent_phase(theta_m, moved, faults, actuator):
    """R, L and kappa of the two conducting phases in series.

    Of a step in which the angle moves by ``moved``, with ``theta_m`` in its middle: where another
    pair takes over within it, each counts by its share; of L, its inverse.
    """
    span = max(abs(moved) * actuator.motor.pole_pairs * 3 / math.pi, 1e-6)  # in sectors
    place = theta_m * actuator.motor.pole_pairs * 3 / math.pi
    start, end = place - span / 2, place + span / 2
    border = math.floor(end - 0.5) + 0.5  # sectors begin at 30, 90, ... degrees
    parts = [(place, 1.0)]
    if start < border:
        late = (end - border) / span
        parts = [(border - 0.5, 1 - late), (border + 0.5, late)]
    h = motor.turns_left(faults)
    resistance, mobility, kappa = 0.0, 0.0, 0.0
    for middle, share in parts:
        pair = motor.PAIRS[motor.sector(middle * math.pi / 3)]
        resistance += share * sum(h[k] * actuator.motor.resistance / 2 for k in pair)
        mobility += share / sum(motor.inductance(h[k], actuator) for k in pair)
        # on the flats of the pair, wherever the rotor stands
        turning = [motor.gap_factor(theta_m, k, faults, actuator) for k in pair]
        flats = [h[k] * actuator.motor.emf_constant / 2 for k in pair]
        kappa += share * sum(flat * factor for flat, factor in zip(flats, turning, strict=True))
    return resistance, 1 / mobility, kappa


def simulate(actuator, faults, command, load, dt):
    """Simulate from rest; arguments as in the naive reference model.

    Returns
    -------
    dict of arrays: mean_current (A) and power (W, electrical) of each step; current, motor,
    motor_speed, output, output_speed after it
    """
    drive, gear = actuator.drive, actuator.transmission
    body = TwoMasses(actuator, faults)
    current = start = 0.0
    control = actuator.controller
    rows = []
    for command_now, load_now in zip(command, load, strict=True):
        # all of a step happens in its middle
        moved = body.w_m * dt
        resistance, inductance, kappa = equivalent_phase(
            body.x_m + moved / 2, moved, faults, actuator
        )
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
        # how far the supply can drive it; what the current adds to the drop slows it down
        drop = resistance * current + kappa * body.w_m
        slower = max(1 - resistance * dt / inductance / 2, 0.5)
        rise = dt / inductance * (drive.supply_voltage - drop) * slower
        fall = dt / inductance * (drive.supply_voltage + drop) * slower
        mean = max(start - fall, min(start + rise, wanted))
        # heat, mechanical power and what the inductance takes up
        stored = inductance * (mean - current) / dt * mean
        power = resistance * mean**2 + kappa * w_mid * mean + stored
        before = kappa * current - actuator.motor.viscous_damping * body.w_m
        jump, left = body.move(
            kappa * mean - actuator.motor.viscous_damping * w_mid, before, kappa, load_now, dt
        )
        current = start = mean
        if left > 0:
            # an impact: the rest of the step is a ramp towards what the speed loop asks for now
            asked = max(-drive.current_limit, min(drive.current_limit, wanted - g * jump))
            change = max(-fall * left, min(rise * left, asked - mean))
            start = mean + change - (rise if asked > mean else -fall) / 2
            current = mean + change * left / 2
            body.push(kappa * dt * change * left / 2)
        body.hold()
        rows.append((current, current, body.x_m, body.w_m, body.x_o, body.w_o, power))
    return dict(zip(NAMES, np.array(rows).T, strict=True))
