"""A PMSM servo, slowly: coils with a full inductance matrix, complex vectors, plain Python.

Written from docs/pmsm.md and not from the kernels. The windings are four coils: the turns of the
faulty phase that are left, those that are shorted, and the two other phases. Their inductances
follow from the turns and from the magnetising inductances along d and q; nothing is transformed
into a rotor's frame, and no closed form of the loop is used.
"""

import cmath
import math

import numpy as np

from naive.mechanics import next_speed

PHASES = [2.0 * math.pi * n / 3.0 for n in range(3)]
ROOT_3 = math.sqrt(3.0)


class Coils:
    """The machine; ``p`` are its parameters by name, faults included.

    ``mu`` is the share of shorted turns of the phase ``shorted`` (0, 1, 2), ``contact`` the
    resistance of the short.
    """

    def __init__(self, p, mu=0.0, shorted=0, contact=1.0):
        self.p, self.mu, self.shorted, self.contact = p, mu, shorted, contact
        order = [shorted, shorted, *(n for n in range(3) if n != shorted)]
        self.phase = order
        self.share = np.array([1.0 - mu, mu, 1.0, 1.0])
        self.added = np.array([p["added"][n] for n in order])

    def inductances(self, theta_e):
        """(4, 4) matrix, H: main flux by the turns, leakage of each coil for itself."""
        p = self.p
        places = np.array([PHASES[n] for n in self.phase]) - theta_e
        d, q = self.share * np.cos(places), self.share * np.sin(places)
        main = (p["l_d"] - p["leakage"]) * np.outer(d, d)
        main += (p["l_q"] - p["leakage"]) * np.outer(q, q)
        return 2.0 / 3.0 * main + np.diag(self.share * p["leakage"])

    def emf_over_speed(self, theta_m):
        """(4,) V s/rad."""
        p, found = self.p, []
        for share, n in zip(self.share, self.phase, strict=True):
            angle = p["pole_pairs"] * theta_m - PHASES[n]
            shape = math.sin(angle)
            shape += p["h_5"] * math.sin(5.0 * angle) + p["h_7"] * math.sin(7.0 * angle)
            gap = 1.0 + p["static"] * math.cos(p["static_at"] - PHASES[n])
            gap += p["dynamic"] * math.cos(theta_m + p["dynamic_at"] - PHASES[n])
            found.append(-share * p["pole_pairs"] * p["flux"] * gap * shape)
        return np.array(found)

    def currents(self, x):
        """(4,) of the coils from those of the phases and of the short, x = (i_a, i_b, i_f)."""
        phases = [x[0], x[1], -x[0] - x[1]]
        found = np.array([phases[n] for n in self.phase])
        found[1] -= x[2]
        return found

    def change(self, x, theta_m, w_m, legs):
        """d/dt of (i_a, i_b, i_f), and the torque."""
        p, h = self.p, 1e-5
        theta_e = p["pole_pairs"] * theta_m
        slope = (self.inductances(theta_e + h) - self.inductances(theta_e - h)) / (2.0 * h)
        i = self.currents(x)
        k = self.emf_over_speed(theta_m)
        torque = float(k @ i + 0.5 * p["pole_pairs"] * i @ slope @ i)
        l = self.inductances(theta_e)
        resting = self.share * p["resistance"] * i + p["pole_pairs"] * w_m * slope @ i + k * w_m
        coil_of = np.array([self.currents(e) for e in np.eye(3)]).T  # currents of coils from x
        # rows: the three phases (voltage against the star point) and the loop; unknown d x, v_n
        phases = [x[0], x[1], -x[0] - x[1]]
        rows, right = [], []
        for n in range(3):
            own = [m for m in range(4) if self.phase[m] == n and (m != 1 or self.mu > 0.0)]
            rows.append([*(sum(l[m] for m in own) @ coil_of), 1.0])
            lost = p["added"][n] * phases[n]
            lost += p["v_leg"] * max(-1.0, min(1.0, phases[n] / p["knee"]))
            right.append(legs[n] - lost - sum(resting[m] for m in own))
        if self.mu > 0.0:
            rows.append([*(l[1] @ coil_of), 0.0])
            right.append(self.contact * x[2] - resting[1])
        else:
            rows.append([0.0, 0.0, 1.0, 0.0])
            right.append(0.0)
        return np.linalg.solve(np.array(rows), np.array(right))[:3], torque


class Drive:
    """The sampled loops, in complex numbers."""

    def __init__(self, s, theta=0.0):
        self.s, self.tick = s, 0
        self.w_ref = self.i_ref = self.speed_sum = self.w = 0.0
        self.theta_before = theta
        self.volts_sum = self.pending = 0j

    def __call__(self, command, theta_m, theta_o, i_a, i_b):
        """Readings in; what is logged (i, v, both complex d + j q) and the voltage to apply now."""
        s = self.s
        if self.tick % s["position_ticks"] == 0:
            wish = s["k_position"] * (command - theta_o)
            self.w_ref = max(-s["w_max"], min(s["w_max"], wish))
        if self.tick % s["speed_ticks"] == 0:
            time = s["speed_ticks"] * s["dt"]
            self.w = (theta_m - self.theta_before) / time
            self.theta_before = theta_m
            error = self.w_ref - self.w
            wish = s["k_speed"] * error + self.speed_sum
            most = s["i_max"] * s["set_torque"]
            torque = max(-most, min(most, wish))
            self.i_ref = torque / s["set_torque"]
            self.speed_sum += s["k_total"] * time * (error + (torque - wish) / s["k_speed"])
        self.tick += 1
        frame = cmath.exp(1j * s["pole_pairs"] * theta_m)
        phases = [i_a, i_b, -i_a - i_b]
        vector = 2.0 / 3.0 * sum(i * cmath.exp(1j * a) for i, a in zip(phases, PHASES, strict=True))
        i = vector / frame
        w_e = s["pole_pairs"] * self.w
        error = 1j * self.i_ref - i
        wish = s["k_current"] * error + self.volts_sum
        wish += 1j * w_e * (s["set_d"] * i.real + 1j * s["set_q"] * i.imag + s["set_flux"])
        most = s["v_supply"] / ROOT_3
        v = wish if abs(wish) <= most else wish / abs(wish) * most
        self.volts_sum += s["k_voltage"] * s["dt"] * (error + (v - wish) / s["k_current"])
        now, self.pending = self.pending, v * frame * cmath.exp(1.5j * s["dt"] * w_e)
        return i, v, now


def legs_of(vector):
    """Leg voltages of a vector, without the common part: the star point is free."""
    return [(vector * cmath.exp(-1j * a)).real for a in PHASES]


def at_terminals(p, legs, x):
    """The vector of the voltages that dead time and devices leave, of x = (i_a, i_b, i_f)."""
    left = [
        leg - p["v_leg"] * max(-1.0, min(1.0, i / p["knee"]))
        for leg, i in zip(legs, (x[0], x[1], -x[0] - x[1]), strict=True)
    ]
    return 2.0 / 3.0 * sum(v * cmath.exp(1j * a) for v, a in zip(left, PHASES, strict=True))


def run(coils, drive, m, command, load, steps):
    """The whole servo, tick by tick.

    Gives i and v as logged (complex), motor and output angle, speed, current of the short, and the
    voltage at the terminals (complex), the mean over the tick before.

    ``m`` are the parameters of mechanics and sensors, ``command`` and ``load`` values at the ticks.
    ``quanta`` are steps of the readings, 0 for perfect ones.
    Bristles (``bristles`` above 0) have the exact deflection at a held speed.
    """
    cold, warmer = coils.p["resistance"], 0.0
    z_m = z_o = 0.0
    x = np.zeros(3)
    w_m = th_m = w_o = th_o = 0.0
    dt = drive.s["dt"] / steps
    logged, seen = [], 0j
    for tick in range(len(command)):
        reading, out, i_a, i_b = (
            step * round(value / step) if step > 0.0 else value
            for value, step in zip(
                (
                    th_m + m["resolver"] / coils.p["pole_pairs"], th_o,
                    m["gain_a"] * x[0] + m["offset_a"], m["gain_b"] * x[1] + m["offset_b"],
                ),
                m["quanta"], strict=True,
            )
        )  # fmt: skip
        i, v, vector = drive(command[tick], reading, out, i_a, i_b)
        frame = cmath.exp(1j * coils.p["pole_pairs"] * reading)
        logged.append((i, v, reading, out, w_m, x[2], seen / frame))
        legs = legs_of(vector)
        seen = 0j  # the mean over this tick of the voltage at the terminals
        ahead = load[min(tick + 1, len(load) - 1)] - load[tick]
        for step in range(steps):
            # Heun's rule
            one, before = coils.change(x, th_m, w_m, legs)
            two, after = coils.change(x + dt * one, th_m + dt * w_m, w_m, legs)
            torque = 0.5 * (before + after)
            seen += 0.5 / steps * at_terminals(coils.p, legs, x)
            x = x + 0.5 * dt * (one + two)
            seen += 0.5 / steps * at_terminals(coils.p, legs, x)
            # speeds with the forces in the middle of a step (Stoermer and Verlet)
            th_m += 0.5 * dt * w_m
            th_o += 0.5 * dt * w_o
            twist = th_m - th_o
            spring = 0.0
            if abs(twist) > m["half_gap"]:
                edge = math.copysign(m["half_gap"], twist)
                spring = m["stiffness"] * (twist - edge) + m["damping"] * (w_m - w_o)
                if spring * twist < 0.0:
                    spring = 0.0  # it cannot pull
            act_m = torque - spring - m["viscous_m"] * w_m
            act_m -= m["cogging"] * math.sin(m["cogging_periods"] * th_m + m["cogging_phase"])
            act_o = spring - load[tick] - ahead * (step + 0.5) / steps - m["viscous_o"] * w_o

            def dry(t, w):
                return t * (1.0 + (m["static_ratio"] - 1.0) / (1.0 + (w / m["w_stribeck"]) ** 2))

            def bristles(z, w, level):
                decay = m["bristles"] * abs(w) / level
                bends = dt * w if decay == 0.0 else w / decay * (1.0 - math.exp(-decay * dt))
                after = z * math.exp(-decay * dt) + bends
                damping = m["bristle_damping"] / (1.0 + (w / m["w_stribeck"]) ** 2)
                return after, m["bristles"] * after + damping * (after - z) / dt

            if m["bristles"] > 0.0:
                z_m, held_m = bristles(z_m, w_m, dry(m["friction_m"], w_m))
                z_o, held_o = bristles(z_o, w_o, dry(m["friction_o"], w_o))
                w_m += dt * (act_m - held_m) / m["j_m"]
                w_o += dt * (act_o - held_o) / m["j_o"]
            else:
                w_m = next_speed(w_m, act_m, m["j_m"], m["static_ratio"] * m["friction_m"],
                                 dry(m["friction_m"], w_m), dt)  # fmt: skip
                w_o = next_speed(w_o, act_o, m["j_o"], m["static_ratio"] * m["friction_o"],
                                 dry(m["friction_o"], w_o), dt)  # fmt: skip
            loss = coils.p["resistance"] * (x[0] ** 2 + x[1] ** 2 + (x[0] + x[1]) ** 2)
            warmer += dt / m["time_constant"] * (m["thermal_resistance"] * loss - warmer)
            coils.p["resistance"] = cold * (1.0 + 0.00393 * warmer)
            th_m += 0.5 * dt * w_m
            th_o += 0.5 * dt * w_o
    return [np.array(column) for column in zip(*logged, strict=True)]


def settings(actuator):
    """What is set in the drive of an actuator, by name."""
    control = actuator.controller
    dt = control.current_time
    return {
        "dt": dt, "position_ticks": round(control.position_time / dt),
        "speed_ticks": round(control.speed_time / dt), "k_position": control.position_gain,
        "k_speed": control.speed_gain, "k_total": control.speed_integral,
        "k_current": control.current_gain, "k_voltage": control.current_integral,
        "w_max": control.speed_limit, "i_max": control.current_limit,
        "set_torque": control.torque_constant, "set_flux": control.flux,
        "set_d": control.inductance_d, "set_q": control.inductance_q,
        "pole_pairs": actuator.motor.pole_pairs, "v_supply": actuator.drive.supply_voltage,
    }  # fmt: skip


def servo(actuator, values, command, load, *, steps=4, perfect=True):
    """What the drive of an actuator logs, by name; the faults' laws are those of docs/pmsm.md.

    ``values`` are those of faults by name; ``command`` and ``load`` are at the ticks, on the motor
    shaft. A tick has ``steps``. Encoders and converters that are not ``perfect`` have theirs.
    """
    a, k, bristles, heat = actuator, values, actuator.presliding, actuator.winding_heat
    motor, gear, drive, control = a.motor, a.transmission, a.drive, a.controller
    shorts = [k[f"short_{x}"] for x in "abc"]
    shorted = int(np.argmax(shorts))
    share = 0.3 * math.sqrt(shorts[shorted])
    machine = {
        "l_d": motor.inductance_d, "l_q": motor.inductance_q, "leakage": motor.leakage,
        "resistance": motor.resistance, "pole_pairs": motor.pole_pairs,
        "flux": motor.flux * (1.0 - 0.5 * k["demagnetisation"]),
        "h_5": motor.harmonic_5, "h_7": motor.harmonic_7,
        "static": motor.gap_share * k["static_eccentricity"],
        "static_at": 2.0 * math.pi * (k["static_direction"] - 0.5),
        "dynamic": motor.gap_share * k["dynamic_eccentricity"],
        "dynamic_at": 2.0 * math.pi * (k["dynamic_direction"] - 0.5),
        "added": [3.0 * motor.resistance * k[f"connector_{x}"] for x in "abc"],
        "v_leg": drive.supply_voltage * drive.dead_time / control.current_time + drive.device_drop,
        "knee": drive.knee_current,
    }  # fmt: skip
    worn = 1.0 + 2.0 * k["friction"]
    rest = {
        "resolver": math.radians(20.0) * (k["resolver_offset"] - 0.5),
        "gain_a": 0.8 + 0.4 * k["sensor_gain_a"], "gain_b": 0.8 + 0.4 * k["sensor_gain_b"],
        "offset_a": 0.1 * control.current_limit * (k["sensor_offset_a"] - 0.5),
        "offset_b": 0.1 * control.current_limit * (k["sensor_offset_b"] - 0.5),
        "half_gap": 0.5 * gear.backlash * (1.0 + 9.0 * k["backlash"]),
        "stiffness": gear.stiffness, "damping": gear.damping, "j_m": motor.inertia,
        "j_o": gear.output_inertia, "viscous_m": motor.viscous_damping,
        "viscous_o": gear.viscous_damping, "friction_m": worn * motor.friction_torque,
        "friction_o": worn * gear.friction_torque, "static_ratio": gear.static_ratio,
        "w_stribeck": gear.stribeck_speed, "cogging": motor.cogging_torque,
        "cogging_periods": motor.cogging_periods, "cogging_phase": motor.cogging_phase,
        "bristles": 0.0 if bristles is None else bristles.motor_stiffness,
        "bristle_damping": 0.0 if bristles is None else bristles.damping,
        "thermal_resistance": 0.0 if heat is None else heat.thermal_resistance,
        "time_constant": 1.0 if heat is None else heat.time_constant,
    }  # fmt: skip
    coarse = 0.0 if perfect else 1.0
    of_current = coarse * 2.0 * drive.current_range / 2**drive.current_bits
    rest["quanta"] = (
        coarse * 2.0 * math.pi / drive.motor_steps,
        coarse * 2.0 * math.pi / drive.output_steps * gear.ratio, of_current, of_current,
    )  # fmt: skip
    loops = settings(a)
    loops["k_position"] *= 0.5 + k["gain"]
    start = rest["resolver"] / motor.pole_pairs
    coils = Coils(machine, share, shorted, motor.short_resistance)
    i, v, theta_m, theta_o, w_m, i_f, at_terminals = run(
        coils, Drive(loops, start), rest, command, load, steps
    )
    return {
        "current_q": i.imag, "current_d": i.real, "voltage_q": v.imag, "voltage_d": v.real,
        "motor_speed": w_m, "motor_position": theta_m, "output_position": theta_o,
        "loop": share * i_f, "terminal_d": at_terminals.real, "terminal_q": at_terminals.imag,
    }  # fmt: skip
