"""The twin of a position servo: its constants, and the servo sample by sample."""

import math
from collections.abc import Mapping
from typing import Any

from ematwin.models.position_servo.parameters import PositionServo
from ematwin.models.position_servo.step import GRAVITY, Constants, State, constants_of, servo_step
from ematwin.models.stepped import Stepped
from ematwin.numerics.compile import part
from ematwin.numerics.lanes import columns


def servo_constants(
    actuator: Any, values: Mapping[str, Any], stated: Mapping[str, float] | None = None
) -> Constants:
    """Constants of the equations in `ematwin.models.position_servo.step`, numbers or (B,) arrays.

    ``values`` are of unknowns by name, healthy if not named; ``stated`` are parameters of the arm
    that a recording states.
    """
    controller, motor, friction = actuator.controller, actuator.motor, actuator.friction
    arm = actuator.arm
    given = {"mass": arm.mass, "length": arm.length, "arm_mass": arm.arm_mass, **(stated or {})}
    mass, length, arm_mass = given["mass"], given["length"], given["arm_mass"]
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
        gravity=payload * (mass + 0.5 * arm_mass) * GRAVITY * length,
        load_inertia=payload * ((mass + arm_mass / 3.0) * length**2 + arm.inertia),
        load_torque=payload * arm.torque,
    )


def stepped(actuator: PositionServo, most_delay: float, interval: float) -> Stepped:
    """The servo sample by sample, from rest at its first goal, at the rated supply.

    Behind the fields of `State` stand the steps done and the goals of the last ones, as far back
    as ``most_delay`` times the healthy delay reaches. A goal is taken at each sample and held.
    """
    substeps = math.ceil(interval / actuator.steps.twin - 1e-9)
    dt = interval / substeps
    kept = math.ceil(most_delay * actuator.controller.delay / dt) + 2
    _, state_of, write_state = columns(State)
    done = len(State._fields)
    goals = done + 1
    fixed = ("controller.delay",)  # the goals that are kept reach so far back

    def constants(candidates: Mapping[str, Any]) -> Constants:
        return servo_constants(actuator.varied(candidates, fixed), candidates)

    @part
    def begin(c, u, x):  # type: ignore[no-untyped-def]
        own = constants_of(c, 0)
        start = u[0, 0]
        # the output rests on the face that its load pushes it to
        side = math.copysign(1.0, own.gravity * math.sin(start) + own.load_torque)
        write_state(x, 0, State(start, start + side * own.half_gap, 0.0, start, 0.0, side))
        x[done, 0] = 0.0
        for n in range(kept):
            x[goals + n, 0] = start

    @part
    def sample(c, x, u, n, y):  # type: ignore[no-untyped-def]
        y[0, 0] = x[3, 0]

    @part
    def advance(c, x, u):  # type: ignore[no-untyped-def]
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
