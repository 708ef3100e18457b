"""A brushless servo actuator that is not the twin's: an independent simulator with more physics.

It shares no code with the package and was written from docs/models.md, "Reference model". With the
neutral `Structure` it is that model: three phases, six-step commutation, freewheeling diodes,
hysteresis regulation, two masses, backlash, dry friction, and the eight faults. Beyond it, each
field of `Structure` switches on something that the twin does not have:

cogging, rounded back-EMF, LuGre friction, a compliant gear, a position and speed loop that is
sampled, a current loop that is a sampled PI, an inverter that loses voltage, encoders that count.

Sources: textbook electrical drives; Canudas de Wit, Olsson, Astrom and Lischinsky (1995), IEEE
Trans. Automatic Control 40(3), 419-425 (LuGre); Barabanov and Ortega (2000), ibid. 45(4), 675-680
(LuGre adds energy with a constant bristle damping, so it fades with speed here).

All angles, speeds, torques and inertias are on the motor shaft, except the command, the load and
the output position of `simulate`, which are those of the output.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np
from numba import njit

from ematwin.recordings.recording import Recording

STEP = 1e-6  # s: a quarter of it moves the filtered current by 0.1 %, with everything on by 0.4 %
FULL_SCALE = 25.0  # A, of the current converter, both ways
_ROUNDED = 2.0 * math.pi / (3.0 * math.sqrt(3.0))  # amplitude of a sine with the mean torque of f
_SMALL_CURRENT = 0.1  # A: below it the lost voltage falls to zero, as ripple makes it do

HEALTHY = {
    "friction": 0.0, "backlash": 0.0, "short_a": 0.0, "short_b": 0.0, "short_c": 0.0,
    "eccentricity": 0.0, "eccentricity_phase": 0.5, "gain": 0.5,
}  # fmt: skip


class Structure(NamedTuple):
    """What this actuator has and the twin has not; everything is off by default.

    Parameters
    ----------
    cogging : N m, amplitude on the motor shaft
    cogging_cycles : cycles in a turn of the motor
    cogging_phase : rad
    emf_rounding : share of a sine in the EMF shape, 0 to 1. The sine makes the same mean torque as
        the trapezoid, so this is a change of shape and not of the torque constant
    bristle_stiffness : N m/rad, of LuGre friction on each side; 0 is dry friction with stick-slip
    bristle_damping : N m s/rad, at rest; it fades with speed
    stribeck_speed : rad/s, at which static has mostly become dynamic friction
    gear_stiffness : N m/rad, of the gear beyond its backlash; 0 is that of the parameter file
    gear_damping : N m s/rad, taken with ``gear_stiffness``
    control_interval : s, of a sampled position and speed loop; 0 is continuous
    speed_integral : N m/rad, torque for each radian of integrated speed error
    current_interval : s, of a PI current loop with pulse-width modulation, averaged over a period;
        0 is the hysteresis comparator
    current_delay : intervals from a sample of the current to the voltage that answers it, 0 or 1
    current_bandwidth : rad/s, of that loop
    lost_voltage : V, that each conducting leg of the inverter loses to dead time and switches
    sampling_phase : share of the control interval from the start of the recording to a sample
    encoder_lines : counts of the motor's encoder in a turn; 0 is a perfect one. Positions are
        recorded in counts, and a sampled speed loop has no speed but their difference
    output_lines : counts of the output's encoder in a turn of the motor; 0 is a perfect one
    encoder_phase : share of a count at which both begin
    speed_lag : s, time constant of a first-order filter of that speed
    """

    cogging: float = 0.0
    cogging_cycles: float = 12.0
    cogging_phase: float = 0.0
    emf_rounding: float = 0.0
    bristle_stiffness: float = 0.0
    bristle_damping: float = 0.01
    stribeck_speed: float = 2.0
    gear_stiffness: float = 0.0
    gear_damping: float = 0.005
    control_interval: float = 0.0
    speed_integral: float = 0.0
    current_interval: float = 0.0
    current_delay: float = 1.0
    current_bandwidth: float = 4000.0
    lost_voltage: float = 0.0
    sampling_phase: float = 0.0
    encoder_lines: float = 0.0
    output_lines: float = 0.0
    encoder_phase: float = 0.0
    speed_lag: float = 0.0

    @classmethod
    def realistic(cls) -> Self:
        """A moderate amount of everything: what a servo of this size may well have."""
        return cls(**{name: value for term in TERMS.values() for name, value in term.items()})

    @classmethod
    def random(cls, rng: np.random.Generator) -> Self:
        """Everything at once, each drawn evenly within `RANGES`."""
        drawn = {name: float(rng.uniform(low, high)) for name, (low, high) in RANGES.items()}
        cycles = float(rng.choice(COGGING_CYCLES))
        share = drawn.pop("current_bandwidth_share")
        bandwidth = share / drawn["current_interval"]
        return cls(cogging_cycles=cycles, current_bandwidth=bandwidth, **drawn)

    def only(self, *terms: str) -> Self:
        """This structure with all but some of the `TERMS` switched off."""
        return type(self)(**{name: getattr(self, name) for term in terms for name in TERMS[term]})


# The terms of `Structure.realistic`, by name: engineering values, tuned on nothing.
TERMS: dict[str, dict[str, float]] = {
    "cogging": {"cogging": 0.002, "cogging_cycles": 12.0, "cogging_phase": 0.7},
    "rounded EMF": {"emf_rounding": 0.3},
    "LuGre friction": {"bristle_stiffness": 100.0, "bristle_damping": 0.01, "stribeck_speed": 2.0},
    "compliant gear": {"gear_stiffness": 150.0, "gear_damping": 0.005},
    "sampled control": {"control_interval": 100e-6},
    "PI current loop": {"current_interval": 100e-6, "current_bandwidth": 4000.0},
    "lost voltage": {"lost_voltage": 0.7},
}

# Ranges of `Structure.random`.
RANGES: dict[str, tuple[float, float]] = {
    "cogging": (0.0, 0.004),  # up to a quarter of the dynamic friction of the motor of servo48
    "cogging_phase": (0.0, 2.0 * math.pi),
    "emf_rounding": (0.0, 0.6),
    "bristle_stiffness": (50.0, 300.0),
    "bristle_damping": (0.003, 0.02),
    "stribeck_speed": (0.5, 5.0),
    "gear_stiffness": (50.0, 300.0),
    "gear_damping": (0.002, 0.01),
    "control_interval": (50e-6, 200e-6),
    "current_interval": (50e-6, 100e-6),
    "current_bandwidth_share": (0.25, 0.4),  # of a radian for each interval of the current loop
    "lost_voltage": (0.0, 1.5),
}
COGGING_CYCLES = (6, 12, 24, 36)


class Plant(NamedTuple):
    """Parameters with faults as the loop takes them, SI, on the motor shaft."""

    r: Any  # (3,) ohm, of each phase
    l: Any  # (3,) H
    h: Any  # (3,), share of turns left
    k_e: float  # V s/rad, of one healthy phase
    pole_pairs: float
    zeta: float
    phi: float
    v_supply: float
    v_diode: float
    half_band: float
    i_max: float
    w_max: float
    k_position: float  # 1/s, with the gain fault
    k_speed: float
    j_m: float
    j_o: float
    viscous: float
    t_m: float  # N m, dynamic friction with the friction fault
    t_o: float
    static_ratio: float
    opposing: float  # share of the load that friction adds, with the friction fault
    aiding: float
    half_gap: float
    stiffness: float
    damping: float
    low: float
    high: float
    control_every: int  # steps; 0 is each
    current_every: int  # steps; 0 is hysteresis
    k_proportional: float  # V/A
    k_integral: float  # V/(A s)
    late: int  # steps, by which samples come after the start
    lines: float  # counts of the motor's encoder in a radian; 0 is a perfect one
    output_lines: float


def parameters_of(actuator: Any) -> dict[str, float]:
    """Values by place, such as ``motor.resistance``, of an object with ``.parameters()``."""
    return {place: float(value) for place, value, *_ in actuator.parameters()}


def tuned(parameters: Mapping[str, float], structure: Structure) -> dict[str, float]:
    """The parameters with the speed gain at which the loops of this structure still have margin.

    A drive is tuned to its loops. The speed loop of servo48 crosses over at 20,000 rad/s of the
    motor alone, which suits a comparator; behind a current loop that answers after 0.3 ms it swings
    by many amperes. Here its crossover is held to a third of the inverse of that lag. Who sets a
    drive knows its gain, so give the twin the tuned one as well. Without ``current_delay``, and
    with intervals of at most 100 us, servo48 is stable as it is.
    """
    lag = structure.control_interval
    if structure.current_interval > 0.0:
        lag += 1.0 / structure.current_bandwidth
    own = dict(parameters)
    if lag > 0.0:
        stable = own["motor.inertia"] / (3.0 * lag)
        own["controller.speed_gain"] = min(own["controller.speed_gain"], stable)
    return own


def simulate(
    parameters: Mapping[str, float],
    time: Any,
    command: Any,
    load: Any = None,
    faults: Mapping[str, float] | None = None,
    structure: Structure | None = None,
    *,
    sample_rate: float = 20_000.0,
    noise: float = 0.02,
    bits: int | None = 12,
    seed: int = 0,
    initial_position: float = 0.0,
) -> Recording:
    """The recording of a motion from rest.

    Parameters
    ----------
    parameters : values by place, as in a parameter file, SI
    time, command, load : (N,) arrays, s, rad and N m on the output; straight lines between
    faults : some of the eight faults by name, normalised; the others are healthy
    noise : standard deviation of white noise on each phase, as a share of its RMS
    bits : resolution of the current converter, or None
    initial_position : rad, of the output

    Returns
    -------
    Recording from ``time[0]`` on: a current is its mean since the last sample, a position its
    value at the sample, as in simulated recordings of the package
    """
    unknown = set(faults or {}) - set(HEALTHY)
    if unknown:
        raise ValueError(f"There is no fault {sorted(unknown)[0]!r}; choose of {list(HEALTHY)}.")
    ratio = parameters["transmission.ratio"]
    time = np.asarray(time, dtype=float)
    interval = 1.0 / sample_rate
    samples = math.floor((time[-1] - time[0]) * sample_rate + 1e-9) + 1
    substeps = max(1, math.ceil(interval / STEP - 1e-9))
    dt = interval / substeps
    load = np.zeros(time.shape) if load is None else np.asarray(load, dtype=float)
    command = np.asarray(command, dtype=float)
    fine = time[0] + dt * np.arange((samples - 1) * substeps)
    extra = Structure(*map(float, structure or Structure()))  # compiled once
    plant = _plant(parameters, {**HEALTHY, **(faults or {})}, extra, dt)
    currents, motor, output = _run(
        plant,
        extra,
        np.interp(fine, time, command) * ratio,
        np.interp(fine, time, load) / ratio,
        initial_position * ratio,
        samples,
        substeps,
        dt,
    )
    rng = np.random.default_rng(seed)
    sampled = time[0] + interval * np.arange(samples)
    return Recording(
        sampled,
        {
            "command": np.interp(sampled, time, command),
            "load": np.interp(sampled, time, load),
            **{f"current_{p}": _measured(currents[:, k], noise, bits, rng)
               for k, p in enumerate("abc")},
            "motor_position": motor,
            "output_position": output / ratio,
        },
        provenance={"source": "another actuator"},
    )  # fmt: skip


def _measured(
    current: np.ndarray, noise: float, bits: int | None, rng: np.random.Generator
) -> np.ndarray:
    spread = noise * np.sqrt(np.mean(current**2))
    seen = current + spread * rng.standard_normal(current.size)
    if bits is None:
        return seen
    codes = 2 ** (bits - 1)
    return np.clip(np.round(seen / FULL_SCALE * codes), -codes, codes - 1) * (FULL_SCALE / codes)


def _plant(
    p: Mapping[str, float], k: Mapping[str, float], structure: Structure, dt: float
) -> Plant:
    worn = 1.0 + 2.0 * k["friction"]
    h = 1.0 - np.array([k["short_a"], k["short_b"], k["short_c"]])
    leak = p["motor.leakage_share"]
    own_gear = structure.gear_stiffness > 0.0
    return Plant(
        r=h * p["motor.resistance"] / 2.0,
        l=(h**2 * (1.0 - leak) + leak) * p["motor.inductance"] / 2.0,
        h=h,
        k_e=p["motor.emf_constant"] / 2.0,
        pole_pairs=float(p["motor.pole_pairs"]),
        zeta=float(k["eccentricity"]),
        phi=2.0 * math.pi * (k["eccentricity_phase"] - 0.5),
        v_supply=p["drive.supply_voltage"],
        v_diode=p["drive.diode_drop"],
        half_band=p["drive.hysteresis_band"] / 2.0,
        i_max=p["drive.current_limit"],
        w_max=p["controller.speed_limit"],
        k_position=p["controller.position_gain"] * (0.5 + k["gain"]),
        k_speed=p["controller.speed_gain"],
        j_m=p["motor.inertia"],
        j_o=p["transmission.output_inertia"],
        viscous=p["motor.viscous_damping"],
        t_m=worn * p["motor.friction_torque"],
        t_o=worn * p["transmission.friction_torque"],
        static_ratio=p["transmission.static_ratio"],
        opposing=worn * (1.0 / p["transmission.efficiency_opposing"] - 1.0),
        aiding=worn * (1.0 - p["transmission.efficiency_aiding"]),
        half_gap=p["transmission.backlash"] / 2.0 * (1.0 + 99.0 * k["backlash"]),
        stiffness=structure.gear_stiffness if own_gear else p["transmission.contact_stiffness"],
        damping=structure.gear_damping if own_gear else p["transmission.contact_damping"],
        low=p["transmission.travel_low"] * p["transmission.ratio"],
        high=p["transmission.travel_high"] * p["transmission.ratio"],
        control_every=round(structure.control_interval / dt),
        current_every=round(structure.current_interval / dt),
        # the zero of the PI cancels the winding, so its bandwidth is what it is asked to be
        k_proportional=structure.current_bandwidth * p["motor.inductance"],
        k_integral=structure.current_bandwidth * p["motor.resistance"],
        late=round(structure.sampling_phase * structure.control_interval / dt),
        lines=structure.encoder_lines / (2.0 * math.pi),
        output_lines=structure.output_lines / (2.0 * math.pi),
    )


@njit(cache=True)
def emf_shape(angle, rounding):
    """EMF shape at an electrical angle (rad): trapezoid with flats of 120 degrees, and a sine."""
    x = angle % (2.0 * math.pi)
    sixth = math.pi / 6.0
    if x < sixth:
        flat = x / sixth
    elif x <= 5.0 * sixth:
        flat = 1.0
    elif x < 7.0 * sixth:
        flat = (math.pi - x) / sixth
    elif x <= 11.0 * sixth:
        flat = -1.0
    else:
        flat = (x - 2.0 * math.pi) / sixth
    return (1.0 - rounding) * flat + rounding * _ROUNDED * math.sin(x)


@njit(cache=True)
def counted(angle, lines, phase):
    """Angle (rad) of the count at ``angle`` by an encoder with so many ``lines`` in a radian."""
    return math.floor(angle * lines + phase) / lines if lines > 0.0 else angle


@njit(cache=True)
def dry_speed(w, act, inertia, dynamic, static_ratio, dt):
    """Speed after ``dt`` of a mass on which dry friction acts, with a stop at zero."""
    if w == 0.0:
        if abs(act) <= static_ratio * dynamic:
            return 0.0
        return dt * (act - math.copysign(static_ratio * dynamic, act)) / inertia
    after = w + dt * (act - math.copysign(dynamic, w)) / inertia
    return 0.0 if after * w < 0.0 else after


@njit(cache=True)
def lugre(z, w, dynamic, static_ratio, stiffness, damping, stribeck, dt):
    """LuGre friction: bristle deflection (rad) after ``dt``, and the torque against ``w`` (N m).

    ``dz/dt = w - stiffness |w| z / g(w)``, implicit in z, which no speed makes unstable.
    """
    slow = math.exp(-((w / stribeck) ** 2))
    level = max(dynamic, 1e-9) * (1.0 + (static_ratio - 1.0) * slow)
    after = (z + dt * w) / (1.0 + dt * stiffness * abs(w) / level)
    return after, stiffness * after + damping * slow * (after - z) / dt


@njit(cache=True)
def advance_currents(i, v, driven, emf, plant, on, slope, charge, dt):
    """Advance the currents (3,) by ``dt`` in place; what flowed (A s) is added to ``charge``.

    Two legs have the voltages ``v``; the third freewheels through a diode until its current is
    zero, where the step is divided.
    """
    left = dt
    for _ in range(4):
        weight, total = 0.0, 0.0
        for k in range(3):
            on[k] = driven[k]
            if not driven[k] and i[k] != 0.0:
                on[k] = True
                v[k] = -plant.v_diode if i[k] > 0.0 else plant.v_supply + plant.v_diode
            if on[k]:
                weight += 1.0 / plant.l[k]
                total += (v[k] - plant.r[k] * i[k] - emf[k]) / plant.l[k]
        star = total / weight
        for k in range(3):
            if not on[k]:  # a diode that the EMF opens
                open_leg = star + emf[k]
                if open_leg < -plant.v_diode or open_leg > plant.v_supply + plant.v_diode:
                    v[k] = -plant.v_diode if open_leg < 0.0 else plant.v_supply + plant.v_diode
                    on[k] = True
                    weight += 1.0 / plant.l[k]
                    total += (v[k] - emf[k]) / plant.l[k]
                    star = total / weight
        span, blocked = left, -1
        for k in range(3):
            slope[k] = 0.0
            if on[k]:
                slope[k] = (v[k] - star - plant.r[k] * i[k] - emf[k]) / plant.l[k]
            if not driven[k] and i[k] * (i[k] + left * slope[k]) < 0.0:
                span, blocked = -i[k] / slope[k], k
        for k in range(3):
            charge[k] += span * (i[k] + 0.5 * span * slope[k])
            i[k] += span * slope[k]
        if blocked >= 0:
            i[blocked] = 0.0
        left -= span
        if left <= 0.0:
            break


@njit(cache=True)
def _run(plant, extra, command, load, start, samples, substeps, dt):
    """Mean currents (S, 3), motor and output positions (S,) on the motor shaft."""
    third = 2.0 * math.pi / 3.0
    firsts = np.array([0, 0, 1, 1, 2, 2])
    seconds = np.array([1, 2, 2, 0, 0, 1])
    currents = np.zeros((samples, 3))
    motor, output = np.full(samples, start), np.full(samples, start)
    i, v, emf, kappa = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    slope, charge = np.zeros(3), np.zeros(3)
    on, driven = np.zeros(3, dtype=np.bool_), np.zeros(3, dtype=np.bool_)
    theta_m, theta_o, w_m, w_o, z_m, z_o = start, start, 0.0, 0.0, 0.0, 0.0
    i_ref, u, u_next, integral, wound = 0.0, plant.v_supply, 0.0, 0.0, 0.0
    last, speed = counted(start, plant.lines, extra.encoder_phase), 0.0
    if plant.current_every > 0:
        u = 0.0
    for n in range(samples - 1):
        for now in range(n * substeps, (n + 1) * substeps):
            clock = now - plant.late
            # position and speed loop
            if plant.control_every == 0 or clock % plant.control_every == 0:
                output_now = counted(theta_o, plant.output_lines, extra.encoder_phase)
                w_ref = plant.k_position * (command[now] - output_now)
                w_ref = min(max(w_ref, -plant.w_max), plant.w_max)
                if plant.lines > 0.0 and plant.control_every > 0:
                    span, angle = (
                        plant.control_every * dt,
                        counted(theta_m, plant.lines, extra.encoder_phase),
                    )
                    fresh = (angle - last) / span
                    stays = math.exp(-span / extra.speed_lag) if extra.speed_lag > 0.0 else 0.0
                    speed, last = stays * speed + (1.0 - stays) * fresh, angle
                else:
                    speed = w_m
                late = w_ref - speed
                more = wound + extra.speed_integral * max(plant.control_every, 1) * dt * late
                asked = (plant.k_speed * late + more) / (2.0 * plant.k_e)
                i_ref = min(max(asked, -plant.i_max), plant.i_max)
                if i_ref == asked or asked * late < 0.0:  # no wind-up
                    wound = more

            # commutation and current loop
            theta_e = plant.pole_pairs * theta_m
            sector = math.floor(theta_e / (math.pi / 3.0) - 0.5) % 6
            first, second = firsts[sector], seconds[sector]
            if plant.current_every == 0:
                seen = max(abs(i[0]), abs(i[1]), abs(i[2]))
                if i[first] < i[second]:
                    seen = -seen
                if seen > i_ref + plant.half_band:
                    u = -plant.v_supply
                elif seen < i_ref - plant.half_band:
                    u = plant.v_supply
            elif clock % plant.current_every == 0:
                u = u_next
                error = i_ref - 0.5 * (i[first] - i[second])
                wish = plant.k_proportional * error + integral
                u_next = min(max(wish, -plant.v_supply), plant.v_supply)
                if u_next == wish or (wish - u_next) * error < 0.0:  # no wind-up
                    integral += plant.k_integral * error * plant.current_every * dt
                if extra.current_delay == 0.0:
                    u = u_next
            for k in range(3):
                driven[k] = k in (first, second)
                lean = min(max(i[k] / _SMALL_CURRENT, -1.0), 1.0)
                way = 1.0 if k == first else -1.0
                v[k] = 0.5 * (plant.v_supply + way * u) - extra.lost_voltage * lean

            # three phases
            for k in range(3):
                gap = 1.0 + plant.zeta * math.cos(theta_m + plant.phi - k * third)
                shape = emf_shape(theta_e - k * third, extra.emf_rounding)
                kappa[k] = plant.h[k] * plant.k_e * gap * shape
                emf[k] = kappa[k] * w_m
                charge[k] = 0.0
            advance_currents(i, v, driven, emf, plant, on, slope, charge, dt)
            torque = 0.0
            for k in range(3):
                torque += kappa[k] * charge[k] / dt
                currents[n + 1, k] += charge[k] / (substeps * dt)

            # gear with backlash, cogging, friction
            twist = theta_m - theta_o
            gear = 0.0
            if twist > plant.half_gap:
                gear = plant.stiffness * (twist - plant.half_gap) + plant.damping * (w_m - w_o)
                gear = max(gear, 0.0)  # teeth push, they do not pull
            elif twist < -plant.half_gap:
                gear = plant.stiffness * (twist + plant.half_gap) + plant.damping * (w_m - w_o)
                gear = min(gear, 0.0)
            act_m = torque - plant.viscous * w_m - gear
            act_m -= extra.cogging * math.sin(extra.cogging_cycles * theta_m + extra.cogging_phase)
            act_o = gear - load[now]
            way_o = w_o if w_o != 0.0 else act_o
            share = plant.opposing if way_o * load[now] > 0.0 else plant.aiding
            t_o = plant.t_o + share * abs(load[now])
            if extra.bristle_stiffness > 0.0:
                bristles = extra.bristle_stiffness, extra.bristle_damping, extra.stribeck_speed
                z_m, held_m = lugre(z_m, w_m, plant.t_m, plant.static_ratio, *bristles, dt)
                z_o, held_o = lugre(z_o, w_o, t_o, plant.static_ratio, *bristles, dt)
                w_m += dt * (act_m - held_m) / plant.j_m
                w_o += dt * (act_o - held_o) / plant.j_o
            else:
                w_m = dry_speed(w_m, act_m, plant.j_m, plant.t_m, plant.static_ratio, dt)
                w_o = dry_speed(w_o, act_o, plant.j_o, t_o, plant.static_ratio, dt)
            theta_m += dt * w_m
            theta_o += dt * w_o
            if theta_o <= plant.low:
                theta_o, w_o = plant.low, max(w_o, 0.0)
            elif theta_o >= plant.high:
                theta_o, w_o = plant.high, min(w_o, 0.0)
        motor[n + 1] = counted(theta_m, plant.lines, extra.encoder_phase)
        output[n + 1] = counted(theta_o, plant.output_lines, extra.encoder_phase)
    return currents, motor, output
