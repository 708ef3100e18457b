"""The reference model as a readable loop: three phases by a linear system, two masses.

Independent of the kernels: the star point and the slopes of the currents come together from a
matrix, the bridge is told by which leg conducts where. The integration rule is that of the model
(currents by explicit Euler, mechanics semi-implicit), so that both must agree step by step.
"""

import numpy as np

from . import mechanics, motor


def leg_voltages(gates, across, currents, emf, resistances, inductances, drive):
    """Terminal voltage of each leg, or None where it carries no current.

    ``across`` is the voltage between the two driven legs.
    """
    voltages = [None, None, None]
    for leg in range(3):
        if gates[leg] != 0:
            voltages[leg] = (drive.supply_voltage + gates[leg] * across) / 2
        elif currents[leg] > 0:  # the lower diode carries a current into the motor
            voltages[leg] = -drive.diode_drop
        elif currents[leg] < 0:
            voltages[leg] = drive.supply_voltage + drive.diode_drop
    for leg in range(3):
        if voltages[leg] is None:
            _, star = slopes(voltages, currents, emf, resistances, inductances)
            terminal = star + emf[leg]
            if terminal < -drive.diode_drop:
                voltages[leg] = -drive.diode_drop
            elif terminal > drive.supply_voltage + drive.diode_drop:
                voltages[leg] = drive.supply_voltage + drive.diode_drop
    return voltages


def slopes(voltages, currents, emf, resistances, inductances):
    """Slopes of the phase currents and voltage of the star point, from four equations."""
    matrix, right = np.zeros((4, 4)), np.zeros(4)
    for k in range(3):
        if voltages[k] is None:
            matrix[k, k] = 1.0  # di/dt = 0
        else:
            matrix[k, k] = inductances[k]
            matrix[k, 3] = 1.0
            right[k] = voltages[k] - resistances[k] * currents[k] - emf[k]
    matrix[3, :3] = 1.0
    solution = np.linalg.solve(matrix, right)
    return solution[:3], solution[3]


def parts_of_step(gates, across, currents, emf, resistances, inductances, drive, dt):
    """Parts of a step: each goes to its end, or until the diode of an off leg blocks.

    Yields the length of each (s), currents before and after it, voltages of legs and star point.
    """
    left = dt
    while left > 0:
        voltages = leg_voltages(gates, across, currents, emf, resistances, inductances, drive)
        slope, star = slopes(voltages, currents, emf, resistances, inductances)
        ends = currents + left * slope
        blocked = [k for k in range(3) if gates[k] == 0 and currents[k] * ends[k] < 0]
        part = -currents[blocked[0]] / slope[blocked[0]] if blocked else left
        after = currents + part * slope
        after[blocked] = 0.0
        yield part, currents, after, voltages, star
        currents, left = after, left - part if blocked else 0


def simulate(actuator, faults, command, load, dt):
    """Simulate from rest; command (rad) and load (N m) on the motor shaft, one for each step.

    Returns
    -------
    dict of arrays: mean_currents and mean_voltages (S, 3) and bus_current of each step; motor,
    motor_speed, output, output_speed after it
    """
    drive, gear = actuator.drive, actuator.transmission
    h = motor.turns_left(faults)
    resistances = [x * actuator.motor.resistance / 2 for x in h]
    inductances = [motor.inductance(x, actuator) for x in h]
    worn = 1 + 2 * faults.friction
    half_gap = gear.backlash / 2 * (1 + 99 * faults.backlash)
    low, high = gear.travel_low * gear.ratio, gear.travel_high * gear.ratio
    currents = np.zeros(3)
    x_m = w_m = x_o = w_o = 0.0
    sign = 1
    names = ("mean_currents", "mean_voltages", "bus_current", "motor", "motor_speed", "output",
             "output_speed")  # fmt: skip
    rows = []
    for command_now, load_now in zip(command, load, strict=True):
        kappa = motor.kappa(x_m, faults, actuator)
        sector = motor.sector(actuator.motor.pole_pairs * x_m)
        wanted = motor.current_reference(command_now, x_o, w_m, faults, actuator)
        pair = motor.gates(sector, 1)
        along = sum(g * i for g, i in zip(pair, currents, strict=True))
        seen = max(abs(i) for i in currents) * (1 if along >= 0 else -1)
        if seen > wanted + drive.hysteresis_band / 2:
            sign = -1
        elif seen < wanted - drive.hysteresis_band / 2:
            sign = 1
        gates = motor.gates(sector, sign)

        emf = [k * w_m for k in kappa]
        charge, flux, drawn = np.zeros(3), np.zeros(3), 0.0
        for part, before, after, voltages, star in parts_of_step(
            gates, drive.supply_voltage, currents, emf, resistances, inductances, drive, dt
        ):
            charge += part * (before + after) / 2
            # an open terminal shows the star point and the EMF of its phase
            seen_volts = [star + e if v is None else v for v, e in zip(voltages, emf, strict=True)]
            flux += part * np.array(seen_volts)
            upper = [v is not None and v >= drive.supply_voltage for v in voltages]
            drawn += part * sum((before + after)[upper]) / 2
        currents = after
        mean = charge / dt
        torque = sum(k * i for k, i in zip(kappa, mean, strict=True))

        contact = mechanics.contact_torque(
            x_m, w_m, x_o, w_o, half_gap, gear.contact_stiffness, gear.contact_damping
        )
        act_m = torque - actuator.motor.viscous_damping * w_m - contact
        act_o = contact - load_now
        dynamic_m = worn * actuator.motor.friction_torque
        dynamic_o = mechanics.output_friction(w_o, act_o, load_now, worn, gear)
        w_m = mechanics.next_speed(
            w_m, act_m, actuator.motor.inertia, gear.static_ratio * dynamic_m, dynamic_m, dt
        )
        w_o = mechanics.next_speed(
            w_o, act_o, gear.output_inertia, gear.static_ratio * dynamic_o, dynamic_o, dt
        )
        x_m += dt * w_m
        x_o, w_o = mechanics.end_stop(x_o + dt * w_o, w_o, low, high)
        rows.append((mean, flux / dt, drawn / dt, x_m, w_m, x_o, w_o))
    columns = zip(*rows, strict=True)
    return {name: np.array(column) for name, column in zip(names, columns, strict=True)}
