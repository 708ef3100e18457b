"""The twin of a position servo.

docs/position-servo.md has the equations and their sources. All on the output shaft: a torque of the
motor times the gear ratio, its inertia times the ratio squared.

Viscous friction is not apart from the back-EMF where the supply is constant, and belongs to it
here. The play is the rigid, inelastic contact of `ematwin.numerics.backlash`. A controller that
samples every T_c and holds its duty acts on the position of T_c/2 ago in the mean (Astrom and
Wittenmark 1997, Computer-Controlled Systems); over so short a time the output moves on a straight
line.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.position_servo.parameters import PositionServo
from ematwin.models.stepped import Stepped
from ematwin.numerics.compile import loop, part
from ematwin.numerics.friction import advance_mobile
from ematwin.numerics.lanes import columns
from ematwin.numerics.scalar import clip, sincos

GRAVITY = 9.80665  # m/s^2
ENCODER_STEP = 2.0 * math.pi / 4096.0  # rad


class Constants(NamedTuple):
    """Constants of the equations, on the output shaft."""

    gain: float  # 1/rad
    startup: float  # duty
    delay: float  # s
    speed_limit: float  # rad/s
    late: float  # s, age of the position that the controller acts on
    offset: float  # rad
    stall_torque: float  # N m, without saturation
    back_emf: float  # N m s/rad
    saturation: float  # N m, torque that it never exceeds
    inertia: float  # kg m^2
    half_gap: float  # rad
    coulomb: float  # N m
    stribeck: float  # N m
    stribeck_speed: float  # rad/s
    load_share: float
    static_share: float
    gravity: float  # N m at a horizontal arm
    load_inertia: float  # kg m^2
    load_torque: float  # N m against positive motion


_, constants_of, _ = columns(Constants)


class State(NamedTuple):
    """State of one candidate."""

    target: float  # rad
    theta_m: float  # rad, motor and gear, on the output
    w_m: float  # rad/s
    theta: float  # rad, output
    w: float  # rad/s
    side: float  # of the play on which they touch: 1 the motor pushes forward, -1 back, 0 apart


@part
def friction(w, load, c):
    """Dry friction of motor and gear at a speed, N m."""
    fading = 1.0 / (1.0 + (w / c.stribeck_speed) * (w / c.stribeck_speed))
    sliding = c.coulomb + c.load_share * abs(load)
    return sliding + fading * (c.stribeck + c.static_share * abs(load))


@part
def duty_of(target, theta, w, c):
    """Pulse width that the controller asks for, -1 to 1."""
    error = target - (theta - c.late * w) - c.offset
    # the sign is smoothed over a step of the encoder: in a jump the duty would chatter at the goal
    startup = c.startup * clip(error / ENCODER_STEP, -1.0, 1.0)
    return clip(c.gain * error + startup, -1.0, 1.0)


@part
def followed(target, goal, most):
    """Target after a time in which it moves by ``most`` or less, and its mean over that time."""
    away = goal - target
    move = clip(away, -most, most)
    busy = clip(abs(away) / (most + 1e-12), 0.0, 1.0)  # share of the time in which it moves
    return target + move, target + move - 0.5 * busy * move


@part
def servo_step(now, before, after, share, supply, c, dt):
    """Advance by ``dt``; ``supply`` is that voltage over the rated one, 0 where released.

    The goal is ``before``, and ``after`` for the last ``share`` of the step.
    """
    most = c.speed_limit * dt
    between, first = followed(now.target, before, (1.0 - share) * most)
    target, last = followed(between, after, share * most)
    follows = first + share * (last - first)
    middle = now.theta + 0.5 * dt * now.w  # torques act in the middle of the step
    load = c.gravity * sincos(middle)[0] + c.load_torque
    linear = c.stall_torque * duty_of(follows, middle, now.w, c) * supply
    back_emf = c.back_emf if supply > 0.0 else 0.0
    linear -= back_emf * now.w_m
    left = 1.0 / math.sqrt(1.0 + (linear / c.saturation) * (linear / c.saturation))
    act, back_emf = left * linear, left * back_emf
    # the trapezoidal rule for the back-EMF: stable however long the step
    inertia = c.inertia + 0.5 * dt * back_emf
    dry = friction(now.w_m, load, c)
    if now.side != 0.0:
        w = advance_mobile(now.w, act - load, 1.0 / (inertia + c.load_inertia), dry, dry, dt)
        contact = c.load_inertia * (w - now.w) / dt + load
        # faces push and never pull; without play there is no other face to go to
        if now.side * contact >= 0.0 or c.half_gap == 0.0:
            theta = now.theta + 0.5 * dt * (now.w + w)
            return State(target, theta + now.side * c.half_gap, w, theta, w, now.side)
    w_m = advance_mobile(now.w_m, act, 1.0 / inertia, dry, dry, dt)
    w = now.w - dt * load / c.load_inertia
    theta_m = now.theta_m + 0.5 * dt * (now.w_m + w_m)
    theta = now.theta + 0.5 * dt * (now.w + w)
    twist = theta_m - theta
    if abs(twist) < c.half_gap:
        return State(target, theta_m, w_m, theta, w, 0.0)
    # an inelastic impact on the other face, or back on the same one
    side = math.copysign(1.0, twist)
    w = (inertia * w_m + c.load_inertia * w) / (inertia + c.load_inertia)
    return State(target, theta + side * c.half_gap, w, theta, w, side)


@part
def delayed(goal, sample, delay, step):
    """Goals before and after a step, each held until the next, and the share of the step after.

    ``sample`` is the end of the step; ``delay`` and ``step`` are in samples.
    """
    at = max(sample - delay, 0.0)
    n = min(int(at), goal.size - 1)
    return goal[max(n - 1, 0)], goal[n], min((at - n) / step, 1.0)


@part
def at_rest(goal, start, c):
    """`State` at rest at ``start``, rad, on the face that its load pushes it to."""
    side = math.copysign(1.0, c.gravity * math.sin(start) + c.load_torque)
    return State(goal, start + side * c.half_gap, 0.0, start, 0.0, side)


@loop
def traces(constants, goal, supply, start, interval, substeps):
    """Positions of the output (B, S), rad; NaN for a candidate with a constant that is not finite.

    Parameters
    ----------
    constants : (19, B) array, the fields of `Constants`
    goal, supply : (S,) arrays, rad, and voltage over the rated one; 0 where released
    start : rad at the first sample, at which it rests
    interval, substeps : s, and steps, from one sample to the next
    """
    count, samples = constants.shape[1], goal.size
    position = np.full((count, samples), start)
    dt = interval / substeps
    for n in range(count):
        c = constants_of(constants, n)
        nothing = 0.0
        for value in c:
            nothing += 0.0 * value  # a NaN anywhere must show: comparisons with it are false
        delay = c.delay / interval
        now = at_rest(goal[0], start, c)
        position[n, 0] = start + nothing
        for sample in range(1, samples):
            for j in range(substeps):
                at = sample - 1 + (j + 1) / substeps
                before, after, share = delayed(goal, at, delay, 1.0 / substeps)
                now = servo_step(now, before, after, share, supply[sample - 1], c, dt)
            position[n, sample] = now.theta + nothing
    return position


def servo_constants(actuator: Any, values: Mapping[str, Any]) -> Constants:
    """Constants of the equations in docs/position-servo.md, numbers or (B,) arrays.

    ``values`` are of unknowns by name, healthy if not named.
    """
    controller, motor, friction = actuator.controller, actuator.motor, actuator.friction
    arm = actuator.arm
    payload, rubs, weak = (values.get(name, 1.0) for name in ("payload", "friction", "torque"))
    torque = motor.stall_torque * weak
    return Constants(
        gain=controller.gain * values.get("gain", 1.0),
        startup=controller.startup,
        delay=controller.delay * values.get("delay", 1.0),
        speed_limit=controller.speed_limit,
        late=0.5 * controller.interval,
        offset=values.get("offset", 0.0),
        stall_torque=torque,
        back_emf=torque / motor.no_load_speed * weak,
        saturation=motor.saturation_torque * weak,
        inertia=actuator.gear.inertia,
        half_gap=0.5 * actuator.gear.backlash * values.get("backlash", 1.0),
        coulomb=friction.coulomb * rubs,
        stribeck=friction.stribeck * rubs,
        stribeck_speed=friction.stribeck_speed,
        load_share=friction.load_share * rubs,
        static_share=friction.static_share * rubs,
        gravity=payload * (arm.mass + 0.5 * arm.arm_mass) * GRAVITY * arm.length,
        load_inertia=payload * ((arm.mass + arm.arm_mass / 3.0) * arm.length**2 + arm.inertia),
        load_torque=payload * arm.torque,
    )


def stepped(actuator: PositionServo, most_delay: float, interval: float) -> Stepped:
    """The servo sample by sample, from rest at its first goal, at the rated supply.

    Behind `State` stand the steps done and the goals of the last ones, as far back as
    ``most_delay`` times the healthy delay reaches.
    """
    substeps = actuator.steps.within(interval)
    dt = interval / substeps
    kept = math.ceil(most_delay * actuator.controller.delay / dt) + 2
    _, state_of, write_state = columns(State)
    done = len(State._fields)
    goals = done + 1
    fixed = ("controller.delay",)  # the goals that are kept reach so far back

    def constants(candidates: Mapping[str, Any]) -> Constants:
        return servo_constants(actuator.varied(candidates, fixed), candidates)

    @part
    def begin(c, u, x):
        write_state(x, 0, at_rest(u[0, 0], u[0, 0], constants_of(c, 0)))
        x[done, 0] = 0.0
        x[goals:, 0] = u[0, 0]

    @part
    def sample(c, x, u, n, y):
        y[0, 0] = x[3, 0]

    @part
    def advance(c, x, u):
        own = constants_of(c, 0)
        last = int(x[done, 0])
        end = x[done, 0] + 1.0
        x[done, 0] = end
        goal = u[0, 0] if last % substeps == 0 else x[goals + last % kept, 0]
        x[goals + int(end) % kept, 0] = goal
        at = max(end - own.delay / dt, 0.0)
        n = min(int(at), int(end) - 1)
        before, after = x[goals + n % kept, 0], x[goals + (n + 1) % kept, 0]
        write_state(x, 0, servo_step(state_of(x, 0), before, after, at - n, 1.0, own, dt))

    return Stepped(
        inputs=("goal_position",), outputs=("position",), constants=constants, begin=begin,
        sample=sample, advance=advance, interval=interval, substeps=substeps, at=(0.0,),
        constant_count=len(Constants._fields), state_count=goals + kept, fixed=fixed,
    )  # fmt: skip
