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


def next_speed_through_rest(speed, body, dt, from_rest=None):
    """Like `next_speed`, where a step may be long: a mass that stops or breaks loose within it.

    A mass that would reverse comes to rest, and what is left of the step decides whether it goes
    on the other way. A mass at rest that breaks loose has done so when its torque, growing evenly
    from the middle of the last step to the middle of this one, passed the static torque. ``body``
    is as in `two_masses_rigid_contact`; ``from_rest``, if it is not the same, what moves on from
    rest. Gives the speed, the share of the step until rest, or None, and the acceleration with
    which it goes on.
    """
    act, inertia, dynamic = body["act"], body["j"], body["td"]
    later = body if from_rest is None else from_rest

    starting = 0.0
    if abs(later["act"]) > later["ts"]:
        starting = (later["act"] - later["td"] * sign(later["act"])) / later["j"]

    if speed == 0:
        grown = (later["act"] - later["before"]) * sign(later["act"])
        since = (abs(later["act"]) - later["ts"]) / grown if grown > 0 else 0.5
        return starting * dt * max(0.5, min(1.5, 0.5 + since)), None, starting
    moving = (act - dynamic * sign(speed)) / inertia
    after = speed + moving * dt
    if sign(speed) * sign(after) != -1:
        return after, None, moving
    until_rest = speed / (speed - after)
    return starting * dt * (1 - until_rest), until_rest, starting


def loaded_dynamic_torque(direction, load_torque, unloaded, efficiency_opposing, efficiency_aiding):
    """T + (1/eta_o - 1)|T_load| against an opposing load, T + (1 - eta_a)|T_load| with an aiding.

    ``load_torque`` acts in the positive direction.
    """
    if load_torque * direction < 0:
        return unloaded + (1 / efficiency_opposing - 1) * abs(load_torque)
    return unloaded + (1 - efficiency_aiding) * abs(load_torque)


def output_friction(speed, push, load, worn, gear):
    """Dynamic torque on the output of a worn gear; at rest ``push`` has the sign of the motion."""
    return worn * loaded_dynamic_torque(
        speed if speed != 0 else push, -load, gear.friction_torque,
        gear.efficiency_opposing, gear.efficiency_aiding,
    )  # fmt: skip


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

    A mass is ``{"x": position, "w": speed, "act": torque, "before": torque of the last step,
    "j": inertia, "ts": , "td": }``; positions move with the mean of the speeds before and after.
    Gives positions and speeds ``x_m, w_m, x_o, w_o``, the acceleration of the motor at the end,
    what an impact did to its speed, and the share of the step that was left after it, or 0.
    """
    bodies = (motor, output)
    speeds = [
        next_speed(body["w"], body["act"], body["j"], body["ts"], body["td"], dt) for body in bodies
    ]
    positions = [
        body["x"] + dt * (body["w"] + w) / 2 for body, w in zip(bodies, speeds, strict=True)
    ]
    overlap = abs(positions[0] - positions[1]) - half_gap
    touch = abs(abs(motor["x"] - output["x"]) - half_gap) < 1e-12
    if overlap <= 0 and not (touch and speeds == [0, 0]):
        # the motor once more, with what happens to it within the step
        w_m, _, gains = next_speed_through_rest(motor["w"], motor, dt)
        x_m = motor["x"] + dt * (motor["w"] + w_m) / 2
        return x_m, w_m, play(x_m, positions[1], half_gap), speeds[1], gains, 0.0, 0.0
    # They meet when the gap, closing evenly, is closed.
    side = 1 if positions[0] > positions[1] else -1
    left_of_gap = max(0.0, half_gap - side * (motor["x"] - output["x"]))
    hits = left_of_gap >= 1e-12
    met = left_of_gap / (left_of_gap + overlap) if hits else 0.0
    w_m, w_o = (body["w"] + met * (w - body["w"]) for body, w in zip(bodies, speeds, strict=True))
    x_met = motor["x"] + met * dt * (motor["w"] + w_m) / 2
    # From then on they are one body, with the momentum and all torques of both.
    total = {name: motor[name] + output[name] for name in ("act", "before", "j", "ts", "td")}
    common = (motor["j"] * w_m + output["j"] * w_o) / total["j"]
    jump = common - w_m
    left = (1 - met) * dt
    pushing = side * common > 0
    # once at rest, a motor that turns back from the face it pushed leaves the output behind
    after, until_rest, gains = next_speed_through_rest(
        common, total, left, motor if pushing else total
    )
    x_m = x_met + left * (common + after) / 2
    x_o, w_o = x_m - side * half_gap, after
    if pushing and until_rest is not None:
        x_o = play(x_m, x_met - side * half_gap + left * until_rest * common / 2, half_gap)
        w_o = 0.0
    return x_m, after, x_o, w_o, gains, jump, 1 - met if hits else 0.0


def end_stop(position, speed, low, high):
    """A mass that has reached a stop stays there until it moves away from it."""
    if position <= low:
        return low, max(speed, 0.0)
    if position >= high:
        return high, min(speed, 0.0)
    return position, speed
