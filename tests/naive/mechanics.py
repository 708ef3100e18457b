"""Dry friction, backlash and end stops, slowly, as the papers say it and not as the kernels do.

Borello and Dalla Vedova (2012), Int. J. Mechanics and Control 13(2), 37-48, for the friction.
"""


def sign(x):
    return int(x > 0) - int(x < 0)


def friction_torque(speed, active_torque, static_torque, dynamic_torque):
    """Torque of dry friction on a mass, positive where it opposes positive motion."""
    if speed == 0:
        if abs(active_torque) <= static_torque:
            return active_torque  # it sticks: friction answers whatever acts
        return static_torque * sign(active_torque)  # it breaks loose
    return dynamic_torque * sign(speed)


def next_speed(speed, active_torque, inertia, static_torque, dynamic_torque, dt):
    """Euler step of J dw/dt = T_active - T_friction, stopped where it would reverse."""
    friction = friction_torque(speed, active_torque, static_torque, dynamic_torque)
    after = speed + (active_torque - friction) / inertia * dt
    if sign(speed) * sign(after) == -1:
        return 0.0
    return after


def loaded_dynamic_torque(direction, load_torque, unloaded, efficiency_opposing, efficiency_aiding):
    """T + (1/eta_o - 1)|T_load| against an opposing load, T + (1 - eta_a)|T_load| with an aiding.

    ``load_torque`` acts in the positive direction.
    """
    if load_torque * direction < 0:
        return unloaded + (1 / efficiency_opposing - 1) * abs(load_torque)
    return unloaded + (1 - efficiency_aiding) * abs(load_torque)


def play(motor, output, half_gap):
    """Output of a rigid gear with play: it moves only where the gap pushes it."""
    if motor - output > half_gap:
        return motor - half_gap
    if output - motor > half_gap:
        return motor + half_gap
    return output


def contact_torque(motor, motor_speed, output, output_speed, half_gap, stiffness, damping):
    """Spring and damper on the faces of the gap; a face pushes and never pulls."""
    twist = motor - output
    if twist > half_gap:
        torque = stiffness * (twist - half_gap) + damping * (motor_speed - output_speed)
        return torque if torque > 0 else 0.0
    if twist < -half_gap:
        torque = stiffness * (twist + half_gap) + damping * (motor_speed - output_speed)
        return torque if torque < 0 else 0.0
    return 0.0


def two_masses_rigid_contact(motor, output, half_gap, dt):
    """Two masses with play, for one step; each is a dict of what is known of it.

    A mass is ``{"x": position, "w": speed, "act": torque, "j": inertia, "ts": , "td": }``.
    Gives positions and speeds ``x_m, w_m, x_o, w_o``.
    """
    speeds = [
        next_speed(body["w"], body["act"], body["j"], body["ts"], body["td"], dt)
        for body in (motor, output)
    ]
    positions = [body["x"] + dt * w for body, w in zip((motor, output), speeds, strict=True)]
    overlap = abs(positions[0] - positions[1]) - half_gap
    if overlap <= 0:
        return positions[0], speeds[0], positions[1], speeds[1]
    # They are one body now, with the momentum and all torques of both.
    total = {name: motor[name] + output[name] for name in ("act", "j", "ts", "td")}
    common = (motor["j"] * motor["w"] + output["j"] * output["w"]) / total["j"]
    after = next_speed(common, total["act"], total["j"], total["ts"], total["td"], dt)
    x_m = motor["x"] + dt * after
    side = 1 if positions[0] > positions[1] else -1
    return x_m, after, x_m - side * half_gap, after


def end_stop(position, speed, low, high):
    """A mass that has reached a stop stays there until it moves away from it."""
    if position <= low:
        return low, max(speed, 0.0)
    if position >= high:
        return high, min(speed, 0.0)
    return position, speed
