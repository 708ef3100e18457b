"""The truer forms in plain Python, written from docs/models.md and not from the kernels.

A phase with shorted turns is a pair of coupled windings: `Windings.matrices` states all six as one
linear system, and `advance_phases` solves it. The monitor model is a readable loop.
"""

import math

import numpy as np

from . import mechanics, monitor, motor


def shape(theta, actuator):
    """EMF shape with a share of a sine that has the trapezoid's mean torque in six steps."""
    share = 0.0 if actuator.emf is None else actuator.emf.rounding
    sine = 2 * math.pi / (3 * math.sqrt(3)) * math.sin(theta)
    return (1 - share) * motor.trapezoid(theta) + share * sine


def gap(theta_m, phase, faults, actuator):
    """The air gap that a phase sees: part of the offset turns with the rotor, the rest does not."""
    turning = 1.0 if actuator.eccentricity is None else actuator.eccentricity.turning_share
    angle = 2 * math.pi * (faults.eccentricity_phase - 0.5) - 2 * math.pi * phase / 3
    wave = turning * math.cos(theta_m + angle) + (1 - turning) * math.cos(angle)
    return 1 + faults.eccentricity * wave


def cogging(theta_m, actuator):
    """Torque on the rotor, N m."""
    one = actuator.cogging
    return 0.0 if one is None else -one.torque * math.sin(one.cycles * theta_m + one.phase)


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
            h * k_e * shape(theta_e - 2 * math.pi * k / 3, self.actuator)
            * gap(theta_m, k, self.faults, self.actuator)
            for k, h in enumerate(self.h)
        ]  # fmt: skip

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
    """The controller with an integral term, sampled each few steps and late by some of them."""

    def __init__(self, actuator, faults, dt):
        self.actuator, self.dt = actuator, dt
        self.gain = actuator.controller.position_gain * (0.5 + faults.gain)
        own = actuator.speed_loop
        self.sampled = own is not None and own.sample_time > 0
        self.k_i = 0.0 if own is None else own.integral_gain
        self.every = round(own.sample_time / dt) if self.sampled else 1
        self.delay = round(own.delay / dt) if self.sampled else 0
        self.answers = {}  # by the step from which they hold
        self.asked, self.integral, self.now = 0.0, 0.0, 0

    def demand(self, command, output, speed):
        """Current asked for in the next step, A, before its limit."""
        control, drive = self.actuator.controller, self.actuator.drive
        if self.now % self.every == 0:
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
    """A sampled PI controller of the pair's current, and what commutation does to it."""

    def __init__(self, actuator, dt):
        self.own, self.supply, self.dt = actuator.current_loop, actuator.drive.supply_voltage, dt
        self.diode, self.phase = actuator.drive.diode_drop, actuator.motor.inductance / 2
        self.every, self.delay = (round(x / dt) for x in (self.own.sample_time, self.own.delay))
        self.answers = {}
        self.voltage, self.integral, self.now, self.leaving = 0.0, 0.0, 0, 0.0

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

    def run_out(self, emf):
        """Mean current of the leg that is off within a step, whose diode conducts until it is 0."""
        way = 1 if self.leaving >= 0 else -1
        slope = max(0.0, (self.supply / 2 + self.diode + way * emf) / (1.5 * self.phase))
        end = min(self.dt, abs(self.leaving) / slope) if slope > 0 else self.dt
        mean = way * (abs(self.leaving) - slope * end / 2) * end / self.dt
        self.leaving = way * (abs(self.leaving) - slope * end)
        return mean


def since_commutation(theta_e, speed_e, dt):
    """Time since the sector of an electrical angle was entered, s, at most a step."""
    place = theta_e / (math.pi / 3) - 0.5
    gone = (place - math.floor(place)) if speed_e >= 0 else 1 - (place - math.floor(place))
    return min(dt, gone * (math.pi / 3) / max(abs(speed_e), 1e-9))


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


class CompliantMasses(monitor.TwoMasses):
    """Motor and output with dry friction, a gap and a gear that gives.

    The contact torque of a step is found by bisection: that which the spring and the damper have
    where the step, with that torque, brings them, at a share ``eta`` of its way.
    """

    def move(self, act, before, kappa, load, dt):
        drive, gear, soft = (
            self.actuator.drive,
            self.actuator.transmission,
            self.actuator.compliance,
        )
        j_m, j_o = self.actuator.motor.inertia, gear.output_inertia
        s = soft.stiffness * dt**2 * (1 / j_m + 1 / j_o)
        eta = (0.5 + s) / (1 + s)
        now = mechanics.contact_torque(
            self.x_m, self.w_m, self.x_o, self.w_o, self.half_gap, soft.stiffness, soft.damping
        )
        dynamic_m = self.worn * self.actuator.motor.friction_torque
        static_m = max(dynamic_m, gear.static_ratio * dynamic_m - kappa * drive.hysteresis_band / 2)
        dynamic_o = self.worn * mechanics.loaded_dynamic_torque(
            self.w_o if self.w_o != 0 else now - load, -load, gear.friction_torque,
            gear.efficiency_opposing, gear.efficiency_aiding,
        )  # fmt: skip
        static_o = gear.static_ratio * dynamic_o

        def acceleration(speed, torque, start, inertia, static, dynamic):
            if speed == 0 and abs(start) <= static:
                return 0.0
            way = mechanics.sign(speed) or mechanics.sign(start)
            return (torque - dynamic * way) / inertia

        def excess(torque):
            a_m = acceleration(self.w_m, act - torque, act - now, j_m, static_m, dynamic_m)
            a_o = acceleration(self.w_o, torque - load, now - load, j_o, static_o, dynamic_o)
            twist = self.x_m - self.x_o + eta * dt * (self.w_m - self.w_o + eta * dt * (a_m - a_o))
            slip = self.w_m - self.w_o + eta * dt * (a_m - a_o)
            return twist, slip

        side = mechanics.sign(excess(0.0)[0])
        torque = 0.0
        if abs(excess(0.0)[0]) > self.half_gap:

            def error(size):
                twist, slip = excess(side * size)
                return side * (soft.stiffness * (twist - side * self.half_gap)
                               + soft.damping * slip) - size  # fmt: skip

            low, high = 0.0, 1e3
            for _ in range(100):
                middle = (low + high) / 2
                low, high = (middle, high) if error(middle) > 0 else (low, middle)
            torque = side * low
        w_m, _, _ = mechanics.next_speed_through_rest(
            self.w_m, {"act": act - torque, "before": before - now, "j": j_m, "ts": static_m,
                       "td": dynamic_m}, dt,
        )  # fmt: skip
        w_o, _, _ = mechanics.next_speed_through_rest(
            self.w_o, {"act": torque - load, "before": now - load, "j": j_o, "ts": static_o,
                       "td": dynamic_o}, dt,
        )  # fmt: skip
        self.gained = w_m - self.w_m
        self.x_m += dt * ((1 - eta) * self.w_m + eta * w_m)
        x_o = self.x_o + dt * ((1 - eta) * self.w_o + eta * w_o)
        self.x_o, self.w_o = mechanics.end_stop(x_o, w_o, *self.ends)
        self.w_m = w_m

        return 0.0, 0.0  # an impact takes its time

    def hold(self):
        """The gear alone holds the motor."""

    def carried(self, dt):
        """Share of the output that moves with the motor within a step."""
        if abs(self.x_m - self.x_o) < self.half_gap:
            return 0.0
        s = self.actuator.compliance.stiffness * dt**2 / self.actuator.transmission.output_inertia
        return s / (1 + s)


def simulate_monitor(actuator, faults, command, load, dt):
    """The monitor model from rest; arguments and answer as in the naive monitor model."""
    drive, control = actuator.drive, actuator.controller
    windings = Windings(actuator, faults)
    soft = actuator.compliance is not None
    regulator = None if actuator.current_loop is None else CurrentLoop(actuator, dt)
    # under a current loop the motor creeps before the output gives: its friction is dynamic
    moved = actuator if regulator is None else actuator.changed({"drive.hysteresis_band": 1e4})
    body = (CompliantMasses if soft else monitor.TwoMasses)(moved, faults)
    loop = SpeedLoop(actuator, faults, dt)
    current, start, gates = 0.0, 0.0, np.array([1, -1, 0])
    loops = np.zeros(3)
    rows = []
    for command_now, load_now in zip(command, load, strict=True):
        x_mid, w_mid = body.x_m + body.w_m * dt / 2, body.w_m + body.gained / 2
        kappa = windings.kappa(x_mid)
        emf = windings.emf(kappa, w_mid)
        before = np.concatenate([gates * current, loops])
        was = gates
        pole_pairs = actuator.motor.pole_pairs
        if regulator is None:
            gates = gates_of_step(pole_pairs * x_mid, pole_pairs * body.w_m * dt)
        else:
            gates = np.array(motor.gates(motor.sector(pole_pairs * x_mid), 1))
        # commutation by itself takes no voltage of a comparator, as if the pair had always had its
        # current; under a current loop the new phase brings none
        brought = current * (1 if regulator is None else abs(was)) * np.ones(3)

        def answer(i, gates=gates, before=before, emf=emf, kappa=kappa, brought=brought):
            """All currents, torque and voltage of the pair if its current became ``i``."""
            after = np.concatenate([gates * i, windings.loops(before, gates * i, emf, dt)])
            m, r = windings.matrices()
            # each phase of the pair has the current of the pair, for its share of the step
            own = m.diagonal()[:3] * (i - brought) / dt + r.diagonal()[:3] * (i + brought) / 2
            of_loops = m[:3, 3:] @ (after[3:] - before[3:]) / dt + r[:3, 3:] @ after[3:]
            volts = abs(gates) @ own + gates @ (of_loops + emf[:3])
            return after, windings.torque(kappa, after), volts

        _, torque_0, volts_0 = answer(0.0)
        _, torque_1, volts_1 = answer(1.0)
        j_m, j_o = actuator.motor.inertia, actuator.transmission.output_inertia
        share = body.carried(dt) if soft else float(body.touching())
        mobility = (1 - share) / j_m + share / (j_m + j_o)
        per_ampere = 0 if body.w_m == 0 else (torque_1 - torque_0) * mobility * dt / 2
        if loop.sampled or regulator is not None:
            wanted = loop.demand(command_now, body.x_o, body.w_m)
        else:
            g = control.speed_gain / actuator.motor.emf_constant * per_ampere
            free = loop.demand(command_now, body.x_o + body.w_o * dt / 2, w_mid)
            wanted = (free + g * current) / (1 + g)
        wanted = max(-drive.current_limit, min(drive.current_limit, wanted))
        # the voltage is a straight line over the current
        ends = [(v - volts_0) / (volts_1 - volts_0)
                for v in (-drive.supply_voltage, drive.supply_voltage)]  # fmt: skip
        beside = extra = 0.0
        asked = wanted
        if regulator is None:
            wanted = max(start + ends[0] - current, min(start + ends[1] - current, wanted))
        else:
            pair = windings.inductance * abs(gates)
            passed = current * (pair @ abs(was)) / pair.sum()
            speed_e = actuator.motor.pole_pairs * body.w_m
            since = since_commutation(actuator.motor.pole_pairs * x_mid, speed_e, dt)
            lost = actuator.current_loop.lost_voltage * max(-1.0, min(1.0, passed / 0.1))
            held = (regulator.voltage - lost - volts_0) / (volts_1 - volts_0)
            seen = (current if since < dt / 2 else passed) + (held - passed) / 2
            mean = regulator.voltage / 2 + regulator.answer(wanted, seen) / 2 - lost
            wanted = (mean - volts_0) / (volts_1 - volts_0)
            off = 1 - abs(gates)
            if (was != gates).any():
                regulator.leaving = float(off @ was) * current
            kappa_off = float(off @ np.array(kappa))
            left = regulator.run_out(kappa_off * w_mid)
            early = (0.5 - since / dt) * (current - passed)
            extra = kappa_off * left + float(gates @ np.array(kappa)) * early
            beside = early + left * kappa_off / actuator.motor.emf_constant
        after, torque, volts = answer(wanted)
        torque += extra
        before_all = np.concatenate([gates * current, loops])
        passive = cogging(x_mid, actuator)
        flat = gates @ np.array(kappa)
        jump, left = body.move(
            torque + passive - actuator.motor.viscous_damping * w_mid,
            windings.torque(kappa, before_all) + passive
            - actuator.motor.viscous_damping * body.w_m,
            flat, load_now, dt,
        )  # fmt: skip
        power = volts * wanted
        before_i, current, loops = current, wanted, after[3:]
        start = current
        if left > 0 and regulator is None and not loop.sampled:
            g = control.speed_gain / actuator.motor.emf_constant
            asked = max(-drive.current_limit, min(drive.current_limit, asked - g * jump))
            low, high = (end - before_i for end in ends)
            change = max(low * left, min(high * left, asked - wanted))
            start = wanted + change - (high if asked > wanted else low) / 2
            current = wanted + change * left / 2
            body.push((torque_1 - torque_0) * dt * change * left / 2)
        body.hold()
        rows.append((current + beside, current, body.x_m, body.w_m, body.x_o, body.w_o, power))
    return dict(zip(monitor.NAMES, np.array(rows).T, strict=True))
