"""Loops over time and candidates. The physics is in the steps; here is only bookkeeping.

`reference_trace` and `monitor_trace` give one whole simulation to people. `monitor_scores` gives
costs and nothing else: candidates run side by side in lanes of a processor's vector unit, one
array for each state variable, and the current is filtered, sampled and compared as it arises.
"""

import math

import numpy as np

from ematwin.kernels.compile import loop, wide_vectors
from ematwin.kernels.monitor_step import MonitorState, monitor_step
from ematwin.kernels.reference_step import ReferenceState, phase_constants, reference_step
from ematwin.kernels.state import FaultState, fault_state

LANES = 32  # candidates side by side: four AVX-512 registers hide the latency of one another

# Columns of the traces.
REFERENCE_COLUMNS = (
    "current_a", "current_b", "current_c", "motor_position", "motor_speed", "output_position",
    "output_speed", "e_electrical", "e_copper", "e_mechanical",
)  # fmt: skip
MONITOR_COLUMNS = ("current", "motor_position", "motor_speed", "output_position", "output_speed")

OK = 0
DIVERGED = 1


@loop
def reference_trace(k, command, load, initial, c, dt, substeps, decimation):
    """Simulate the reference model.

    Parameters
    ----------
    k : (8,) array, fault vector
    command, load : (G,) arrays, output command (rad) and load (N m) on the motor shaft, on a
        uniform grid; straight lines between its points
    initial : (4,) array, motor position (rad), motor speed (rad/s), output position and speed
    c : Constants
    dt : float, step, s
    substeps : int, steps from one grid point to the next
    decimation : int, grid intervals from one sample to the next

    Returns
    -------
    (S, 10) array, columns as in `REFERENCE_COLUMNS`, S = (G - 1) // decimation + 1. A current is
    the mean over the interval that ends at its sample; the first is the initial value.
    """
    fault = fault_state(k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], c.half_gap)
    phases = phase_constants(fault, c)
    state = ReferenceState(
        0.0, 0.0, 0.0, initial[1], initial[0], initial[3], initial[2], 1.0, 0.0, 0.0, 0.0
    )
    samples = (command.size - 1) // decimation + 1
    trace = np.empty((samples, 10))
    trace[0, :3] = 0.0
    trace[0, 3:7] = initial
    trace[0, 7:] = 0.0
    share = 1.0 / (substeps * decimation)
    for sample in range(1, samples):
        sum_a = 0.0
        sum_b = 0.0
        sum_c = 0.0
        for g in range((sample - 1) * decimation, sample * decimation):
            d_command = (command[g + 1] - command[g]) / substeps
            d_load = (load[g + 1] - load[g]) / substeps
            for j in range(substeps):
                before = state
                state = reference_step(
                    state, command[g] + j * d_command, load[g] + j * d_load, fault, phases, c, dt
                )
                sum_a += 0.5 * (before.i_a + state.i_a)
                sum_b += 0.5 * (before.i_b + state.i_b)
                sum_c += 0.5 * (before.i_c + state.i_c)
        trace[sample, 0] = sum_a * share
        trace[sample, 1] = sum_b * share
        trace[sample, 2] = sum_c * share
        trace[sample, 3] = state.theta_m
        trace[sample, 4] = state.w_m
        trace[sample, 5] = state.theta_o
        trace[sample, 6] = state.w_o
        trace[sample, 7] = state.e_electrical
        trace[sample, 8] = state.e_copper
        trace[sample, 9] = state.e_mechanical
    return trace


@loop
def monitor_trace(k, command, load, initial, c, dt, substeps, decimation):
    """Simulate the monitor model; arguments as in `reference_trace`.

    Returns
    -------
    (S, 5) array, columns as in `MONITOR_COLUMNS`; the current is signed.
    """
    fault = fault_state(k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], c.half_gap)
    state = MonitorState(0.0, initial[1], initial[0], initial[3], initial[2])
    samples = (command.size - 1) // decimation + 1
    trace = np.empty((samples, 5))
    trace[0, 0] = 0.0
    trace[0, 1:] = initial
    share = 1.0 / (substeps * decimation)
    for sample in range(1, samples):
        total = 0.0
        for g in range((sample - 1) * decimation, sample * decimation):
            d_command = (command[g + 1] - command[g]) / substeps
            d_load = (load[g + 1] - load[g]) / substeps
            for j in range(substeps):
                state, i_mean = monitor_step(
                    state, command[g] + j * d_command, load[g] + j * d_load, fault, c, dt
                )
                total += i_mean
        trace[sample, 0] = total * share
        trace[sample, 1] = state.theta_m
        trace[sample, 2] = state.w_m
        trace[sample, 3] = state.theta_o
        trace[sample, 4] = state.w_o
    return trace


@loop
def monitor_scores(
    k, command, load, initial, c, dt, substeps, taps, rectify, target, weight,
    costs, status, response,
):  # fmt: skip
    """Simulate and score a batch of candidates in one pass.

    Parameters
    ----------
    k : (B, 8) array, fault vectors; B a multiple of `LANES`
    command, load : (S,) arrays at the samples of the record, on the motor shaft; straight lines
        between
    initial : (5,) array, motor position, motor speed, output position, output speed, current
    c, dt : as in `reference_trace`
    substeps : int, steps from one sample to the next
    taps : (7,) array, low-pass ``b0 b1 b2 a1 a2`` and its state ``z1 z2`` at the start
    rectify : bool, compare the magnitude of the current
    target, weight : (S,) arrays, filtered current of the record (A) and weight of each sample
    costs : (B,) array, filled with sum(weight (target - filtered current)^2)
    status : (B,) integer array, filled with `OK` or `DIVERGED` (cost infinite)
    response : (B, S) array, filled with the filtered currents, or (0, 0) to keep none
    """
    wide_vectors()
    samples = target.size
    keep = response.shape[0] > 0
    share = 1.0 / substeps
    b0, b1, b2, a1, a2 = taps[0], taps[1], taps[2], taps[3], taps[4]
    friction = np.empty(LANES)
    half_gap = np.empty(LANES)
    h_a = np.empty(LANES)
    h_b = np.empty(LANES)
    h_c = np.empty(LANES)
    zeta_cos = np.empty(LANES)
    zeta_sin = np.empty(LANES)
    gain = np.empty(LANES)
    i = np.empty(LANES)
    w_m = np.empty(LANES)
    theta_m = np.empty(LANES)
    w_o = np.empty(LANES)
    theta_o = np.empty(LANES)
    total = np.empty(LANES)
    z1 = np.empty(LANES)
    z2 = np.empty(LANES)
    cost = np.empty(LANES)
    for first in range(0, k.shape[0], LANES):
        for n in range(LANES):
            v = k[first + n]
            f = fault_state(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], c.half_gap)
            friction[n] = f.friction
            half_gap[n] = f.half_gap
            h_a[n] = f.h_a
            h_b[n] = f.h_b
            h_c[n] = f.h_c
            zeta_cos[n] = f.zeta_cos
            zeta_sin[n] = f.zeta_sin
            gain[n] = f.gain
            theta_m[n] = initial[0]
            w_m[n] = initial[1]
            theta_o[n] = initial[2]
            w_o[n] = initial[3]
            i[n] = initial[4]
            z1[n] = taps[5]
            z2[n] = taps[6]
            cost[n] = 0.0
        if keep:
            response[first : first + LANES, 0] = target[0]
        for sample in range(1, samples):
            total[:] = 0.0
            d_command = (command[sample] - command[sample - 1]) * share
            d_load = (load[sample] - load[sample - 1]) * share
            for j in range(substeps):
                command_now = command[sample - 1] + j * d_command
                load_now = load[sample - 1] + j * d_load
                for n in range(LANES):
                    state, i_mean = monitor_step(
                        MonitorState(i[n], w_m[n], theta_m[n], w_o[n], theta_o[n]),
                        command_now,
                        load_now,
                        FaultState(
                            friction[n], half_gap[n], h_a[n], h_b[n], h_c[n],
                            zeta_cos[n], zeta_sin[n], gain[n],
                        ),
                        c,
                        dt,
                    )  # fmt: skip
                    i[n] = state.i
                    w_m[n] = state.w_m
                    theta_m[n] = state.theta_m
                    w_o[n] = state.w_o
                    theta_o[n] = state.theta_o
                    total[n] += i_mean
            for n in range(LANES):
                x = total[n] * share
                x = abs(x) if rectify else x
                y = b0 * x + z1[n]  # direct form II transposed
                z1[n] = b1 * x - a1 * y + z2[n]
                z2[n] = b2 * x - a2 * y
                total[n] = y
                error = target[sample] - y
                cost[n] += weight[sample] * error * error
            if keep:
                for n in range(LANES):
                    response[first + n, sample] = total[n]
        for n in range(LANES):
            finite = math.isfinite(cost[n])
            costs[first + n] = cost[n] if finite else math.inf
            status[first + n] = OK if finite else DIVERGED
