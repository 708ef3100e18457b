"""Forms that healthy recordings of a drive may show though its file leaves them out.

Sample times are chosen from those that drives have, and start values from common settings: an
integral time of 10 to 100 ms, a current loop of 2000 to 8000 rad/s that cancels the winding
(technical optimum), voltage losses of a volt, cogging of a few per cent of the rated torque.
"""

import math
from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from ematwin.models.bldc.along_currents import LEAST, Masses
from ematwin.models.bldc.along_motion import Controller
from ematwin.models.bldc.balance import Contact, Crossing, TorqueBalance
from ematwin.models.bldc.counts import comparable_cutoff
from ematwin.models.bldc.faults import HELD, LOAD, ZERO, backlash_factor
from ematwin.models.bldc.motion import Motion, has_motion
from ematwin.models.optional import FIRST_SAMPLE, Equation, Form, Values, with_values
from ematwin.models.servo import possible_coggings
from ematwin.numerics.signals import LowPass
from ematwin.recordings.recording import Recording

_TURN = 2.0 * math.pi
_SAMPLED = (50e-6, 62.5e-6, 80e-6, 100e-6, 125e-6)  # s, of current loops: 20 to 8 kHz
_USUAL = (*_SAMPLED, 2e-4 / 3, 75e-6, 2.5e-4 / 3)
_ANY = tuple(1e-6 * n for n in range(50, 126))  # one that is nearly right samples elsewhere as well
_SLOWER = (*_SAMPLED, 75e-6, 150e-6, 200e-6, 250e-6)  # of speed loops
_SHARES = tuple(n / 8 for n in range(8))  # of a sample time, at which loops sample first
_FILTER = (5e-5, 2e-4, 5e-4, 1e-3)  # s, of speeds
_WINDINGS = ("short_a", "short_b", "short_c", "eccentricity", "eccentricity_phase")
_SENSOR = ("current_gain", "current_offset")
_FRICTION = (
    "transmission.friction_torque",
    "transmission.efficiency_opposing",  # which also makes the load count for more or less
    "transmission.efficiency_aiding",
)
_OF_MOTOR = tuple(
    f"motor.{name}" for name in ("emf_constant", "inertia", "viscous_damping", "friction_torque")
)
_OF_OUTPUT = ("transmission.output_inertia", *_FRICTION)


def _speed(actuator: Any) -> dict[str, float]:
    own = actuator.speed_loop
    return {
        f"speed_loop.{name}": 0.0 if own is None else getattr(own, name)
        for name in ("integral_gain", "sample_time", "delay")
    }


def _sampled(
    section: str, times: Sequence[float], delays: Sequence[float] = (0.0, 1.0)
) -> list[Values]:
    """Sample times, each answered at once or with the next sample."""
    return [
        {f"{section}.sample_time": time, f"{section}.delay": late * time}
        for time, late in product(times, delays)
    ]


def _current_times(
    times: Sequence[float] | None, delays: Sequence[float], actuator: Any
) -> list[Values]:
    """Sample times, or the actuator's own, with first samples; none without a current loop."""
    loop = actuator.current_loop
    if loop is None:
        return []
    sampled = _sampled("current_loop", times or (loop.sample_time,), delays)
    return [
        {**one, FIRST_SAMPLE: share * one["current_loop.sample_time"]}
        for one, share in product(sampled, _SHARES)
    ]


def _sampled_speeds(actuator: Any) -> list[Values]:
    return [{**_speed(actuator), **one} for one in _sampled("speed_loop", _SLOWER)]


def _speed_times(actuator: Any) -> list[Values]:
    """A drive that samples its current samples its speed as well."""
    sampled = actuator.current_loop is not None or SAMPLED.is_stated(actuator)
    return _sampled_speeds(actuator) if sampled else []


def _first_samples(actuator: Any) -> list[list[float]]:
    """Instants, s, in sample times until both loops sample as before."""
    # a speed loop alone does not tell its first sample
    if actuator.current_loop is None:
        return []
    own, other = actuator.current_loop.sample_time, actuator.speed_loop
    ratio = own / other.sample_time if other is not None and other.sample_time > 0.0 else 0.0
    most = 8  # sample times
    again = (n for n in range(1, most) if abs(n * ratio - round(n * ratio)) < 1e-3)
    return [[(n + share) * own for share in _SHARES] for n in range(next(again, most))]


def _integrals(actuator: Any) -> list[Values]:
    gain, times = actuator.controller.speed_gain, (0.01, 0.03, 0.1)  # s
    return [{**_speed(actuator), "speed_loop.integral_gain": gain / time} for time in times]


def _current_loops(
    actuator: Any, times: Sequence[float] = (50e-6, 100e-6), delays: Sequence[float] = (0.0, 1.0)
) -> list[Values]:
    bandwidths = (2000.0, 4000.0, 8000.0)  # rad/s
    return [
        {
            "current_loop.proportional_gain": bandwidth * actuator.motor.inductance,
            "current_loop.integral_gain": bandwidth * actuator.motor.resistance,
            "current_loop.lost_voltage": 1.0,
            **sampled,
        }
        for bandwidth, sampled in product(bandwidths, _sampled("current_loop", times, delays))
    ]


def _coggings(actuator: Any) -> list[Values]:
    torque = 0.1 * actuator.motor.friction_torque or 1e-4 * actuator.motor.emf_constant
    return [
        {"cogging.torque": torque, "cogging.cycles": each, "cogging.phase": phase}
        for each, phase in possible_coggings(actuator.motor.pole_pairs)
    ]


def _has_margin(loop: Any, motor: Any) -> bool:
    """Whether a current loop is stable with a quarter more gain; none is set nearer to its border.

    With x the current at a sample and K = k_p T/L, x' = x - K x is stable up to K = 2, and up to 1
    if the loop answers a sample late. At its border it resembles a comparator.
    """
    gain = loop.proportional_gain * loop.sample_time / motor.inductance
    return bool(1.25 * gain < 2.0 / (1.0 + loop.delay / loop.sample_time))


def fadings(
    actuator: Any, speeds: Sequence[float] = (1.0, 3.0, 10.0), bent: Sequence[float] = (5e-4,)
) -> list[Values]:
    """Stribeck speeds (rad/s), and bristles ``bent`` (rad of the motor) by static friction.

    Sliding friction does not show how far they bend.
    """
    gear = actuator.transmission
    return [
        {
            "presliding.motor_stiffness": gear.static_ratio * actuator.motor.friction_torque / far,
            "presliding.output_stiffness": gear.static_ratio * gear.friction_torque / far,
            "presliding.damping": 0.01,
            "presliding.stribeck_speed": speed,
        }
        for speed, far in product(speeds, bent)
    ]


def _softer(actuator: Any) -> list[Values]:
    known = {"stiffness": actuator.contact.stiffness, "damping": actuator.contact.damping}
    return [
        {f"compliance.{name}": share * value for name, value in known.items()}
        for share in (0.3, 0.1, 0.03)
    ]


INTEGRAL = Form(
    "integral term in the speed loop", lambda a: a.integrates, ("speed_loop.integral_gain",),
    _integrals,
    lambda a: "integral term in the speed loop "
              f"({1e3 * (a.controller.speed_gain / a.speed_loop.integral_gain):.3g} ms)",
    ("speed_loop.integral_gain",),
)  # fmt: skip
SAMPLED = Form(
    "sampled speed loop",
    lambda a: a.speed_loop is not None and a.speed_loop.sample_time > 0.0,
    ("speed_loop.sample_time", "speed_loop.delay"),
    _sampled_speeds,
    lambda a: f"speed loop sampled each {1e6 * a.speed_loop.sample_time:.3g} us",
    alternatives=lambda a: _sampled("speed_loop", _SLOWER),
)
CURRENT_LOOP = Form(
    "current loop", lambda a: a.current_loop is not None,
    ("current_loop.sample_time", "current_loop.delay"), _current_loops,
    lambda a: f"current loop of {1e6 * a.current_loop.sample_time:.3g} us, about "
              f"{1e-3 * (a.current_loop.proportional_gain / a.motor.inductance / _TURN):.2g} kHz",
    ("current_loop.proportional_gain", "current_loop.integral_gain", "current_loop.lost_voltage"),
    lambda a: _sampled("current_loop", _SAMPLED), lambda a: _has_margin(a.current_loop, a.motor),
)  # fmt: skip
COGGING = Form(
    "cogging", lambda a: a.cogging is not None, ("cogging.cycles",), _coggings,
    lambda a: f"cogging of {1e3 * a.cogging.torque:.2g} mN m, {a.cogging.cycles} a turn",
    ("cogging.torque", "cogging.phase"),
)  # fmt: skip
ROUNDED = Form(
    "rounded back-EMF", lambda a: a.emf is not None, ("emf.rounding",),
    lambda a: [{"emf.rounding": 0.2}],
    lambda a: f"back-EMF rounded by {100.0 * a.emf.rounding:.0f} %", ("emf.rounding",),
)  # fmt: skip
FADING = Form(
    "friction that falls with speed", lambda a: a.presliding is not None,
    ("presliding.stribeck_speed",), fadings,
    lambda a: f"friction that falls with speed (Stribeck, {a.presliding.stribeck_speed:.2g} rad/s)",
    ("presliding.stribeck_speed", "transmission.static_ratio"),
)  # fmt: skip
_OF_MASSES = COGGING, ROUNDED, FADING
COMPLIANT = Form(
    "compliant gear", lambda a: a.compliance is not None,
    ("compliance.stiffness", "compliance.damping"), _softer,
    lambda a: f"gear that gives by 1 rad for {a.compliance.stiffness:.3g} N m on the motor shaft",
    ("compliance.stiffness",),
)  # fmt: skip


def _digital(steps: tuple[float, float], ratio: float) -> tuple[Form, Form]:
    """Speed by differences of counts of ``steps`` (rad of the motor), and a current loop."""
    # a drive that samples its current counts as well
    of_motor, of_output = steps[0], steps[1] or steps[0]
    counts = {
        "encoder.motor_steps": round(_TURN / of_motor),
        "encoder.output_steps": round(_TURN * ratio / of_output),
    }

    def starts(actuator: Any) -> list[Values]:
        loop = _speed(actuator)
        loop["speed_loop.sample_time"] = loop["speed_loop.sample_time"] or 1e-4
        return [{**loop, **counts, "encoder.filter_time": time} for time in _FILTER]

    def with_current_loop(actuator: Any) -> list[Values]:
        """Starts of both: either loop may account for the lag."""
        loop = {**_speed(actuator), "speed_loop.delay": 0.0}
        return [
            {**loop, "speed_loop.sample_time": period, **counts, "encoder.filter_time": time, **one}
            for period, time in product((50e-6, 80e-6, 125e-6), _FILTER)
            for one in _current_loops(actuator, (period,), (1.0,))
        ]

    def said(actuator: Any) -> str:
        time = actuator.encoder.filter_time
        how = f"filtered by {1e3 * time:.2g} ms" if time > _FILTER[0] else "not filtered"
        return f"speed from {actuator.encoder.motor_steps:,} counts a turn, {how}"

    of_speed = Form(
        "speed from counts of an encoder", lambda a: a.encoder is not None,
        ("encoder.filter_time", "speed_loop.sample_time"), starts, said, ("encoder.filter_time",),
        lambda a: _sampled("speed_loop", _SLOWER),
    )  # fmt: skip
    return of_speed, CURRENT_LOOP._replace(starts=with_current_loop)


def equations(recording: Recording, actuator: Any, values: Values | None) -> tuple[Equation, ...]:
    """Controller and mechanics of a recording with signed currents; without a load if it has none.

    What was not recorded of the motion follows from the currents, at these values.
    """
    # currents in shorted turns brake, and are not recorded
    brakes = values is not None and actuator.shorted_turns is not None
    if not has_motion(recording, actuator) or brakes:
        return ()
    motion, given = Motion(recording, actuator, values), values or {}
    low_pass = LowPass(comparable_cutoff(motion.steps[0]))
    of_controller = _controller(Controller(motion, low_pass), actuator, given)
    if motion.masses is not None:
        return of_controller, _masses(motion.masses, actuator, given)
    balance = TorqueBalance(motion, given)
    if motion.follows:
        return of_controller, _mechanics(balance)
    return (
        of_controller,
        _alone(balance, actuator, True, given),
        _alone(balance, actuator, False, given),
        _mechanics(balance),
        _contact(balance, actuator, given),  # by torques, which the others tell
    )


def _controller(controller: Controller, actuator: Any, values: Values) -> Equation:
    """Controller and windings, at these values of the windings' faults.

    Faults of a winding show in how the current dips when it commutates, which depends on how the
    loops sample as much. The torques tell them, and the controller is cut off from them (modular
    inference; Plummer 2015, Stat. Comput. 25, 37-43).
    """
    windings = {name: values[name] for name in _WINDINGS if name in values}
    motion, counts = controller.motion, controller.motion.counts
    places: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    if motion.moves:  # through the positions that were not recorded
        places, others = _OF_OUTPUT, ("friction", "backlash", *LOAD, ZERO)
        if motion.masses is not None:
            shaped = (one for form in _OF_MASSES if form.is_stated(actuator) for one in form.fitted)
            places = (*_OF_MOTOR, *places, *_bristles(actuator), *shaped)
            others = (*others, *_WINDINGS)
            if actuator.encoder is not None:
                own, ratio = actuator.encoder, actuator.transmission.ratio
                counts = own.motor_step, own.output_step * ratio
        # a healthy gap of a count or two is not learnt from counts; beside a fault of it, it counts
        if "backlash" in values or not counts[0]:
            places = ("transmission.backlash", *places)
    # a sampled speed loop that is late would take in the lag of a filter
    sampled = (SAMPLED, CURRENT_LOOP)
    if counts[0] > 0.0:
        sampled = _digital(counts, actuator.transmission.ratio)
    return Equation(
        "controller",
        lambda actuator, values: controller.left(actuator, values, windings),
        controller.size,
        controller.least,
        # torques are told by currents: gains come with the torque constant
        ("controller.position_gain", "controller.speed_gain", "motor.emf_constant",
         "motor.resistance", *places),
        (INTEGRAL, *sampled),
        ("gain", "skew", HELD, *_SENSOR, *others),
        rests="mechanics",
        at=lambda values, *how: _controller(controller.at(values, *how), actuator, values),
        noise=None if motion.masses is None else motion.masses.noise,
        step=0.0 if motion.masses is not None else 0.01 if motion.follows else 0.001,
        # how soon a loop answers hardly matters at a wrong sample time
        together=tuple(
            (partial(_current_times, times, (1.0,)), partial(_current_times, None, (0.0, 1.0)),
             _speed_times)
            for times in (_USUAL, _ANY)
        ),
        first_samples=_first_samples,
        each=None if motion.masses is None else partial(controller.each, windings=windings),
        alike=controller.alike,
        changes=controller.changes,
    )  # fmt: skip


def _bristles(actuator: Any) -> tuple[str, ...]:
    """Places of the stiffness of friction before it slides."""
    places = "presliding.motor_stiffness", "presliding.output_stiffness"
    return () if actuator.presliding is None else places


def _masses(masses: Masses, actuator: Any, values: Values) -> Equation:
    """Motor and output as the recorded currents drive them."""

    def at(values: Values, noise: Any, ahead: bool) -> Equation:
        own = with_values(actuator, values)
        return _masses(masses.at(own, values, noise, ahead), actuator, values)

    return Equation(
        "mechanics", masses.left, masses.size, masses.least,
        (*_OF_MOTOR, "transmission.backlash", *_OF_OUTPUT, *_bristles(actuator)), _OF_MASSES,
        ("friction", "backlash", *_WINDINGS, *LOAD, *_SENSOR, ZERO),
        at=at, noise=masses.noise, step=0.0, begins=lambda: masses.begins(actuator, values),
        alike=masses.alike, unexplained=masses.unexplained, discrepancy=masses.discrepancy,
        each=masses.each,
    )  # fmt: skip


def _mechanics(balance: TorqueBalance) -> Equation:
    """The torques along the motion."""
    return Equation(
        "mechanics", balance.left, balance.size, balance.least,
        ("motor.emf_constant", "motor.inertia", "transmission.output_inertia",
         "motor.viscous_damping", "motor.friction_torque", *_FRICTION), _OF_MASSES,
        ("friction", *_WINDINGS, *LOAD, *_SENSOR),
        at=(lambda values, *_: _mechanics(balance.at(values))) if balance.motion.follows else None,
    )  # fmt: skip


def _contact(balance: TorqueBalance, actuator: Any, values: Values) -> Equation:
    """The twist of the gear, on the faces that push at these values."""
    contact = Contact(balance, actuator, values)

    def begins() -> Values:
        # a gap that is wider than the twist would leave no face to push
        low, high = np.quantile(balance.motion.twist(), (0.01, 0.99))
        wider = float(high - low) / actuator.transmission.backlash
        factors = backlash_factor(0.0), backlash_factor(1.0)
        return {"backlash": float(np.interp(wider, factors, (0.0, 1.0)))}

    return Equation(
        "contact", contact.left, contact.size, contact.least,
        ("transmission.backlash", "transmission.output_inertia", *_FRICTION), (COMPLIANT,),
        ("friction", "backlash", *LOAD),
        rests="mechanics", judged=False,
        at=lambda values, *_: _contact(balance, actuator, values),
        alike=lambda actuator: LEAST,
        begins=begins,
    )  # fmt: skip


def _alone(balance: TorqueBalance, actuator: Any, of_motor: bool, values: Values) -> Equation:
    """Motor or output, while the output crosses the gap: faces are those pushed at these values."""
    apart = Contact(balance, actuator, values).apart()
    mass = Crossing(balance, apart, actuator, of_motor)
    return Equation(
        f"{'motor' if of_motor else 'output'} in the gap", mass.left, mass.size, mass.least,
        _OF_MOTOR if of_motor else _OF_OUTPUT, (),
        ("friction", *_WINDINGS, *_SENSOR) if of_motor else ("friction", *LOAD),
        # few samples of small angles
        rests="mechanics", judged=False,
        at=lambda values, *_: _alone(balance, actuator, of_motor, values),
        # friction of a motor that has just turned round bends bristles first
        alike=lambda actuator: 0.01 if of_motor else LEAST,
    )  # fmt: skip
