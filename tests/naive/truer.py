"""The truer forms in plain Python, written from docs/models.md and not from the kernels.

A phase with shorted turns is a pair of coupled windings: `Windings.matrices` states all six as one
linear system, and `advance_phases` solves it. Sampled loops answer from lists of what is asked for.
The monitor model with loops of shorted turns is a readable loop.
"""

import math
from functools import cache

import numpy as np

from . import monitor, motor


def shape(theta, actuator):
    """EMF with a share of a sine and harmonics, of the trapezoid's mean torque in six steps."""
    own = actuator.emf
    if own is None:
        return motor.trapezoid(theta)
    sine = math.sin(theta) / mean_sine(1)
    base = (1 - own.rounding) * motor.trapezoid(theta) + own.rounding * sine
    mean = own.harmonic_5 * mean_sine(5) + own.harmonic_7 * mean_sine(7)
    added = own.harmonic_5 * math.sin(5 * theta) + own.harmonic_7 * math.sin(7 * theta)
    return (1 - mean) * base + added


@cache
def mean_sine(order):
    """Of ``sin(order theta)`` over the 120 degrees in which a phase conducts, by quadrature."""
    angles = math.pi / 6 + (np.arange(20_000) + 0.5) / 20_000 * 2 * math.pi / 3
    return float(np.sin(order * angles).mean())


class Windings:
    """Three phases, each with a loop of shorted turns."""

    def __init__(self, actuator, faults):
        self.actuator, self.faults = actuator, faults
        contact = actuator.shorted_turns
        shorted = [faults.short_a, faults.short_b, faults.short_c]
        self.mu = [0.0 if contact is None else share for share in shorted]
        self.h = [1.0 - share if contact is None else 1.0 for share in shorted]
        self.contact = 1.0 if contact is None else contact.resistance
        self.resistance = [h * actuator.motor.resistance / 2 for h in self.h]
        self.inductance = [motor.inductance(h, actuator) for h in self.h]
        leak = actuator.motor.leakage_share * actuator.motor.inductance / 2
        self.linked = [whole - leak for whole in self.inductance]

    def kappa(self, theta_m):
        theta_e = self.actuator.motor.pole_pairs * theta_m
        k_e = self.actuator.motor.emf_constant / 2
        return [
            h * k_e * shape(theta_e - 2 * math.pi * k / 3, self.actuator) * self.ripple(theta_m)
            * motor.gap_factor(theta_m, k, self.faults, self.actuator)
            for k, h in enumerate(self.h)
        ]  # fmt: skip

    def ripple(self, theta_m):
        own = self.actuator.torque_ripple
        return 1 if own is None else 1 + own.share * math.sin(own.cycles * theta_m + own.phase)

    def matrices(self):
        """M and R, (6, 6), of v = M d(i)/dt + R i + e: three phases, then their loops."""
        m, r = np.zeros((6, 6)), np.zeros((6, 6))
        for k in range(3):
            mu = self.mu[k]
            m[k, k], r[k, k] = self.inductance[k], self.resistance[k]
            m[k, 3 + k] = m[3 + k, k] = -mu * self.linked[k]
            r[k, 3 + k] = r[3 + k, k] = -mu * self.resistance[k]
            m[3 + k, 3 + k] = mu**2 * self.linked[k]
            r[3 + k, 3 + k] = mu * self.resistance[k] + self.contact
        return m, r

    def emf(self, kappa, speed):
        """(6,) array, V: in a loop it drives the current out through the contact."""
        phases = speed * np.array(kappa)
        return np.concatenate([phases, -np.array(self.mu) * phases])

    def torque(self, kappa, currents):
        return sum(
            kappa[k] * (currents[k] - self.mu[k] * currents[3 + k]) for k in range(3)
        )  # fmt: skip

    def loops(self, before, phases, emf, dt):
        """Loop currents after ``dt``, (3,), where the phase currents are given (backward Euler)."""
        m, r = self.matrices()
        coupled = m[3:, :3] @ (phases - before[:3]) / dt + r[3:, :3] @ phases
        return np.linalg.solve(
            m[3:, 3:] / dt + r[3:, 3:], m[3:, 3:] @ before[3:] / dt - coupled - emf[3:]
        )


def advance_phases(windings, currents, voltages, emf, dt):
    """All six currents after ``dt`` by backward Euler with voltages on three conducting legs."""
    m, r = windings.matrices()
    matrix, right = np.zeros((7, 7)), np.zeros(7)
    matrix[:6, :6] = m / dt + r
    matrix[:3, 6] = matrix[6, :3] = 1.0  # star point; the currents add up to zero
    right[:6] = m @ currents / dt - emf
    right[:3] += voltages
    return np.linalg.solve(matrix, right)[:6]


class SpeedLoop:
    """The controller with an integral term, sampled each few steps and late by some of them.

    ``begins`` is where within a step encoders count on, and the motor has stood at zero.
    """

    def __init__(self, actuator, faults, dt, begins=0.5):
        self.actuator, self.dt = actuator, dt
        self.gain = actuator.controller.position_gain * (0.5 + faults.gain)
        own = actuator.speed_loop
        self.sampled = own is not None and own.sample_time > 0
        self.k_i = 0.0 if own is None else own.integral_gain
        self.every = round(own.sample_time / dt) if self.sampled else 1
        self.delay = round(own.delay / dt) if self.sampled else 0
        self.answers = {}  # by the step from which they hold
        self.asked, self.integral, self.now = 0.0, 0.0, 0
        self.begins = begins
        counts = actuator.encoder is not None
        self.angle, self.seen = self.shown(0.0, "motor") if counts else 0.0, 0.0

    def shown(self, angle, side):
        """The middle of the step of an encoder in which an angle on the motor shaft lies."""
        encoder = self.actuator.encoder
        steps = encoder.motor_steps
        if side == "output":
            steps = encoder.output_steps / self.actuator.transmission.ratio
        turns = angle / (2 * math.pi)
        return 2 * math.pi / steps * (math.floor(turns * steps + self.begins) + 0.5 - self.begins)

    def demand(self, command, output, speed, angle):
        """Current asked for in the next step, A, before its limit."""
        control, drive = self.actuator.controller, self.actuator.drive
        if self.now % self.every == 0:
            if self.actuator.encoder is not None:
                output, now = self.shown(output, "output"), self.shown(angle, "motor")
                speed = (now - self.angle) / (self.every * self.dt)
                lag = self.actuator.encoder.filter_time
                stays = math.exp(-self.every * self.dt / lag) if lag > 0 else 0.0
                speed = stays * self.seen + (1 - stays) * speed
                self.angle, self.seen = now, speed
            wanted = self.gain * (command - output)
            error = max(-control.speed_limit, min(control.speed_limit, wanted)) - speed
            grown = self.integral + self.k_i * self.every * self.dt * error
            wish = (control.speed_gain * error + grown) / self.actuator.motor.emf_constant
            if not (abs(wish) > drive.current_limit and wish * error > 0):
                self.integral = grown
            self.answers[self.now + self.delay] = wish
        self.asked = self.answers.pop(self.now, self.asked)
        self.now += 1
        return self.asked


class CurrentLoop:
    """A sampled PI controller of the pair's current."""

    def __init__(self, actuator, dt):
        self.own, self.supply = actuator.current_loop, actuator.drive.supply_voltage
        self.every, self.delay = (round(x / dt) for x in (self.own.sample_time, self.own.delay))
        self.answers = {}
        self.voltage, self.integral, self.now = 0.0, 0.0, 0

    def answer(self, wanted, seen):
        """Voltage across the pair in this step."""
        if self.now % self.every == 0:
            error = wanted - seen
            wish = self.own.proportional_gain * error + self.integral
            limited = max(-self.supply, min(self.supply, wish))
            if limited == wish or (wish - limited) * error < 0:
                self.integral += self.own.integral_gain * self.own.sample_time * error
            self.answers[self.now + self.delay] = limited
        self.voltage = self.answers.pop(self.now, self.voltage)
        self.now += 1
        return self.voltage


def gates_of_step(theta_e, moved_e):
    """Mean gates of a step, by the share of each pair that conducts in it."""
    width = max(abs(moved_e) * 3 / math.pi, 1e-6)
    place = theta_e * 3 / math.pi
    border = math.floor(place + width / 2 - 0.5) + 0.5
    late = min(1.0, (place + width / 2 - border) / width)
    pairs = [
        np.array(motor.gates(motor.sector((border + side) * math.pi / 3), 1))
        for side in (-0.5, 0.5)
    ]
    return (1 - late) * pairs[0] + late * pairs[1]


def simulate_monitor(actuator, faults, command, load, dt):
    """The monitor model from rest; arguments and answer as in the naive monitor model."""
    drive, control = actuator.drive, actuator.controller
    windings, body = Windings(actuator, faults), monitor.TwoMasses(actuator, faults)
    gain = control.position_gain * (0.5 + faults.gain)
    current, start, gates = 0.0, 0.0, np.array([1, -1, 0])
    loops = np.zeros(3)
    rows = []
    for command_now, load_now in zip(command, load, strict=True):
        x_mid, w_mid = body.x_m + body.w_m * dt / 2, body.w_m + body.gained / 2
        kappa = windings.kappa(x_mid)
        emf = windings.emf(kappa, w_mid)
        before = np.concatenate([gates * current, loops])
        pole_pairs = actuator.motor.pole_pairs
        gates = gates_of_step(pole_pairs * x_mid, pole_pairs * body.w_m * dt)

        def answer(i, gates=gates, before=before, emf=emf, kappa=kappa, current=current):
            """All currents, torque and voltage of the pair if its current became ``i``."""
            after = np.concatenate([gates * i, windings.loops(before, gates * i, emf, dt)])
            m, r = windings.matrices()
            # each phase of the pair has the current of the pair, for its share of the step;
            # commutation by itself takes no voltage, as if the pair had always had its current
            own = m.diagonal()[:3] * (i - current) / dt + r.diagonal()[:3] * (i + current) / 2
            of_loops = m[:3, 3:] @ (after[3:] - before[3:]) / dt + r[:3, 3:] @ after[3:]
            volts = abs(gates) @ own + gates @ (of_loops + emf[:3])
            return after, windings.torque(kappa, after), volts

        _, torque_0, volts_0 = answer(0.0)
        _, torque_1, volts_1 = answer(1.0)
        j_m, j_o = actuator.motor.inertia, actuator.transmission.output_inertia
        mobility = 1 / (j_m + j_o) if body.touching() else 1 / j_m
        per_ampere = 0 if body.w_m == 0 else (torque_1 - torque_0) * mobility * dt / 2
        per_speed = control.speed_gain / actuator.motor.emf_constant
        g = per_speed * per_ampere
        behind = gain * (command_now - body.x_o - body.w_o * dt / 2)
        error = max(-control.speed_limit, min(control.speed_limit, behind)) - w_mid
        asked = (per_speed * error + g * current) / (1 + g)
        asked = max(-drive.current_limit, min(drive.current_limit, asked))
        # the voltage is a straight line over the current
        ends = [(v - volts_0) / (volts_1 - volts_0)
                for v in (-drive.supply_voltage, drive.supply_voltage)]  # fmt: skip
        wanted = max(start + ends[0] - current, min(start + ends[1] - current, asked))
        after, torque, volts = answer(wanted)
        jump, left = body.move(
            torque - actuator.motor.viscous_damping * w_mid,
            windings.torque(kappa, np.concatenate([gates * current, loops]))
            - actuator.motor.viscous_damping * body.w_m,
            gates @ np.array(kappa), load_now, dt,
        )  # fmt: skip
        power = volts * wanted
        before_i, current, loops = current, wanted, after[3:]
        start = current
        if left > 0:
            asked = max(-drive.current_limit, min(drive.current_limit, asked - per_speed * jump))
            low, high = (end - before_i for end in ends)
            change = max(low * left, min(high * left, asked - wanted))
            start = wanted + change - (high if asked > wanted else low) / 2
            current = wanted + change * left / 2
            body.push((torque_1 - torque_0) * dt * change * left / 2)
        body.hold()
        rows.append((current, current, body.x_m, body.w_m, body.x_o, body.w_o, power))
    return dict(zip(monitor.NAMES, np.array(rows).T, strict=True))
