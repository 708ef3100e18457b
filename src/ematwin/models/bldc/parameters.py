"""Parameters of a rotary actuator with a brushless motor and a gear.

Tolerances are how far a data sheet may be off on one unit, drifts how far a value changes later;
`quantity` defines both (95 % of such actuators). Where they come from:

Motor catalogues state 10 % for resistance, 5 to 10 % for the torque and EMF constants (6 % here),
and 30 % for inductance. IEC 60034-1 allows 10 % on inertia; a coupling or a pinion adds to it.
Copper gains 0.39 % for each kelvin, thus 35 % in a winding 90 K warmer than in the catalogue.
Magnets lose 0.1 (NdFeB) to 0.2 % (ferrite) for each kelvin: 5 % in 25 to 50 K. Supplies are set to
5 % and sag by 8 % under load or with the state of a battery. Viscous damping follows the
temperature of grease.

The rest is judgement, wide on purpose: catalogues give backlash and friction as upper limits, omit
the leakage, and rarely describe the output; gains of a drive are often known in units of the drive
only. The torque constant, the inertia and the efficiencies were narrowed while looking at
simulated actuators: newton metres rest on them (docs/trust.md).

Parameters without a tolerance are counted, chosen, or hardly change a recording.

The sampled loops of a drive have to settle, with the motor alone and without friction.
"""

import math
from functools import lru_cache
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from ematwin.models import sections
from ematwin.models.bldc import sections as form
from ematwin.models.parameter_set import Section, quantity
from ematwin.numerics.linear_algebra import largest_share, spectral_radius


class Motor(Section):
    """Three-phase trapezoidal brushless motor."""

    resistance: float = quantity(
        "ohm", "resistance, phase to phase", tolerance=0.1, drift=0.35, gt=0
    )
    inductance: float = quantity("H", "inductance, phase to phase", tolerance=0.3, gt=0)
    leakage_share: float = quantity(
        "", "share of the inductance outside the turns; left in a full short", tolerance=0.5,
        ge=0.001, le=1,
    )  # fmt: skip
    emf_constant: float = quantity(
        "V*s/rad", "back-EMF constant, phase to phase", tolerance=0.06, drift=0.05, gt=0
    )
    pole_pairs: int = quantity("", "pole pairs", exact=True, ge=1)
    turns_per_phase: int = quantity("", "turns of each phase", exact=True, ge=1)
    inertia: float = quantity("kg*m^2", "rotor inertia", tolerance=0.12, gt=0)
    viscous_damping: float = quantity(
        "N*m*s/rad", "viscous damping on the motor shaft", tolerance=1.0, drift=0.2, ge=0
    )
    friction_torque: float = quantity(
        "N*m", "dynamic dry friction of the motor side", tolerance=0.6, ge=0
    )


class Drive(Section):
    """Inverter and current regulation."""

    supply_voltage: float = quantity("V", "DC supply", tolerance=0.05, drift=0.08, gt=0)
    diode_drop: float = quantity("V", "forward voltage of a freewheeling diode", ge=0)
    hysteresis_band: float = quantity("A", "full width of the current band", tolerance=0.3, gt=0)
    current_limit: float = quantity("A", "limit of the current reference", tolerance=0.05, gt=0)


class Controller(Section):
    """Position and speed loops."""

    position_gain: float = quantity(
        "1/s", "proportional gain, position to speed", tolerance=0.4, gt=0
    )
    speed_gain: float = quantity(
        "N*m*s/rad", "proportional gain, speed to torque", tolerance=0.4, gt=0
    )
    speed_limit: float = quantity(
        "rad/s", "limit of the speed reference, motor shaft", tolerance=0.05, gt=0
    )


class Transmission(sections.Gear):
    """Gear, backlash contact, output."""

    ratio: float = quantity("", "motor turns for one turn of the output", exact=True, gt=0)
    backlash: float = quantity(
        "rad", "healthy backlash, full width, on the motor shaft", tolerance=0.7, ge=0
    )
    contact_stiffness: float = quantity("N*m/rad", "contact stiffness on the motor shaft", gt=0)
    contact_damping: float = quantity("N*m*s/rad", "contact damping on the motor shaft", ge=0)
    output_inertia: float = quantity(
        "kg*m^2", "output inertia reflected to the motor", tolerance=0.6, gt=0
    )
    friction_torque: float = quantity(
        "N*m", "dynamic dry friction of the output side, reflected to the motor", tolerance=0.6,
        ge=0,
    )  # fmt: skip
    static_ratio: float = quantity("", "static over dynamic friction", tolerance=0.4, ge=1)
    efficiency_opposing: float = quantity(
        "", "efficiency against an opposing load", tolerance=0.06, gt=0, le=1
    )
    efficiency_aiding: float = quantity(
        "", "efficiency with an aiding load", tolerance=0.06, gt=0, le=1
    )
    travel_low: float = quantity("rad", "lower end stop of the output")
    travel_high: float = quantity("rad", "upper end stop of the output")


class BldcActuator(sections.ServoParameters):
    """One brushless actuator, all values in SI.

    Load one with `BldcActuator.load("servo48")` or `BldcActuator.load("mine.toml")`; make a variant
    with `actuator.changed({"motor.resistance": 2.3})`.
    """

    kind = "bldc"
    former_kinds = ("rotary",)
    default = "servo48"

    motor: Motor
    drive: Drive
    controller: Controller
    transmission: Transmission
    steps: sections.Steps
    shorted_turns: form.ShortedTurns | None = None
    eccentricity: form.Eccentricity | None = None
    emf: form.Emf | None = None
    cogging: form.Cogging | None = None
    speed_loop: form.SpeedLoop | None = None
    current_loop: form.CurrentLoop | None = None
    compliance: form.Compliance | None = None
    torque_ripple: sections.TorqueRipple | None = None
    presliding: sections.StribeckPresliding | None = None
    winding_heat: sections.WindingHeat | None = None
    supply: sections.Supply | None = None
    encoder: form.Encoder | None = None

    @property
    def contact(self) -> form.Compliance:
        """Stiffness and damping between motor and output: of the gear, else of its contact."""
        gear = self.transmission
        if self.compliance is not None:
            return self.compliance
        return form.Compliance.model_construct(
            stiffness=gear.contact_stiffness, damping=gear.contact_damping
        )

    @model_validator(mode="after")
    def _sampled_loops_are_stable(self) -> Self:
        if self.encoder is not None and (
            self.speed_loop is None or self.speed_loop.sample_time == 0.0
        ):
            raise ValueError(
                "an encoder's speed is a difference over the sample time of the speed loop, which "
                "is continuous; state speed_loop.sample_time above 0, or leave [encoder] out"
            )
        check_speed_loop(self)
        check_current_loop(self)
        return self

    @model_validator(mode="after")
    def _current_can_be_reached(self) -> Self:
        drivable = self.drive.supply_voltage / self.motor.resistance
        if self.drive.current_limit > 100.0 * drivable:  # mA taken for A give 1000
            raise ValueError(
                f"drive.current_limit is {self.drive.current_limit:g} A, but the supply can "
                f"drive only {drivable:.3g} A; it looks like mA, correct its unit"
            )
        return self

    @model_validator(mode="after")
    def _output_inertia_is_reflected(self) -> Self:
        times = self.transmission.output_inertia / self.motor.inertia
        if self.transmission.ratio > 1.0 and times > 1000.0:  # no gear is chosen so
            raise ValueError(
                f"transmission.output_inertia is {times:.3g} times that of the rotor: it is stated "
                "as the motor feels it; divide the inertia of the output by the square of the ratio"
            )
        return self

    @property
    def integrates(self) -> bool:
        """Whether its speed loop has an integral term."""
        return self.speed_loop is not None and self.speed_loop.integral_gain > 0.0

    def largest_stable_step(self, model: str) -> float:
        """Longest step of a model for which its fastest mode neither grows nor rings, s."""
        j_m, j_o = self.motor.inertia, self.transmission.output_inertia
        # semi-implicit Euler holds dt/tau < 1 for first-order modes without ringing; the implicit
        # midpoint rule of the monitor model 2, and turns 2 % of a mode round at 2.1
        speed_loop = j_m / (self.controller.speed_gain + self.motor.viscous_damping)
        if model == "monitor":
            return 2.1 * speed_loop
        compliance = 1.0 / j_m + 1.0 / j_o
        limits = [speed_loop, 1.0 / math.sqrt(self.contact.stiffness * compliance)]
        if self.contact.damping > 0.0:
            limits.append(1.0 / (self.contact.damping * compliance))
        if self.presliding is not None:
            limits.append(self.presliding.longest_step(j_m, j_o))
        limits.append(self.motor.inductance / self.motor.resistance)
        if self.speed_loop is not None and self.speed_loop.sample_time > 0.0:
            limits.append(self.speed_loop.sample_time)
        if self.current_loop is not None:
            limits.append(self.current_loop.sample_time)
        return min(limits)


# 64 sets of parameters are kept: most of a Jacobian's columns leave the loops as they are


def check_speed_loop(actuator: Any) -> None:
    """Raise ValueError unless the sampled speed loop settles; the message gives the limit."""
    loop = actuator.speed_loop
    given = loop, actuator.controller, actuator.encoder, actuator.motor.inertia
    if loop is None or _speed_settles(*given, 1.0):
        return
    low = largest_share(lambda share: _speed_settles(*given, share))
    advice = "lower the gains" if low == 0.0 else "sample faster or lower the gains"
    raise ValueError(
        f"the speed loop is unstable at speed_loop.sample_time = {loop.sample_time:.3g} s with "
        f"a delay of {loop.delay:.3g} s: with these gains and the motor alone it must be below "
        f"{low * loop.sample_time:.3g} s, the delay in proportion; {advice}"
    )


def check_current_loop(actuator: Any) -> None:
    """Raise ValueError unless the loops settle behind the sampled current loop."""
    loop = actuator.current_loop
    given = loop, actuator.controller, actuator.motor
    if loop is None or _current_settles(*given, 1.0):
        return
    said = (
        f"with current_loop.sample_time = {loop.sample_time:.3g} s and a delay of "
        f"{loop.delay:.3g} s"
    )
    if not _current_settles(*given, 0.0):
        raise ValueError(f"the current loop is unstable {said}: sample faster or lower its gains")
    low = largest_share(lambda share: _current_settles(*given, share))
    raise ValueError(
        f"the speed loop is unstable {said}: behind such a current loop, and with the motor "
        f"alone, controller.speed_gain must be below {low * actuator.controller.speed_gain:.3g} "
        "N*m*s/rad; lower it, or sample the current faster"
    )


@lru_cache(maxsize=64)
def _speed_settles(loop: Any, control: Any, encoder: Any, inertia: float, share: float) -> bool:
    """Whether the speed loop settles at a share of its sample time and delay."""
    span, delay = share * loop.sample_time, share * loop.delay
    if span == 0.0:
        return True
    k_i = loop.integral_gain * span
    k_p = control.speed_gain + k_i
    position, speed, asked, integral, before, seen = np.eye(6)
    known = speed
    if encoder is not None:
        tau = encoder.filter_time
        passed = -math.expm1(-span / tau) if tau > 0.0 else 1.0
        known = seen + passed * ((position - before) / span - seen)
    error = -control.position_gain * position - known
    answer = k_p * error + integral
    # position, speed, torque asked for before, integral, position and speed known before
    system = np.array([
        position + span * speed,
        speed + (delay * asked + (span - delay) * answer) / inertia,
        answer, integral + k_i * error, position, known,
    ])  # fmt: skip
    kept = [0, 1, 2, *([3] if k_i > 0.0 else []), *([] if encoder is None else [4, 5])]
    return spectral_radius(system[np.ix_(kept, kept)]) < 1.0


@lru_cache(maxsize=64)
def _current_settles(loop: Any, control: Any, motor: Any, share: float) -> bool:
    """Whether the loops settle with a share of the speed gain; 0 is the current loop alone."""
    span = loop.sample_time
    decay = math.exp(-motor.resistance * span / motor.inductance)
    per_volt = (1.0 - decay) / motor.resistance
    # what is asked for by position, speed, current, voltage asked for before, integral
    demand = -share * control.speed_gain / motor.emf_constant
    error = np.array([demand * control.position_gain, demand, -1.0, 0.0, 0.0])
    answer = loop.proportional_gain * error + np.eye(5)[4]
    late = loop.delay / span
    half = 0.5 * span * motor.emf_constant / motor.inertia
    system = np.zeros((5, 5))
    system[2] = per_volt * (late * np.eye(5)[3] + (1.0 - late) * answer)
    system[2] += np.array([0.0, -per_volt * motor.emf_constant, decay, 0.0, 0.0])
    system[1] = half * system[2] + np.array([0.0, 1.0, half, 0.0, 0.0])
    system[0] = 1.0, span, 0.0, 0.0, 0.0
    system[3] = answer
    system[4] = np.eye(5)[4] + loop.integral_gain * span * error
    kept = [n for n in range(5) if n < 4 or loop.integral_gain > 0.0]
    kept = kept if share > 0.0 else [n for n in kept if n > 1]
    return spectral_radius(system[np.ix_(kept, kept)]) < 1.0
