"""Kernel of the Kalman filter of motor and output along recorded currents.

`ematwin.models.bldc.along_currents` says what it is for, and has the sources. Candidates run side
by side in lanes: commutations, and angles of the output, come to all of them at the same time.
"""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.bldc.constants import Constants, FaultState, Truer, fault_state
from ematwin.models.bldc.inverter import dot, gate_signals
from ematwin.models.bldc.motor import hall_sector, torque_of_cogging
from ematwin.models.bldc.reference_step import (
    all_emf_constants,
    move_on_bristles,
    move_sticking,
)
from ematwin.numerics.compile import loop, part, step
from ematwin.numerics.lanes import LANES, columns, lane_loop, wide_vectors
from ematwin.numerics.scalar import fallen

SWITCHED = 1e-4  # rad, by which a sensor of the rotor may switch sooner or later
_SURELY = 3.0  # standard deviations of an innovation: more is a surprise
_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
_CHANCE = 0.5  # of what a motor has gained since a rest
_TURNS = 5  # steps with one torque of the currents


class Sensed(NamedTuple):
    """What a candidate makes of the recording, and how well it is known."""

    begin: float  # rad, where both masses are at rest
    zero: float  # rad, of the recorded output
    torque_gain: float  # on that of the currents
    torque_offset: float  # N m
    load_gain: float
    load_offset: float  # N m on the motor shaft
    density: float  # rad^2/s^3, of the noise of the acceleration
    output: float  # rad, standard deviation of the recorded output


class TwoMasses(NamedTuple):
    """Both masses, on the motor shaft."""

    w_m: float  # rad/s
    theta_m: float  # rad
    w_o: float
    theta_o: float
    bent_m: float  # rad, of bristles
    bent_o: float


class Trust(NamedTuple):
    """Covariances of angle and speed: of both masses, and of an output in the gap."""

    angle: float  # rad^2
    both: float
    speed: float
    own_angle: float
    own_both: float
    own_speed: float
    last: float  # samples, until which they have grown
    corrected: float  # samples, when the motor was last corrected
    rested: float  # samples, when it was last at rest


_RESTED = Trust._fields.index("rested")
_BRISTLES = Truer._fields.index("presliding_motor_stiffness")
new_constants, constants_of, _ = columns(Constants)
new_truer, truer_of, _ = columns(Truer)
new_fault, fault_of, write_fault = columns(FaultState)
new_sensed, sensed_of, _ = columns(Sensed)
new_masses, masses_of, write_masses = columns(TwoMasses)
new_trust, trust_of, write_trust = columns(Trust)


@part
def torque_of(currents, now, fault, c, truer, sensed, dt):  # type: ignore[no-untyped-def]
    """Torque on the motor by currents (3,), or (1,), A, over `_TURNS` steps of ``dt``.

    Then its ripple by a comparator; both in N m.
    """
    middle = now.theta_m + 0.5 * _TURNS * dt * now.w_m
    pair = gate_signals(hall_sector(c.pole_pairs * middle), 1.0)
    if currents.size == 1:
        i = pair[0] * currents[0], pair[1] * currents[0], pair[2] * currents[0]
    else:
        i = currents[0], currents[1], currents[2]
    kappas = all_emf_constants(middle, fault, c, truer)
    torque = sensed.torque_gain * dot(kappas, i) + sensed.torque_offset
    return torque + torque_of_cogging(middle, truer), c.half_band * abs(dot(kappas, pair))


@step
def growth_rates(w, fault, c, truer):  # type: ignore[no-untyped-def]
    """Rates (1/s) at which errors of a speed ``w`` (rad/s) grow: of motor, output, both together.

    Where friction falls with speed, a mass that is too fast becomes faster still.
    """
    x = w / truer.presliding_stribeck_speed
    falls = 2.0 * abs(x) / truer.presliding_stribeck_speed * fallen(x * x)
    falls = falls if truer.presliding_motor_stiffness > 0.0 else 0.0
    excess = fault.friction * (c.static_ratio - 1.0) * falls
    of_motor, of_output = excess * c.t_m - c.viscous, excess * c.t_o
    together = c.mobility_both * (of_motor + of_output)
    return c.mobility_m * of_motor, c.mobility_o * of_output, together


@step
def grown(angle, both, speed, span, density, rate, most):  # type: ignore[no-untyped-def]
    """The covariance of angle and speed after a short ``span`` (s) of noise of the acceleration.

    Errors of the speed grow by themselves at a ``rate`` (1/s), if positive up to ``most`` (rad/s).
    """
    more = 1.0 + span * (rate if speed < most * most else min(rate, 0.0))
    noise = density * span
    angle += span * (2.0 * both + span * (speed + noise / 3.0))
    both = more * (both + span * speed) + 0.5 * span * noise
    return angle, both, more * more * speed + noise


@step
def grown_until(when, now, trust, fault, c, truer, sensed, spacing):  # type: ignore[no-untyped-def]
    """Trust at a time, in samples."""
    span, most = (when - trust.last) * spacing, truer.presliding_stribeck_speed
    alone, _, together = growth_rates(now.w_m, fault, c, truer)
    rate = together if abs(now.theta_m - now.theta_o) >= fault.half_gap else alone
    a, b, s = grown(trust.angle, trust.both, trust.speed, span, sensed.density, rate, most)
    _, rate, _ = growth_rates(now.w_o, fault, c, truer)
    own = grown(trust.own_angle, trust.own_both, trust.own_speed, span, sensed.density, rate, most)
    return Trust(a, b, s, own[0], own[1], own[2], when, trust.corrected, trust.rested)


@part
def gained(angle, both, speed, noise, share):  # type: ignore[no-untyped-def]
    """Gains on angle and speed, and their covariance after a ``share`` of an observation."""
    of_angle, of_speed = share * angle / (angle + noise), share * both / (angle + noise)
    speed -= of_speed * both
    return of_angle, of_speed, angle * (1.0 - of_angle), both * (1.0 - of_angle), speed


@part
def shown_at(angle, now, trust, fault, sensed, fixed):  # type: ignore[no-untyped-def]
    """Masses and trust after the recorded ``angle`` (rad) of the output now.

    Then the innovation and its standard deviation, rad; ``fixed`` (4,) takes by what that changed
    angles and speeds.
    """
    touch = abs(now.theta_m - now.theta_o) >= fault.half_gap
    a, b, s = trust.own_angle, trust.own_both, trust.own_speed
    if touch:
        a, b, s = trust.angle, trust.both, trust.speed
    away, noise = angle - sensed.zero - now.theta_o, sensed.output**2
    deviation = math.sqrt(a + noise)
    surprise = away**2 / (_SURELY**2 * (a + noise))
    if surprise > 1.0:
        a, b, s = surprise * a, surprise * b, surprise * s
    share, pace, a, b, s = gained(a, b, s, noise, 1.0)
    turns = pace * away if (now.w_o != 0.0) | (surprise > 1.0) else 0.0
    fixed[2], fixed[3] = share * away, turns
    theta_m, w_m = now.theta_m, now.w_m
    both = trust.angle, trust.both, trust.speed, trust.corrected
    if touch:
        fixed[0], fixed[1] = share * away, turns
        theta_m, w_m = theta_m + share * away, w_m + turns
        both = a, b, s, trust.last
    w_o, theta_o = now.w_o + turns, now.theta_o + share * away
    now = TwoMasses(w_m, theta_m, w_o, theta_o, now.bent_m, now.bent_o)
    trust = Trust(both[0], both[1], both[2], a, b, s, trust.last, both[3], trust.rested)
    return now, trust, away, deviation


@part
def commutated(seen, end, now, trust, fault, c, known, spacing, fixed):  # type: ignore[no-untyped-def]
    """As `shown_at` after a commutation ``seen``: when, in samples, angle, rad, and jitter, s.

    ``end`` of the step is a little later.
    """
    when, angle, jitter = seen
    a, b, s = trust.angle, trust.both, trust.speed
    if (c.half_band > 0.0) & (trust.rested >= trust.corrected):
        # peaks of the comparator's ripple end a rest by chance, sooner or later
        a += (_CHANCE * (when - trust.rested) * spacing * now.w_m) ** 2
        s += (_CHANCE * now.w_m) ** 2
    away = angle - now.theta_m + (end - when) * spacing * now.w_m
    away -= known[0] * np.floor(away / known[0] + 0.5)
    noise = SWITCHED**2 + (jitter * now.w_m) ** 2
    variance = a + noise
    # what was seen may be something else, which is as likely anywhere
    deviation, likely = math.sqrt(variance), math.exp(-0.5 * away**2 / variance)
    other = known[2] * _ROOT_TWO_PI * deviation
    true = 1.0 if other == 0.0 else likely / (likely + other)
    shown, spread = away, deviation / (1.0 + other)
    if other > 0.0:
        far = math.sqrt(2.0 * math.log((1.0 + other) / (likely + other)))
        shown = math.copysign(far * spread, away)
    # whether friction holds the motor at an instant is a matter of chance: by how much
    # that is beyond what is likely the filter trusts its state less
    surprise = away**2 / (_SURELY**2 * variance)
    if surprise > 1.0:
        a, b, s = surprise * a, surprise * b, surprise * s
    share, pace, a, b, s = gained(a, b, s, noise, true)
    # a mass that friction holds is where it is, and an output in the gap by itself
    turns = pace * away if (now.w_m != 0.0) | (surprise > 1.0) else 0.0
    fixed[0], fixed[1] = share * away, turns
    theta_o, w_o = now.theta_o, now.w_o
    if abs(now.theta_m + share * away - theta_o) >= fault.half_gap:
        fixed[2], fixed[3] = share * away, turns
        theta_o, w_o = theta_o + share * away, w_o + turns
    w_m, theta_m = now.w_m + turns, now.theta_m + share * away
    now = TwoMasses(w_m, theta_m, w_o, theta_o, now.bent_m, now.bent_o)
    own = trust.own_angle, trust.own_both, trust.own_speed
    trust = Trust(a, b, s, own[0], own[1], own[2], trust.last, when, trust.rested)
    return now, trust, shown, spread


@lane_loop
def masses_along(  # type: ignore[no-untyped-def]
    faults, constants, truers, sensors, spread, currents, load, spacing, substeps, seen, near,
    shown, known,
):  # fmt: skip
    """Angles and speeds of B candidates along recorded currents, and what corrected them.

    All of them have bristles, or none has.

    Parameters
    ----------
    faults : (B, 8) array, fault vectors
    constants, truers, sensors : (B, C), (B, T) and (B, 8) arrays: `Constants`, `Truer`, `Sensed`
    spread : rad, standard deviation of where both begin
    currents : (S, 3) array, A, means of the phases since the last sample; (S, 1) of the current
        through the two that conduct
    load : (S,) array, N m on the motor shaft
    spacing, substeps : s, of samples, and steps between them
    seen : (3, K) array, of commutations: when, in samples, at which angle of the motor, rad, and
        the standard deviation of when, s
    near : (S,) array, rad, near which the motor is; NaN where that is unknown
    shown : (S,) array, rad, angle of the output; NaN where that is unknown
    known : (3,) array: rad, multiples of which angles lack; rad, how far from ``near`` it is;
        1/rad, density of what is no commutation

    Returns
    -------
    found : (B, 4, S) array, angle and speed of motor and output, rad and rad/s
    left : (B, 2, E) array, innovations and their standard deviations, rad, of all that was seen or
        shown
    fixed : (B, 4, E) array, by which that changed ``found``
    when : (E,) array, in samples
    """
    wide_vectors()
    batch, events = len(faults), seen.shape[1]
    for angle in shown:  # `isfinite(shown).sum()` would load scipy.linalg with numba's sums
        events += angle == angle
    found, fixed = np.zeros((batch, 4, load.size)), np.zeros((batch, 4, events))
    left, when, dt, e = np.zeros((batch, 2, events)), np.zeros(events), spacing / substeps, 0
    c, truer, fault, sensed = new_constants(), new_truer(), new_fault(), new_sensed()
    masses, trust = new_masses(), new_trust()
    torque, ripple = np.empty(LANES), np.empty(LANES)
    for first in range(0, batch, LANES):
        inside, j, e = min(LANES, batch - first), 0, 0
        # whole vectors of lanes, filled by the last one, or one or two without them
        lanes = inside if inside < 3 else LANES // 2 if inside <= LANES // 2 else LANES
        for n in range(lanes):
            who = first + min(n, inside - 1)
            c[:, n], truer[:, n], sensed[:, n] = constants[who], truers[who], sensors[who]
            own = sensed_of(sensed, n)
            write_fault(fault, n, fault_state(faults[who], constants_of(c, n).half_gap))
            write_masses(masses, n, TwoMasses(0.0, own.begin, 0.0, own.begin, 0.0, 0.0))
            write_trust(trust, n, Trust(spread**2, 0.0, 0.0, spread**2, 0.0, 0.0, 0.0, 0.0, 0.0))
        for g in range(load.size):
            for n in range(inside):
                now = masses_of(masses, n)
                found[first + n, 0, g], found[first + n, 1, g] = now.theta_m, now.w_m
                found[first + n, 2, g], found[first + n, 3, g] = now.theta_o, now.w_o
            if shown[g] == shown[g]:
                for n in range(inside):
                    own = masses_of(masses, n)
                    grew = grown_until(
                        float(g), own, trust_of(trust, n), fault_of(fault, n), constants_of(c, n),
                        truer_of(truer, n), sensed_of(sensed, n), spacing,
                    )  # fmt: skip
                    now, of_both, away, deviation = shown_at(
                        shown[g], own, grew, fault_of(fault, n), sensed_of(sensed, n),
                        fixed[first + n, :, e],
                    )  # fmt: skip
                    write_masses(masses, n, now)
                    write_trust(trust, n, of_both)
                    left[first + n, 0, e], left[first + n, 1, e] = away, deviation
                when[e], e = g, e + 1
            for m in range(substeps if g < load.size - 1 else 0):
                if m % _TURNS == 0:  # they turn by a few milliradians meanwhile
                    for n in range(lanes):
                        write_trust(trust, n, grown_until(
                            g + m / substeps, masses_of(masses, n), trust_of(trust, n),
                            fault_of(fault, n), constants_of(c, n), truer_of(truer, n),
                            sensed_of(sensed, n), spacing,
                        ))  # fmt: skip
                        torque[n], ripple[n] = torque_of(
                            currents[g + 1], masses_of(masses, n), fault_of(fault, n),
                            constants_of(c, n), truer_of(truer, n), sensed_of(sensed, n), dt,
                        )  # fmt: skip
                pushes = load[g] + (m + 0.5) / substeps * (load[g + 1] - load[g])
                if truer[_BRISTLES, 0] == 0.0:
                    for n in range(lanes):
                        own = sensed_of(sensed, n)
                        write_masses(masses, n, move_sticking(
                            masses_of(masses, n), torque[n], ripple[n],
                            own.load_gain * pushes + own.load_offset, fault_of(fault, n),
                            constants_of(c, n), dt,
                        ))  # fmt: skip
                else:
                    for n in range(lanes):
                        own = sensed_of(sensed, n)
                        write_masses(masses, n, move_on_bristles(
                            masses_of(masses, n), torque[n],
                            own.load_gain * pushes + own.load_offset, fault_of(fault, n),
                            constants_of(c, n), truer_of(truer, n), dt,
                        ))  # fmt: skip
                end = g + (m + 1) / substeps
                for n in range(lanes):
                    trust[_RESTED, n] = end if masses[0, n] == 0.0 else trust[_RESTED, n]
                while j < seen.shape[1] and seen[0, j] <= end:
                    for n in range(inside):
                        at = masses_of(masses, n)
                        grew = grown_until(
                            seen[0, j], at, trust_of(trust, n), fault_of(fault, n),
                            constants_of(c, n), truer_of(truer, n), sensed_of(sensed, n), spacing,
                        )  # fmt: skip
                        now, of_both, away, deviation = commutated(
                            (seen[0, j], seen[1, j], seen[2, j]), end, at, grew, fault_of(fault, n),
                            constants_of(c, n), known, spacing, fixed[first + n, :, e],
                        )  # fmt: skip
                        write_masses(masses, n, now)
                        write_trust(trust, n, of_both)
                        left[first + n, 0, e], left[first + n, 1, e] = away, deviation
                    when[e], j, e = seen[0, j], j + 1, e + 1
            if g < load.size - 1 and near[g + 1] == near[g + 1]:
                for n in range(inside):
                    now = masses_of(masses, n)
                    away = near[g + 1] - now.theta_m
                    away -= known[0] * np.floor(away / known[0] + 0.5)
                    # further off it is lost
                    beyond = min(away + known[1], 0.0) + max(away - known[1], 0.0)
                    masses[1, n], masses[3, n] = now.theta_m + beyond, now.theta_o + beyond
    return found, left[..., :e], fixed[..., :e], when[:e]


@loop
def evened(found, fixed, when, rate):  # type: ignore[no-untyped-def]
    """Change motions of `masses_along` at a ``rate`` (Hz) to some without steps of corrections.

    Each belongs to the time since the last one: a cubic that ends with its angle and speed.
    """
    for n in range(len(found)):
        begin, e = 0.0, 0
        for g in range(found.shape[2]):
            while e < when.size and when[e] < g:
                begin, e = when[e], e + 1
            if e == when.size:
                break
            samples = max(when[e] - begin, 1e-9)
            s, span = (g - begin) / samples, samples / rate
            for side in (0, 2):
                angle, speed = fixed[n, side, e], fixed[n, side + 1, e]
                found[n, side, g] += (angle * (3.0 - 2.0 * s) + speed * span * (s - 1.0)) * s * s
                turned = 6.0 * angle / span * (1.0 - s) * s + speed * (3.0 * s - 2.0) * s
                found[n, side + 1, g] += turned
