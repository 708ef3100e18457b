"""Loops over time and candidates. The physics is in the steps; here is only bookkeeping.

`reference_trace` gives a whole simulation. `monitor_scores` runs candidates side by side in lanes
of a processor's vector unit (`ematwin.numerics.lanes`); their responses are filtered, thinned
and compared as they arise.
"""

import numpy as np

from ematwin.models.pmsm.monitor_step import (
    ControlState,
    MonitorState,
    control_step,
    lost_in_legs,
    monitor_step,
    terminal_currents,
)
from ematwin.models.pmsm.reference_step import (
    ReferenceState,
    leg_errors,
    leg_voltages,
    phase_currents,
    reference_step,
)
from ematwin.models.pmsm.unknowns import Constants
from ematwin.numerics.compile import loop, part, step
from ematwin.numerics.lanes import LANES, columns, lane_loop, wide_vectors
from ematwin.numerics.scalar import biquad, sincos

REFERENCE_COLUMNS = (
    "current_d", "current_q", "voltage_d", "voltage_q", "motor_position", "output_position",
    "motor_speed", "output_speed", "loop_a", "loop_b", "loop_c", "e_electrical", "e_copper",
    "e_mechanical", "terminal_a", "terminal_b", "terminal_c",
    "terminal_voltage_a", "terminal_voltage_b", "terminal_voltage_c",
)  # fmt: skip
# What a candidate answers with; motor and output by how far they are from the command.
ANSWERS = ("current_q", "current_d", "voltage_q", "voltage_d", "motor_speed", "output_error",
           "motor_error")  # fmt: skip
COMPARED = 6  # the first ones
PERFECT = (0.0, 0.0, 0.0)  # steps of converters and encoders that have none

new_constants, lane, _ = columns(Constants)
new_plant, plant_of, write_plant = columns(MonitorState)
_, loops_of, write_loops = columns(ControlState)
_, read_reference, write_reference = columns(ReferenceState)


@step
def rounded(x, quantum):
    """A reading in whole steps; as it is where there are none."""
    return quantum * np.floor(x / quantum + 0.5) if quantum > 0.0 else x


@step
def monitor_currents(now, c):
    """Currents of phases a and b at the terminals, of a `MonitorState`, A."""
    s, co = sincos(c.pole_pairs * now.theta_m)
    i_a, i_b, _ = terminal_currents(s, co, now)
    return i_a, i_b


@part
def read_by_drive(
    now, currents, loops, command, quanta, due_position, due_speed, speed_ticks, tick, c
):
    """Let the drive read a plant in steps of its converters and encoders, and control.

    ``now`` is the state of either model, ``currents`` those of phases a and b (A), ``quanta`` as of
    `reference_trace`. Gives the loops after it, the log, and both angles as read (rad).
    """
    of_current, of_motor, of_output = quanta
    theta_m = rounded(now.theta_m + c.resolver / c.pole_pairs, of_motor)
    theta_o = rounded(now.theta_o, of_output)
    after, seen = control_step(
        loops, command, theta_m, theta_o,
        rounded(c.gain_a * currents[0] + c.offset_a, of_current),
        rounded(c.gain_b * currents[1] + c.offset_b, of_current),
        due_position, due_speed, speed_ticks, tick, c,
    )  # fmt: skip
    return after, seen, theta_m, theta_o


@loop
def reference_trace(
    command, load, now, loops, means, c, dt, substeps, ticks, quanta, every, count
):  # fmt: skip
    """(ceil(count/every), 20) trace of the reference model, columns as in `REFERENCE_COLUMNS`.

    Currents, voltages and positions are as the drive reads and commands them, the others as they
    are; voltages at the terminals are means over the tick before, against the middle of the link.

    Parameters
    ----------
    command, load : (K + 1,) arrays, at the ticks of the current loops, rad and N m on the motor
        shaft; the load runs in straight lines between
    now, loops, means : `ReferenceState`, `ControlState`, and the voltages of a, b, c at the
        terminals in the tick before; behind the trace the last ones are given
    dt, substeps : step (s), and how many make a tick
    ticks : (2,) integer array, ticks of the speed and the position loop
    quanta : (3,) array, steps of current converters (A), of motor and output encoder (rad on the
        motor shaft); 0 for perfect ones
    every, count : ticks from one sample to the next, and in all: K where a later call goes on
    """
    trace = np.empty(((count + every - 1) // every, 20))
    w_a, w_b, w_c = means
    for tick in range(count):
        v_alpha, v_beta = loops.v_alpha, loops.v_beta
        i_a, i_b = phase_currents(now, c)
        loops, seen, theta_m, theta_o = read_by_drive(
            now, (i_a, i_b), loops, command[tick], (quanta[0], quanta[1], quanta[2]),
            tick % ticks[1] == 0, tick % ticks[0] == 0, ticks[0], substeps * dt, c,
        )  # fmt: skip
        if tick % every == 0:
            row = trace[tick // every]
            row[0], row[1], row[2], row[3] = seen.i_d, seen.i_q, seen.v_d, seen.v_q
            row[4], row[5], row[6], row[7] = theta_m, theta_o, now.w_m, now.w_o
            row[8], row[9], row[10] = now.j_a, now.j_b, now.j_c
            row[11], row[12], row[13] = now.e_electrical, now.e_copper, now.e_mechanical
            row[14], row[15], row[16] = i_a, i_b, -i_a - i_b
            row[17], row[18], row[19] = w_a, w_b, w_c
        if tick + 1 < command.size:
            v_a, v_b, v_c = leg_voltages(v_alpha, v_beta, c.v_supply)
            w_a, w_b, w_c = v_a, v_b, v_c
            share = 0.5 / substeps
            e_a, e_b, e_c = leg_errors(now, c)
            d_load = (load[tick + 1] - load[tick]) / substeps
            for j in range(substeps):
                now = reference_step(
                    now, v_a, v_b, v_c,
                    c.load_gain * (load[tick] + (j + 0.5) * d_load) + c.load_offset, c, dt,
                )  # fmt: skip
                f_a, f_b, f_c = leg_errors(now, c)
                w_a -= share * (e_a + f_a)
                w_b -= share * (e_b + f_b)
                w_c -= share * (e_c + f_c)
                e_a, e_b, e_c = f_a, f_b, f_c
    return trace, now, loops, (w_a, w_b, w_c)


@step
def take_legs(own, plant, loops, share):
    """Add a share of the present leg errors to the leg errors of a tick, for all lanes."""
    for n in range(LANES):
        c = lane(own, n)
        s, co = sincos(c.pole_pairs * plant[6, n])
        alpha, beta = lost_in_legs(s, co, plant_of(plant, n), c)
        loops[11, n] += share * alpha
        loops[12, n] += share * beta


@lane_loop
def monitor_scores(
    constants, command, load, before, start, dt, substeps, ticks, taps, target, weight, every,
    measured, costs, answer,
):  # fmt: skip
    """Simulate and score a batch of candidates in one pass.

    Parameters
    ----------
    constants : (B, 65) array, the fields of `Constants`
    command, load : (P + K + 1,) arrays, at the ticks of the current loops, rad and N m on the
        motor shaft; the load runs in straight lines between
    before : P ticks that settle the start and are not compared; whole samples of all loops
    start : (6,) array, angle of the motor as read (rad), its speed (rad/s), angle and speed of the
        output, i_d and i_q (A); with a ``before`` the motor stands where the output does
    dt, substeps, ticks : as of `reference_trace`
    taps : (5,) array, low-pass ``b0 b1 b2 a1 a2``
    target : (6, ceil((K + 1)/every)) array, the filtered recording, rows as in `ANSWERS`
    weight : (6,) array, of the squares of the differences
    every : ticks from one compared sample to the next
    measured : bool, v_q and v_d are not those commanded, but at the terminals, the mean over the
        tick before
    costs : (B,) array, filled with the weighted sums of squares
    answer : (B, 7, ceil((K + 1)/every)) array, filled with the filtered answers; or (0, 0, 0)
    """
    wide_vectors()
    count = command.size
    keep = answer.shape[0] > 0
    low_pass = taps[0], taps[1], taps[2], taps[3], taps[4]
    b0, b2, a2 = taps[0], taps[2], taps[4]
    # few arrays: LLVM gives up vectorising where it had to check too many for overlap
    own = new_constants()
    plant = new_plant()
    # those of `ControlState`, the voltage that is applied, and what the legs take of it in a tick
    loops = np.empty((13, LANES))
    cost = np.empty(LANES)
    out = np.empty((7, LANES))
    z1 = np.empty((7, LANES))
    z2 = np.empty((7, LANES))
    for first in range(0, constants.shape[0], LANES):
        inside = min(LANES, constants.shape[0] - first)
        for n in range(LANES):
            for m in range(constants.shape[1]):  # the last one fills the lanes of a block
                own[m, n] = constants[first + min(n, inside - 1), m]
            c = lane(own, n)
            plant[:, n] = 0.0
            loops[:, n] = 0.0
            slip = c.resolver / c.pole_pairs
            plant[6, n] = start[2] if before > 0 else start[0] - slip
            plant[5, n], plant[8, n], plant[7, n] = start[1], start[2], start[3]
            plant[0, n], plant[1, n] = start[4], start[5]
            loops[1, n], loops[2, n] = start[5], start[5] * c.set_torque
            loops[3, n], loops[4, n] = plant[6, n] + slip, start[1]
            loops[5, n], loops[6, n] = c.resistance * start[4], c.resistance * start[5]
            cost[n] = 0.0
        for tick in range(count):
            due_speed = tick % ticks[0] == 0
            due_position = tick % ticks[1] == 0
            command_now = command[tick]
            if measured:
                for n in range(LANES):
                    c = lane(own, n)
                    s, co = sincos(c.pole_pairs * plant[6, n] + c.resolver)
                    x = loops[9, n] - loops[11, n]
                    y = loops[10, n] - loops[12, n]
                    out[3, n] = co * x + s * y
                    out[2, n] = co * y - s * x
            for n in range(LANES):
                c, now = lane(own, n), plant_of(plant, n)
                loops[9, n] = loops[7, n]
                loops[10, n] = loops[8, n]
                after, seen, reading, _ = read_by_drive(
                    now, monitor_currents(now, c), loops_of(loops, n), command_now, PERFECT,
                    due_position, due_speed, ticks[0], substeps * dt, c,
                )  # fmt: skip
                write_loops(loops, n, after)
                out[0, n] = seen.i_q
                out[1, n] = seen.i_d
                out[2, n] = out[2, n] if measured else seen.v_q
                out[3, n] = out[3, n] if measured else seen.v_d
                out[4, n] = plant[5, n]
                out[5, n] = command_now - plant[8, n]
                out[6, n] = command_now - reading
            if tick >= before:
                if tick == before:  # both sides rest where the recording begins
                    for m in range(7):
                        for n in range(LANES):
                            at = target[m, 0] if m < COMPARED else out[m, n]
                            z1[m, n] = (1.0 - b0) * at
                            z2[m, n] = (b2 - a2) * at
                for m in range(7):
                    for n in range(LANES):
                        out[m, n], z1[m, n], z2[m, n] = biquad(
                            out[m, n], z1[m, n], z2[m, n], low_pass
                        )
                if (tick - before) % every == 0:
                    place = (tick - before) // every
                    for m in range(COMPARED):
                        for n in range(LANES):
                            error = target[m, place] - out[m, n]
                            cost[n] += weight[m] * error * error
                    if keep:
                        answer[first : first + inside, :, place] = out[:, :inside].T
            if tick + 1 < count:
                d_load = (load[tick + 1] - load[tick]) / substeps
                if measured:
                    loops[11:] = 0.0
                for j in range(substeps):
                    load_now = load[tick] + (j + 0.5) * d_load
                    if measured:
                        take_legs(own, plant, loops, 0.5 / substeps)
                    for n in range(LANES):
                        c = lane(own, n)
                        now = monitor_step(
                            plant_of(plant, n), loops[9, n], loops[10, n],
                            c.load_gain * load_now + c.load_offset, c, dt,
                        )  # fmt: skip
                        write_plant(plant, n, now)
                    if measured:
                        take_legs(own, plant, loops, 0.5 / substeps)
        costs[first : first + inside] = cost[:inside]
