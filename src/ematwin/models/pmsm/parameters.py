"""Parameters of a PMSM servo under field-oriented control, with a gear.

Tolerances are how far a data sheet may be off on one unit, drifts how far a value changes later;
`quantity` defines both. Catalogues state 10 % for resistance and torque constant, 10 to 30 % for
inductance; IEC 60034-1 allows 10 % on inertia. Copper gains 0.39 % and NdFeB magnets lose 0.1 % for
each kelvin: 35 % and 5 % in 90 and 50 K. Friction, backlash and stiffness are given as limits or
typical values only.

Gains, rates and limits are settings of the drive, and so are its assumptions on the motor
(`Controller.flux` and the inductances beside it): they are numbers of a digital controller.

Its sampled loops have to be stable. Each loop is linear between its limits. Its transition over one
period of its slowest sampler is a matrix, made column by column from the recursion itself: all
eigenvalues must lie within the unit circle (e.g. Franklin, Powell and Workman 1998, Digital Control
of Dynamic Systems, chapter 5).

- current: one winding, voltage held for a sample and one sample late;
- speed: the motor alone, as in the gap, under the speed loop around that current loop;
- position: motor and output on the gear's spring, under all three.
"""

import math
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from ematwin.errors import ParameterError
from ematwin.models.parameter_set import Section, quantity
from ematwin.models.sections import Gear, Presliding, ServoParameters, Steps, WindingHeat
from ematwin.numerics.linear_algebra import largest_share, spectral_radius

_WHOLE = 1e-6  # of a ratio that has to be a whole number


class Motor(Section):
    """Permanent-magnet synchronous motor, star-connected, star point free."""

    resistance: float = quantity("ohm", "resistance of a phase", tolerance=0.1, drift=0.35, gt=0)
    inductance_d: float = quantity("H", "inductance along the magnets", tolerance=0.15, gt=0)
    inductance_q: float = quantity("H", "inductance across the magnets", tolerance=0.15, gt=0)
    leakage: float = quantity(
        "H", "leakage inductance of a phase, part of both inductances", tolerance=0.5, gt=0
    )
    flux: float = quantity(
        "Wb", "flux linkage of the magnets, peak of a phase", tolerance=0.06, drift=0.05, gt=0
    )
    harmonic_5: float = quantity("", "fifth harmonic of the EMF over its fundamental", ge=-1, le=1)
    harmonic_7: float = quantity(
        "", "seventh harmonic of the EMF over its fundamental", ge=-1, le=1
    )
    pole_pairs: int = quantity("", "pole pairs", exact=True, ge=1)
    gap_share: float = quantity(
        "", "air gap over air gap and magnets together: what an eccentricity can change", gt=0, le=1
    )
    short_resistance: float = quantity("ohm", "contact resistance of shorted turns", gt=0)
    inertia: float = quantity("kg*m^2", "rotor inertia", tolerance=0.12, gt=0)
    viscous_damping: float = quantity(
        "N*m*s/rad", "viscous damping on the motor shaft", tolerance=1.0, drift=0.2, ge=0
    )
    friction_torque: float = quantity(
        "N*m", "dry friction of the motor side in motion", tolerance=0.6, ge=0
    )
    cogging_torque: float = quantity("N*m", "amplitude of the cogging torque", ge=0)
    cogging_periods: int = quantity("", "cogging periods in a turn", exact=True, ge=1)
    cogging_phase: float = quantity(
        "rad", "angle of the sine of the cogging where the motor stands at zero", default=0.0
    )


class Drive(Section):
    """Inverter and sensors."""

    supply_voltage: float = quantity("V", "DC link", tolerance=0.05, drift=0.08, gt=0)
    dead_time: float = quantity("s", "dead time of a leg", ge=0)
    device_drop: float = quantity("V", "forward drop of a switch or diode", ge=0)
    knee_current: float = quantity(
        "A", "current beyond which a leg's voltage error is whole: ripple and capacitances", gt=0
    )
    current_bits: int = quantity("", "bits of the current converters", exact=True, ge=6, le=24)
    current_range: float = quantity("A", "largest current that they convert", exact=True, gt=0)
    motor_steps: int = quantity("", "steps of the motor encoder in a turn", exact=True, ge=16)
    output_steps: int = quantity("", "steps of the output encoder in a turn", exact=True, ge=16)


class Controller(Section):
    """Sampled loops: current (dq, decoupled), speed (PI) and output position (P)."""

    position_gain: float = quantity("1/s", "position to speed", tolerance=0.4, gt=0)
    speed_gain: float = quantity("N*m*s/rad", "speed to torque", tolerance=0.4, gt=0)
    speed_integral: float = quantity("N*m/rad", "integrated speed to torque", tolerance=0.4, ge=0)
    current_gain: float = quantity("V/A", "current to voltage", gt=0)
    current_integral: float = quantity("V/(A*s)", "integrated current to voltage", ge=0)
    current_time: float = quantity("s", "sample time of the current loops, one PWM period",
                                   exact=True, gt=0)  # fmt: skip
    speed_time: float = quantity("s", "sample time of the speed loop", exact=True, gt=0)
    position_time: float = quantity("s", "sample time of the position loop", exact=True, gt=0)
    speed_limit: float = quantity("rad/s", "limit of the speed reference", exact=True, gt=0)
    current_limit: float = quantity("A", "limit of the torque current, peak", exact=True, gt=0)
    torque_constant: float = quantity("N*m/A", "that the drive reckons with", exact=True, gt=0)
    flux: float = quantity("Wb", "that the drive decouples with", exact=True, ge=0)
    inductance_d: float = quantity("H", "that the drive decouples with", exact=True, ge=0)
    inductance_q: float = quantity("H", "that the drive decouples with", exact=True, ge=0)


class Transmission(Gear):
    """Gear and output."""

    ratio: float = quantity("", "motor turns for one turn of the output", exact=True, gt=0)
    backlash: float = quantity(
        "rad", "healthy backlash, full width, on the motor shaft", tolerance=0.7, gt=0
    )
    stiffness: float = quantity(
        "N*m/rad", "torsional stiffness on the motor shaft", tolerance=0.5, gt=0
    )
    damping: float = quantity("N*m*s/rad", "damping of the gear on the motor shaft", ge=0)
    output_inertia: float = quantity(
        "kg*m^2", "output inertia reflected to the motor", tolerance=0.3, gt=0
    )
    viscous_damping: float = quantity(
        "N*m*s/rad", "viscous damping of the output, reflected to the motor", tolerance=1.0, ge=0
    )
    friction_torque: float = quantity(
        "N*m", "dry friction of the output side in motion, reflected", tolerance=0.6, ge=0
    )
    static_ratio: float = quantity("", "static friction over that in motion", tolerance=0.3, ge=1)
    stribeck_speed: float = quantity(
        "rad/s", "motor speed at which half of the excess of static friction is left", gt=0
    )
    travel_low: float = quantity("rad", "lower end stop of the output")
    travel_high: float = quantity("rad", "upper end stop of the output")


class PmsmActuator(ServoParameters):
    """One PMSM servo, all values in SI: ``PmsmActuator.load("servo400")``."""

    kind = "pmsm"
    default = "servo400"

    motor: Motor
    drive: Drive
    controller: Controller
    transmission: Transmission
    steps: Steps
    presliding: Presliding | None = None
    winding_heat: WindingHeat | None = None

    @property
    def ticks(self) -> tuple[int, int]:
        """Samples of the current loops in one of the speed and position loop."""
        control = self.controller
        return (
            round(control.speed_time / control.current_time),
            round(control.position_time / control.current_time),
        )

    def whole_ticks(self, seconds: float, every: int = 1) -> int:
        """Ticks in about so many seconds: whole samples of all loops, and of every n-th tick."""
        whole = math.lcm(*self.ticks, every)
        return max(1, round(seconds / (self.controller.current_time * whole))) * whole

    def substeps(self, longest: float) -> int:
        """Steps of at most ``longest`` (s) in a tick of the current loops."""
        return max(1, math.ceil(self.controller.current_time / longest - 1e-9))

    @model_validator(mode="after")
    def _leakage_is_a_part(self) -> Self:
        least = min(self.motor.inductance_d, self.motor.inductance_q)
        if not self.motor.leakage < least:
            raise ValueError(
                f"motor.leakage must be less than both inductances, received {self.motor.leakage:g}"
                f" of {least:g} H; correct it"
            )
        return self

    @model_validator(mode="after")
    def _rates_are_multiples(self) -> Self:
        control = self.controller
        fastest = control.current_time
        for name in ("speed_time", "position_time"):
            periods = getattr(control, name) / fastest
            if round(periods) < 1 or abs(periods - round(periods)) > _WHOLE * periods:
                raise ValueError(
                    f"controller.{name} must be a whole number of current samples of {fastest:g} s,"
                    f" received {getattr(control, name):g} s; correct it"
                )
        if control.position_time < control.speed_time * (1.0 - _WHOLE):
            raise ValueError(
                "controller.position_time must be at least controller.speed_time, received "
                f"{control.position_time:g} s and {control.speed_time:g} s; correct one"
            )
        return self

    @model_validator(mode="after")
    def _loops_are_stable(self) -> Self:
        for loop in ("current", "speed", "position"):
            own = getattr(self.controller, f"{loop}_time")

            def stable(share: float, loop: str = loop, own: float = own) -> bool:
                return loop_radius(self, loop, share * own) <= 1.0 + 1e-9  # of the unit circle

            if stable(1.0):
                continue
            limit = own * largest_share(stable)
            advice = (
                f"it is stable up to {1e6 * limit:.3g} us; shorten it or lower the gains"
                if limit > 1e-6 * own  # of a sample time: a limit below is none
                else "no sample time makes it stable; lower the gains"
            )
            raise ParameterError(
                f"the {loop} loop is unstable at controller.{loop}_time = {1e6 * own:.4g} us: "
                f"{advice}"
            )
        return self

    def largest_stable_step(self, model: str) -> float:
        """Longest step of either model that follows gear and windings, s."""
        gear = self.transmission
        compliance = 1.0 / self.motor.inertia + 1.0 / gear.output_inertia
        limits = [
            self.controller.current_time,
            0.25 * 2.0 * math.pi / (gear.stiffness * compliance) ** 0.5,
            min(self.motor.inductance_d, self.motor.inductance_q) / self.motor.resistance,
        ]
        if gear.damping > 0.0:
            limits.append(1.0 / (gear.damping * compliance))
        if self.presliding is not None:
            limits.append(self.presliding.longest_step(self.motor.inertia, gear.output_inertia))
        return min(limits)


def loop_radius(actuator: Any, loop: str, sample_time: float) -> float:
    """Largest magnitude of the eigenvalues of a loop over its sample time, s.

    Faster loops keep their times, or take this one where theirs would be longer.
    """
    if loop == "current":
        motor = actuator.motor
        return max(
            spectral_radius(np.stack(_current_sample(actuator, inductance, sample_time, np.eye(3))))
            for inductance in (motor.inductance_d, motor.inductance_q)
        )
    control = actuator.controller
    current = min(control.current_time, sample_time)
    speed = min(control.speed_time, sample_time) if loop == "position" else sample_time
    counts = (max(1, round(speed / current)), max(1, round(sample_time / current)))
    rigid = loop == "speed"
    period = sample_time / counts[1]
    return spectral_radius(_cascade(actuator, period, counts, rigid))


def _current_sample(
    actuator: Any, inductance: float, period: float, now: Any, reference: Any = 0.0
) -> list[Any]:
    """Current, integrator and pending voltage a sample after ``now``."""
    control, resistance = actuator.controller, actuator.motor.resistance
    current, integral, pending = now
    error = reference - current
    decay = math.exp(-resistance * period / inductance)
    return [
        decay * current + (1.0 - decay) / resistance * pending,
        integral + control.current_integral * period * error,
        integral + control.current_gain * error,
    ]


def _cascade(actuator: Any, period: float, counts: tuple[int, int], rigid: bool) -> np.ndarray:
    """Transition (10, 10) of all loops, of motor and output over one sample of the slowest."""
    motor, control, gear = actuator.motor, actuator.controller, actuator.transmission
    k_t = 1.5 * motor.pole_pairs * motor.flux
    *winding, w_m, th_m, w_o, th_o, total, before, reference = np.eye(10)
    w_ref = 0.0 * w_m if rigid else -control.position_gain * th_o
    pieces = 4  # steps of the mechanics
    dt = period / pieces
    for n in range(counts[1]):
        if n % counts[0] == 0:
            speed_time = counts[0] * period
            error = w_ref - (th_m - before) / speed_time
            reference = (control.speed_gain * error + total) / control.torque_constant
            total = total + control.speed_integral * speed_time * error
            before = th_m
        after = _current_sample(actuator, motor.inductance_q, period, winding, reference)
        torque = k_t * 0.5 * (winding[0] + after[0])
        winding = after
        for _ in range(pieces):
            spring = 0.0 if rigid else gear.stiffness * (th_m - th_o) + gear.damping * (w_m - w_o)
            w_m = w_m + dt / motor.inertia * (torque - spring - motor.viscous_damping * w_m)
            w_o = w_o + dt / gear.output_inertia * (spring - gear.viscous_damping * w_o)
            th_m, th_o = th_m + dt * w_m, th_o + dt * w_o
    if rigid:  # where it stands is of no account
        th_m, before = th_m - th_m, before - th_m
        w_o, th_o = 0.0 * w_o, 0.0 * th_o
    return np.stack([*winding, w_m, th_m, w_o, th_o, total, before, reference])
