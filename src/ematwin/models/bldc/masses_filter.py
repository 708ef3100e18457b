"""Kernel of the Kalman filter of motor and output along recorded currents.

`ematwin.models.bldc.along_currents` says what it is for, and has the sources.
"""

import math

import numpy as np

from ematwin.models.bldc.constants import fault_state
from ematwin.models.bldc.inverter import dot, gate_signals
from ematwin.models.bldc.motor import hall_sector, torque_of_cogging
from ematwin.models.bldc.reference_step import ReferenceState, all_emf_constants, move_masses
from ematwin.numerics.compile import loop, step

SWITCHED = 1e-4  # rad, by which a sensor of the rotor may switch sooner or later
_SURELY = 3.0  # standard deviations of an innovation: more is a surprise
_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
_TURNS = 5  # steps with one torque of the currents


@step
def grown(angle, both, speed, span, density):  # type: ignore[no-untyped-def]
    """The covariance of angle and speed after a ``span`` (s) of noise of the acceleration."""
    angle += span * (2.0 * both + span * (speed + density * span / 3.0))
    return angle, both + span * (speed + density * span / 2.0), speed + density * span


@loop
def masses_along(  # type: ignore[no-untyped-def]
    k, currents, load, spacing, substeps, c, truer, more, seen, near, shown, known, state
):
    """Angles and speeds along recorded currents: of both masses, (4, S), and what corrected them.

    Parameters
    ----------
    k : (8,) array, fault vector
    currents : (S, 3) array, A, means of the phases since the last sample; (S, 1) of the current
        through the two that conduct
    load : (S,) array, N m on the motor shaft
    spacing, substeps : s, of samples, and steps between them
    c, truer : as of `batch.reference_trace`
    more : (2,) array, factor on the torque of the currents, and N m that add to it
    seen : (2, K) array, of commutations: when, in samples, and at which angle of the motor, rad
    near : (S,) array, rad, near which the motor is; NaN where that is unknown
    shown : (S,) array, rad, angle of the output; NaN where that is unknown
    known : (6,) array: s, standard deviation of when they came; rad, multiples of which angles
        lack; rad^2/s^3, density of the noise of the acceleration; rad, how far from ``near`` it is;
        1/rad, density of what is no commutation; rad, standard deviation of what is ``shown``
    state : (2,) array, rad, where both begin at rest, and how well that is known

    Returns
    -------
    found : (4, S) array, angle and speed of motor and output, rad and rad/s
    left : (2, E) array, innovations and their standard deviations, rad, of all that was seen or
        shown
    fixed : (4, E) array, by which that changed ``found``
    when : (E,) array, in samples
    """
    fault = fault_state(k, c.half_gap)
    theta_m, w_m, theta_o, w_o = state[0], 0.0, state[0], 0.0
    of_angle, of_both, of_speed = state[1] ** 2, 0.0, 0.0  # the covariance of both
    # of an output in the gap
    own_angle, own_both, own_speed = of_angle, 0.0, 0.0
    bent_m, bent_o, last, own_last, j, e = 0.0, 0.0, 0.0, 0.0, 0, 0
    events = seen.shape[1] + np.isfinite(shown).sum()
    found, fixed, when = np.zeros((4, load.size)), np.zeros((4, events)), np.zeros(events)
    left, dt, torque = np.zeros((2, events)), spacing / substeps, 0.0
    for g in range(load.size):
        found[0, g], found[1, g], found[2, g], found[3, g] = theta_m, w_m, theta_o, w_o
        if shown[g] == shown[g]:
            touch = abs(theta_m - theta_o) >= fault.half_gap
            if touch:
                own_angle, own_both, own_speed, own_last = of_angle, of_both, of_speed, last
            own_angle, own_both, own_speed = grown(
                own_angle, own_both, own_speed, (g - own_last) * spacing, known[2]
            )
            away = shown[g] - theta_o
            variance = own_angle + known[5] ** 2
            left[0, e], left[1, e] = away, math.sqrt(variance)
            surprise = away**2 / (_SURELY**2 * variance)
            if surprise > 1.0:
                own_angle, own_both = surprise * own_angle, surprise * own_both
                own_speed, variance = surprise * own_speed, own_angle + known[5] ** 2
            share, pace = own_angle / variance, own_both / variance
            own_speed -= pace * own_both
            own_both, own_angle = own_both * (1.0 - share), own_angle * (1.0 - share)
            turns = pace * away if (w_o != 0.0) | (surprise > 1.0) else 0.0
            theta_o, w_o = theta_o + share * away, w_o + turns
            fixed[2, e], fixed[3, e] = share * away, turns
            if touch:
                theta_m, w_m = theta_m + share * away, w_m + turns
                fixed[0, e], fixed[1, e] = share * away, turns
                of_angle, of_both, of_speed, last = own_angle, own_both, own_speed, g
            when[e], own_last, e = g, g, e + 1
        for n in range(substeps if g < load.size - 1 else 0):
            now = ReferenceState(
                0.0, 0.0, 0.0, w_m, theta_m, w_o, theta_o, 1.0, 0.0, 0.0, 0.0, bent_m, bent_o
            )
            if n % _TURNS == 0:  # it turns by a few milliradians meanwhile
                middle = theta_m + 0.5 * _TURNS * dt * w_m
                kappas = all_emf_constants(middle, fault, c, truer)
                torque = more[1] + torque_of_cogging(middle, truer)
                if currents.shape[1] == 1:
                    i = gate_signals(hall_sector(c.pole_pairs * middle), currents[g + 1, 0])
                else:
                    i = currents[g + 1, 0], currents[g + 1, 1], currents[g + 1, 2]
                torque += more[0] * dot(kappas, i)
            pushes = load[g] + (n + 0.5) / substeps * (load[g + 1] - load[g])
            w_m, theta_m, w_o, theta_o, bent_m, bent_o = move_masses(
                now, torque, pushes, fault, c, truer, dt
            )
            end = g + (n + 1) / substeps
            while j < seen.shape[1] and seen[0, j] <= end:
                of_angle, of_both, of_speed = grown(
                    of_angle, of_both, of_speed, (seen[0, j] - last) * spacing, known[2]
                )
                away = seen[1, j] - theta_m + (end - seen[0, j]) * spacing * w_m
                away -= known[1] * np.floor(away / known[1] + 0.5)
                noise = SWITCHED**2 + (known[0] * w_m) ** 2
                variance = of_angle + noise
                # what was seen may be something else, which is as likely anywhere
                deviation, likely = math.sqrt(variance), math.exp(-0.5 * away**2 / variance)
                other = known[4] * _ROOT_TWO_PI * deviation
                true = 1.0 if other == 0.0 else likely / (likely + other)
                left[0, e], left[1, e] = away, deviation / (1.0 + other)
                if other > 0.0:
                    far = math.sqrt(2.0 * math.log((1.0 + other) / (likely + other)))
                    left[0, e] = math.copysign(far * left[1, e], away)
                # whether friction holds the motor at an instant is a matter of chance: by how much
                # that is beyond what is likely the filter trusts its state less
                surprise = away**2 / (_SURELY**2 * variance)
                if surprise > 1.0:
                    of_angle, of_both = surprise * of_angle, surprise * of_both
                    of_speed, variance = surprise * of_speed, of_angle + noise
                share, pace = true * of_angle / variance, true * of_both / variance
                of_speed -= pace * of_both
                of_both, of_angle = of_both * (1.0 - share), of_angle * (1.0 - share)
                # a mass that friction holds is where it is, and an output in the gap by itself
                turns = pace * away if (w_m != 0.0) | (surprise > 1.0) else 0.0
                theta_m, w_m = theta_m + share * away, w_m + turns
                fixed[0, e], fixed[1, e] = share * away, turns
                if abs(theta_m - theta_o) >= fault.half_gap:
                    theta_o, w_o = theta_o + share * away, w_o + turns
                    fixed[2, e], fixed[3, e] = share * away, turns
                when[e], last, j, e = seen[0, j], seen[0, j], j + 1, e + 1
        if g < load.size - 1 and near[g + 1] == near[g + 1]:
            away = near[g + 1] - theta_m
            away -= known[1] * np.floor(away / known[1] + 0.5)
            # further off it is lost
            beyond = min(away + known[3], 0.0) + max(away - known[3], 0.0)
            theta_m, theta_o = theta_m + beyond, theta_o + beyond
    return found, left[:, :e], fixed[:, :e], when[:e]
