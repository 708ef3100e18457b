"""The linear axis as a readable loop in plain Python, with an explicit rule and a short step.

Written from the table of docs/linear-axis.md: friction is a function of speed and direction, and
the controller is the three lines that the authors of EMPS publish.
"""


def direction(speed, push):
    """+1 forward, -1 backward: of the motion, or at rest of the force that would begin it."""
    return 1 if (speed if speed != 0 else push) > 0 else -1


def friction(speed, way, axis):
    """Friction force of a direction, N, against that direction."""
    f = axis.friction
    half = 1 if way < 0 else -1  # the ratio is backward over forward
    coulomb = f.coulomb * f.coulomb_ratio ** (half / 2)
    viscous = f.viscous * f.viscous_ratio ** (half / 2)
    near_rest = 1 / (1 + (speed / f.fading_speed) ** 2)
    dry = coulomb * (1 - near_rest) + f.standstill_ratio * coulomb * near_rest
    return dry + viscous * abs(speed)


def simulate(axis, reference, pulses, position, speed, voltage, step, *, recorded=None):
    """Voltage (V) and position (m) at the samples, as lists.

    ``position``, ``speed`` and ``voltage`` are those of the first sample, the voltage being what
    the force follows. ``recorded`` voltages drive in place of the controller.
    """
    control, drive = axis.controller, axis.drive
    interval = control.sample_time
    count = round(interval / step)
    previous, before = position - speed * interval, position - 2 * speed * interval
    voltages, positions = [], []
    for n in range(len(reference)):
        filtered, filtered_before = (position + previous) / 2, (previous + before) / 2
        demand = control.position_gain * (reference[n] - position)
        output = control.velocity_gain * (demand - (filtered - filtered_before) / interval)
        output = max(min(output + pulses[n], drive.voltage_limit), -drive.voltage_limit)
        output = output if recorded is None else recorded[n]
        voltages.append(output)
        positions.append(position)
        previous, before = position, previous
        for _ in range(count):
            voltage += step / drive.response_time * (output - voltage)
            push = drive.gain * voltage - drive.offset
            way = direction(speed, push)
            left = push - way * friction(speed, way, axis)
            if speed == 0 and left * way <= 0:
                continue  # friction holds it
            faster = speed + step * left / axis.carriage.mass
            if speed * faster < 0:
                faster = 0.0
            position += step * faster
            speed = faster
    return voltages, positions
