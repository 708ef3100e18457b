"""Currents along a given motion, and an output that follows it, in plain Python.

Written from docs/models.md. Loops of `truer` answer, each phase is a line of the linear system of
`reference`; a modulated voltage stands across the pair by its mean.
"""

import math

import numpy as np

from . import mechanics, motor, reference, truer


def _waits(theta, speed, pole_pairs, dt):
    """The parts of a step before and after a commutation, s; one without."""
    place = pole_pairs * theta * 3 / math.pi - 0.5
    ahead = math.floor(place) + 1 - place if speed > 0 else place - math.ceil(place) + 1
    wait = ahead * math.pi / 3 / (pole_pairs * abs(speed)) + 1e-10  # so that it is over
    return [dt] if wait >= dt else [wait, dt - wait]


def currents(actuator, faults, command, motion, dt):
    """Mean phase currents (S, 3) of each step; command (S + 1,), motion (3, S + 1).

    All on the motor shaft. ``motion`` holds angle and speed of the motor and the angle of the
    output. A step in which the motor commutates is two, and straight lines lead from one to the
    next.
    """
    drive, pole_pairs = actuator.drive, actuator.motor.pole_pairs
    windings = truer.Windings(actuator, faults)
    speed_loop = truer.SpeedLoop(actuator, faults, dt)
    modulated = actuator.current_loop is not None
    current_loop = truer.CurrentLoop(actuator, dt) if modulated else None
    now, sign, rows = np.zeros(3), 1, []
    kappas = [np.array(windings.kappa(theta)) for theta in motion[0]]
    for n in range(len(command) - 1):
        charge, done = np.zeros(3), 0.0
        for wait in _waits(motion[0, n], motion[1, n], pole_pairs, dt):
            share = done / dt
            asked, theta, speed, output = (
                (1 - share) * x[n] + share * x[n + 1] for x in (command, *motion)
            )
            emf = ((1 - share) * kappas[n] + share * kappas[n + 1]) * speed
            pair = motor.gates(motor.sector(pole_pairs * theta), 1)
            limit = drive.current_limit
            if done == 0.0 or not speed_loop.sampled:
                demand = speed_loop.demand(asked, output, speed, theta)
            wanted = max(-limit, min(limit, demand))
            along = float(np.dot(pair, now))
            if modulated:
                if done == 0.0:
                    answer = current_loop.answer(wanted, along / 2)
                volts = answer - actuator.current_loop.lost_voltage * max(
                    -1, min(1, along / 2 / 0.1)
                )
            else:
                seen = math.copysign(max(abs(now)), along)
                if seen > wanted + drive.hysteresis_band / 2:
                    sign = -1
                elif seen < wanted - drive.hysteresis_band / 2:
                    sign = 1
                volts = sign * drive.supply_voltage
            for part, before, after, *_ in reference.parts_of_step(
                pair, volts, now, emf, windings.resistance, windings.inductance, drive, wait
            ):
                charge += part * (before + after) / 2
                now = after
            done += wait
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
        dynamic = mechanics.output_friction(speed, active, pushes, worn, gear)
        speed = mechanics.next_speed(
            speed, active, gear.output_inertia, gear.static_ratio * dynamic, dynamic, dt
        )
        angle += dt * speed
        found.append(angle)
    return np.array(found)


def masses(actuator, faults, currents, load, dt, every, seen, known, begin, shown, of_output):
    """Angles (2, S) of motor and output, and what was seen beside them (K, 2).

    ``currents`` are means of ``every`` steps ``dt``, of the phases (S, 3) or of the two that
    conduct (S, 1); ``seen`` rows of time (s), angle and jitter (s), ``known`` the turn up to which
    angles are known, the density of the acceleration's noise, and the share of what is no
    commutation in a sector; ``begin`` the angle at first and its standard deviation; ``shown``
    angles of the output by sample, of a standard deviation ``of_output``. A Kalman filter in
    matrices: state [angle, speed], white noise of the acceleration between what is seen, and speeds
    that the motor's damping makes less; in the gap motor and output have one each.
    """
    gear, windings = actuator.transmission, truer.Windings(actuator, faults)
    worn, half_gap = 1 + 2 * faults.friction, gear.backlash / 2 * (1 + 99 * faults.backlash)
    turn, density, others = known
    pairs = [(1, -1, 0), (1, 0, -1), (0, 1, -1), (-1, 1, 0), (-1, 0, 1), (0, -1, 1)]
    sector = math.radians(60.0) / actuator.motor.pole_pairs
    x_m, w_m, x_o, w_o = begin[0], 0.0, begin[0], 0.0
    covariance, last, waiting = np.diag([begin[1] ** 2, 0.0]), 0.0, list(seen)
    found, innovations = [(x_m, x_o)], []
    rested, corrected, comparator = 0.0, 0.0, not actuator.current_loop
    own = covariance

    def grown(covariance, span, inertia):
        slower = actuator.motor.viscous_damping / inertia * span
        moves = np.array([[1.0, span], [0.0, 1.0 - slower]])
        grows = density * np.array([[span**3 / 3, span**2 / 2], [span**2 / 2, span]])
        return moves @ covariance @ moves.T + grows

    for step in range(every * (len(currents) - 1)):
        sample, part = divmod(step, every)
        touch = abs(x_m - x_o) >= half_gap
        moved = actuator.motor.inertia + (gear.output_inertia if touch else 0.0)
        covariance = grown(covariance, step * dt - last, moved)
        own, last = grown(own, step * dt - last, math.inf), step * dt
        if part == 0 and sample in shown:
            if touch:
                own = covariance
            away, deviation = shown[sample] - x_o, math.sqrt(own[0, 0] + of_output**2)
            innovations.append((away, deviation))
            surprise = max(1.0, (away / (3 * deviation)) ** 2)
            own = own * surprise
            gain = own[:, 0] / (own[0, 0] + of_output**2)
            own = own - np.outer(gain, own[0])
            turns = gain[1] * away if w_o != 0 or surprise > 1 else 0.0
            x_o, w_o = x_o + gain[0] * away, w_o + turns
            if touch:
                x_m, w_m, covariance, corrected = x_m + gain[0] * away, w_m + turns, own, last
        share = (part + 0.5) / every
        pushes = load[sample] * (1 - share) + load[sample + 1] * share
        current, pair = currents[sample + 1], np.array(pairs[math.floor(x_m / sector - 0.5) % 6])
        made = float(np.dot(windings.kappa(x_m), current * pair if len(current) == 1 else current))
        # the comparator's current is half a band above and below its mean, but behind a loop
        band = actuator.drive.hysteresis_band if comparator else 0.0
        ripple = band / 2 * abs(float(np.dot(windings.kappa(x_m), pair)))
        contact = mechanics.contact_torque(
            x_m, w_m, x_o, w_o, half_gap, gear.contact_stiffness, gear.contact_damping
        )
        active = contact - pushes
        output = mechanics.output_friction(w_o, active, pushes, worn, gear)
        motor_friction = worn * actuator.motor.friction_torque
        w_m = mechanics.next_speed(
            w_m, made - actuator.motor.viscous_damping * w_m - contact, actuator.motor.inertia,
            max(motor_friction, gear.static_ratio * motor_friction - ripple), motor_friction, dt,
        )  # fmt: skip
        w_o = mechanics.next_speed(
            w_o, active, gear.output_inertia, gear.static_ratio * output, output, dt
        )
        x_m, x_o = x_m + dt * w_m, x_o + dt * w_o
        rested = (step + 1) * dt if w_m == 0 else rested
        while waiting and waiting[0][0] <= (step + 1) * dt:
            time, angle, jitter = waiting.pop(0)
            touch = abs(x_m - x_o) >= half_gap
            moved = actuator.motor.inertia + (gear.output_inertia if touch else 0.0)
            covariance = grown(covariance, time - last, moved)
            own, last = grown(own, time - last, math.inf), time
            began, corrected = corrected, time
            if comparator and rested >= began:  # its peaks end a rest by chance
                gained = 0.5 * w_m * np.array([time - rested, 1.0])
                covariance = covariance + np.diag(gained**2)
            away = math.remainder(angle - (x_m - ((step + 1) * dt - time) * w_m), turn)
            noise = 1e-4**2 + (jitter * w_m) ** 2
            deviation = math.sqrt(covariance[0, 0] + noise)
            seldom = others / sector
            dense = math.exp(-0.5 * (away / deviation) ** 2) / (math.sqrt(2 * math.pi) * deviation)
            peak = 1.0 / (math.sqrt(2 * math.pi) * deviation)
            # minus twice the logarithm of the likelihood, over that of an angle as expected
            far, probable = abs(away) / deviation, 1.0
            if seldom > 0.0:
                far = math.sqrt(2 * math.log((peak + seldom) / (dense + seldom)))
                probable = dense / (dense + seldom)
            spread = 1.0 / (math.sqrt(2 * math.pi) * (peak + seldom))
            innovations.append((math.copysign(far, away) * spread, spread))
            surprise = max(1.0, (away / (3 * deviation)) ** 2)
            covariance = covariance * surprise
            gain = probable * covariance[:, 0] / (covariance[0, 0] + noise)
            covariance = covariance - np.outer(gain, covariance[0])
            turns = gain[1] * away if w_m != 0 or surprise > 1 else 0.0
            x_m, w_m = x_m + gain[0] * away, w_m + turns
            if abs(x_m - x_o) >= half_gap:
                x_o, w_o = x_o + gain[0] * away, w_o + turns
        if part == every - 1:
            found.append((x_m, x_o))
    return np.array(found).T, np.array(innovations)
