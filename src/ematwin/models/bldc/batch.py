"""Loops over time and candidates. The physics is in the steps; here is only bookkeeping.

`reference_trace` and `monitor_trace` give one whole simulation to people. `monitor_scores` gives
costs and nothing else: candidates run side by side in lanes of a processor's vector unit
(`ematwin.numerics.lanes`), and the current is filtered, sampled and compared as it arises.
Candidates whose cost has passed a limit are left out; the others close ranks.

No argument has a default: numba would compile None and an argument left out apart.
"""

import math

import numpy as np

from ematwin.models.bldc.constants import (
    HALF_GAP,
    LOAD_DELAY,
    Constants,
    FaultState,
    TruerState,
    fault_state,
)
from ematwin.models.bldc.monitor_step import (
    Loops,
    MonitorState,
    Pairs,
    looped_monitor_step,
    monitor_step,
    pairs_of,
)
from ematwin.models.bldc.reference_step import ReferenceState, reference_step
from ematwin.numerics.compile import loop, step
from ematwin.numerics.lanes import LANES, columns, lane_loop, wide_vectors
from ematwin.numerics.scalar import biquad

# Columns of the traces.
REFERENCE_COLUMNS = (
    "current_a", "current_b", "current_c", "motor_position", "motor_speed", "output_position",
    "output_speed", "e_electrical", "e_copper", "e_mechanical",
    "voltage_a", "voltage_b", "voltage_c", "bus_current", "bus_voltage",
)  # fmt: skip
MONITOR_COLUMNS = (
    "current", "motor_position", "motor_speed", "output_position", "output_speed", "power",
)  # fmt: skip

# Rows of what is held of a candidate: the fields of `MonitorState`, the state of the low-pass, the
# cost, and the fields of `Loops`.
_Z1, _Z2, _COST, _LOOPS, _HELD = 7, 8, 9, 10, 14

new_constants, read_constants, _ = columns(Constants)
new_faults, read_fault, write_fault = columns(FaultState)
new_pairs, read_pairs, write_pairs = columns(Pairs)
_, read_state, write_state = columns(MonitorState)
_, read_loops, write_loops = columns(Loops)
_, read_reference, write_reference = columns(ReferenceState)
_, read_more, write_more = columns(TruerState)


@step
def at(values, place):
    """The value at a place of an array; the ends beyond them."""
    return values[min(max(place, 0), values.size - 1)]


@loop
def reference_trace(k, command, load, state, c, dt, substeps, decimation, truer, more):
    """((G - 1) // decimation, 15) trace of the reference model, columns as in `REFERENCE_COLUMNS`.

    Samples are those after the start; a current or voltage is the mean over the interval that ends
    at its sample.

    Parameters
    ----------
    k : (8,) array, fault vector
    command, load : (G,) arrays on a uniform grid, rad and N m on the motor shaft; straight lines
    state : (13,) array, the fields of `ReferenceState`; and ``more`` (17,), those of `TruerState`.
        Both hold the last state afterwards, so that a long simulation can go on from there
    dt : step, s; ``substeps`` from one grid point to the next
    decimation : grid intervals from one sample to the next
    """
    fault = fault_state(k, c.half_gap)
    rows, more_rows = state.reshape(-1, 1), more.reshape(-1, 1)
    now, now_more = read_reference(rows, 0), read_more(more_rows, 0)
    samples = (command.size - 1) // decimation
    trace = np.empty((samples, 15))
    share = 1.0 / (substeps * decimation)
    for sample in range(samples):
        row = trace[sample]
        row[:] = 0.0
        for g in range(sample * decimation, (sample + 1) * decimation):
            d_command = (command[g + 1] - command[g]) / substeps
            d_load = (load[g + 1] - load[g]) / substeps
            for j in range(substeps):
                command_now = command[g] + j * d_command
                load_now = load[g] + j * d_load
                now, now_more, means, supply = reference_step(
                    now, now_more, command_now, load_now, fault, c, truer, dt
                )
                for m in range(3):
                    row[m] += means[m]
                    row[10 + m] += supply.v[m]
                row[13] += supply.i_bus
                row[14] += supply.v_bus
        row *= share
        row[3], row[4], row[5], row[6] = now.theta_m, now.w_m, now.theta_o, now.w_o
        row[7], row[8], row[9] = now.e_electrical, now.e_copper, now.e_mechanical
    write_reference(rows, 0, now)
    write_more(more_rows, 0, now_more)
    return trace


@loop
def monitor_trace(k, command, load, state, c, dt, substeps, decimation, loops):
    """((G - 1) // decimation, 6) trace of the monitor model, columns as in `MONITOR_COLUMNS`.

    As `reference_trace`. ``state`` (7,) holds the fields of `MonitorState`; ``loops`` is None where
    shorted turns are missing, or (4,), the fields of `Loops`: numba compiles the cases apart. The
    current is signed, the power electrical, into the motor.
    """
    fault = fault_state(k, c.half_gap)
    pairs = pairs_of(fault, c)
    rows = state.reshape(-1, 1)
    now = read_state(rows, 0)
    if loops is not None:
        loop_rows = loops.reshape(-1, 1)
        now_loops = read_loops(loop_rows, 0)
    samples = (command.size - 1) // decimation
    trace = np.empty((samples, 6))
    share = 1.0 / (substeps * decimation)
    for sample in range(samples):
        total = 0.0
        energy = 0.0
        for g in range(sample * decimation, (sample + 1) * decimation):
            d_command = (command[g + 1] - command[g]) / substeps
            d_load = (load[g + 1] - load[g]) / substeps
            for j in range(substeps):
                load_now = c.load_gain * (load[g] + (j + 0.5) * d_load) + c.load_offset
                command_now = command[g] + (j + 0.5) * d_command
                if loops is None:
                    now, p_mean = monitor_step(now, command_now, load_now, fault, pairs, c, dt)
                else:
                    now, now_loops, p_mean = looped_monitor_step(
                        now, now_loops, command_now, load_now, fault, c, dt
                    )
                total += now.i
                energy += p_mean
        row = trace[sample]
        row[0], row[5] = total * share, energy * share
        row[1], row[2], row[3], row[4] = now.theta_m, now.w_m, now.theta_o, now.w_o
    write_state(rows, 0, now)
    if loops is not None:
        write_loops(loop_rows, 0, now_loops)
    return trace


@lane_loop
def monitor_scores(
    k, commands, loads, starts, samples, states, c, by_candidate, dt, substeps, taps, rectify,
    targets, weights, costs, responses, power, limits, loops,
):  # fmt: skip
    """Simulate and score a batch of candidates in one pass, over each of some stretches.

    Parameters
    ----------
    k : (B, 8) array, fault vectors; B a multiple of `LANES`
    commands, loads : (S,) arrays at the samples of the record, on the motor shaft; straight lines
    starts : (N,) samples at which the stretches begin, of ``samples`` each
    states : (N, 7) array, the fields of `MonitorState` there
    by_candidate : None; or (B, 32) array, the fields of `Constants` of each candidate, in place of
        ``c``, which all share. numba compiles the cases apart, so that these stay scalars
    dt : step, s; ``substeps`` from one sample to the next
    taps : (N, 7) array, low-pass ``b0 b1 b2 a1 a2`` and its state ``z1 z2`` at each start
    rectify : bool, compare the magnitude of the current
    targets, weights : (S,) arrays, filtered current of the record (A) and weight of each sample
    costs : (N, B) array, filled with sum(weight (target - filtered current)^2) of the samples after
        the first; infinite where a candidate diverged or has passed its limit
    responses : (N, B, K) array, filled with every ceil(samples/K)-th filtered current; K may be 0
    power : None; or a pair: (N, 2) array, state of the low-pass of the electrical power at each
        start, and (N, B, K) array, filled with as many samples of the power, W
    limits : (B,) costs above which a candidate is not wanted. Costs only rise, so that it is
        simulated only until that shows, unless responses are kept; others are the same bit for bit
    loops : None where shorted turns are missing; or (N, 4) array, the fields of `Loops` at the
        first sample of each stretch
    """
    wide_vectors()
    keep = responses.shape[2] > 0
    stride = (samples + responses.shape[2] - 1) // responses.shape[2] if keep else 1
    share = 1.0 / substeps
    low_pass = taps[0, 0], taps[0, 1], taps[0, 2], taps[0, 3], taps[0, 4]
    own = new_constants()
    faults = new_faults()
    pairs = new_pairs()
    held = np.empty((_HELD, LANES))
    looped = held[_LOOPS:]
    total, energy, y1, y2 = np.empty(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES)
    # the load of each lane, which may be late: by how many samples, and by which part of one
    late, late_part = np.empty(LANES, np.int64), np.empty(LANES)
    late_next, late_load = np.empty(LANES), np.empty(LANES)
    late_end, d_late = np.empty(LANES), np.empty(LANES)
    rate = 1.0 / (dt * substeps)
    left = np.empty(k.shape[0], np.int64)  # the candidates whose cost is still wanted
    saved = np.empty((k.shape[0], _HELD))
    # samples after which ranks are closed; 64 saves no more, 512 less
    limited = False
    for n in range(k.shape[0]):  # the minimum of an array would load half of numba
        limited |= limits[n] < math.inf
    segment = 128 if limited and not keep else samples
    for s in range(starts.size):
        here = starts[s]
        command, load = commands[here : here + samples], loads[here : here + samples]
        target, weight = targets[here : here + samples], weights[here : here + samples]
        count = k.shape[0]
        for n in range(count):
            left[n] = n
            for m in range(_Z1):
                saved[n, m] = states[s, m]
            if loops is not None:
                for m in range(4):
                    saved[n, _LOOPS + m] = loops[s, m]
            saved[n, _Z1] = taps[s, 5]
            saved[n, _Z2] = taps[s, 6]
            saved[n, _COST] = 0.0
        for begin in range(1, samples, segment):
            end = min(begin + segment, samples)
            for first in range(0, count, LANES):
                for n in range(LANES):
                    who = left[min(first + n, count - 1)]  # the last one fills the lanes of a block
                    v = k[who]
                    half_gap_n = c.half_gap
                    # A NaN anywhere in the vector must show: as a friction it would only hold all
                    # at rest.
                    nothing = 0.0
                    for m in range(v.size):
                        nothing += 0.0 * v[m]
                    if by_candidate is not None:
                        for m in range(len(c)):
                            own[m, n] = by_candidate[who, m]
                            nothing += 0.0 * own[m, n]
                        half_gap_n = own[HALF_GAP, n]
                        if not math.isfinite(own[LOAD_DELAY, n]):
                            own[LOAD_DELAY, n] = 0.0  # no place in an array; the cost shows it
                        place = -own[LOAD_DELAY, n] * rate
                        whole = math.floor(min(max(place, -float(samples)), float(samples)))
                        late[n] = int(whole)
                        late_part[n] = min(max(place - whole, 0.0), 1.0)
                        now_at = at(load, begin - 1 + late[n])
                        late_next[n] = at(load, begin + late[n])
                        late_end[n] = now_at + late_part[n] * (late_next[n] - now_at)
                    f = fault_state(v, half_gap_n)
                    write_fault(faults, n, f)
                    c_n = c if by_candidate is None else read_constants(own, n)
                    write_pairs(pairs, n, pairs_of(f, c_n))
                    for m in range(_HELD):
                        held[m, n] = saved[who, m]
                    held[_COST, n] += nothing
                    if power is not None:
                        y1[n] = power[0][s, 0]
                        y2[n] = power[0][s, 1]
                if keep:
                    responses[s, first : first + LANES, 0] = target[0]
                    if power is not None:
                        power[1][s, first : first + LANES, 0] = 0.0  # the start counts nothing
                for sample in range(begin, end):
                    total[:] = 0.0
                    if power is not None:
                        energy[:] = 0.0
                    d_command = (command[sample] - command[sample - 1]) * share
                    d_load = (load[sample] - load[sample - 1]) * share
                    if by_candidate is not None:
                        for n in range(LANES):
                            now_at = late_next[n]
                            late_next[n] = at(load, sample + 1 + late[n])
                            late_load[n] = late_end[n]
                            late_end[n] = now_at + late_part[n] * (late_next[n] - now_at)
                            d_late[n] = (late_end[n] - late_load[n]) * share
                    for j in range(substeps):
                        command_now = command[sample - 1] + (j + 0.5) * d_command
                        load_now = load[sample - 1] + (j + 0.5) * d_load
                        for n in range(LANES):
                            if by_candidate is None:
                                c_n = c
                            else:
                                c_n = read_constants(own, n)
                                load_now = late_load[n] + (j + 0.5) * d_late[n]
                            load_n = c_n.load_gain * load_now + c_n.load_offset
                            now, fault = read_state(held, n), read_fault(faults, n)
                            if loops is None:
                                now, p_mean = monitor_step(
                                    now, command_now, load_n, fault, read_pairs(pairs, n), c_n, dt
                                )
                            else:
                                now, now_loops, p_mean = looped_monitor_step(
                                    now, read_loops(looped, n), command_now, load_n, fault, c_n, dt
                                )
                                write_loops(looped, n, now_loops)
                            write_state(held, n, now)
                            total[n] += now.i
                            if power is not None:
                                energy[n] += p_mean
                    for n in range(LANES):
                        x = total[n] * share
                        x = abs(x) if rectify else x
                        total[n], held[_Z1, n], held[_Z2, n] = biquad(
                            x, held[_Z1, n], held[_Z2, n], low_pass
                        )
                        error = target[sample] - total[n]
                        held[_COST, n] += weight[sample] * error * error
                    if power is not None:
                        for n in range(LANES):
                            energy[n], y1[n], y2[n] = biquad(
                                energy[n] * share, y1[n], y2[n], low_pass
                            )
                    if keep and sample % stride == 0:
                        for n in range(LANES):
                            responses[s, first + n, sample // stride] = total[n]
                        if power is not None:
                            for n in range(LANES):
                                power[1][s, first + n, sample // stride] = energy[n]
                for n in range(LANES):
                    who = left[min(first + n, count - 1)]
                    for m in range(_HELD):
                        saved[who, m] = held[m, n]
            wanted = 0
            for n in range(count):
                who = left[n]
                if saved[who, _COST] <= limits[who]:  # false for NaN too: it would stay so
                    left[wanted] = who
                    wanted += 1
            count = wanted
        for n in range(k.shape[0]):
            wanted_cost = saved[n, _COST] <= limits[n] and math.isfinite(saved[n, _COST])
            costs[s, n] = saved[n, _COST] if wanted_cost else math.inf
