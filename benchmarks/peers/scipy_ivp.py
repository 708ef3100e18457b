"""scipy's integrators, one candidate at a time: fixed steps of the twin, and LSODA with its own.

*Fixed*: `solve_ivp` with the twin's step as a method of its own (an `OdeSolver` whose step is
`scalar_step.advance`, in plain Python). scipy's own fixed formulas would need smooth right-hand
sides, which stops, impacts and stiction are not.

*Free*: LSODA integrates the differential equations that the step is a scheme of, made smooth: a
compiled right-hand side; friction as a steep function of the speed with a peak for stiction, the
contact as the spring and damper of the reference model, the current as a short lag. Through
`solve_ivp` (a Python loop over the steps) and `odeint` (the loop inside ODEPACK).
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from benchmarks.peers.scalar_step import advance, electrics_of_step, wanted_speed
from benchmarks.peers.task import Task, scored
from numba import njit
from scipy.integrate import OdeSolver, odeint, solve_ivp

# Both chosen for speed on random fault vectors: costs stay within 1 % of the twin's, but where the
# motor all but stalls (two phases nearly lost) and friction decides: 6 % there, and 24 % with a
# creep of 0.2 rad/s. A hundredth of the tolerance takes five times as long and leaves 4 %.
CREEP = 0.05  # rad/s, at which dynamic friction is reached; stiction peaks at twice of it
LAG = 1e-5  # s, of the current behind its reference
TOLERANCES = {"rtol": 1e-3, "atol": 1e-5}


class TwinStep(OdeSolver):
    """The twin's step as a method of `solve_ivp`; the last state is the charge, A s."""

    def __init__(
        self, fun: Any, t0: float, y0: Any, t_bound: float, vectorized: bool, **options: Any
    ) -> None:
        super().__init__(fun, t0, y0, t_bound, vectorized)
        self.dt, self.inputs = options["dt"], options["inputs"]
        self.m, self.c = options["magnitudes"], options["plant"]
        self.count = 0

    def _step_impl(self) -> tuple[bool, None]:
        *before, charge = self.y.tolist()
        state = advance(*before, *self.inputs[self.count], self.m, self.c, self.dt)
        self.y = np.array([*state, charge + state[0] * self.dt])
        self.count += 1
        self.t = self.count * self.dt if self.count < len(self.inputs) else self.t_bound
        return True, None


def fixed(task: Task, k: np.ndarray) -> np.ndarray:
    """Costs (B,) by `solve_ivp` at the twin's own step."""
    steps = (np.arange((task.target.size - 1) * task.substeps) + 0.5) / task.substeps
    places = np.arange(task.target.size)
    inputs = np.column_stack(
        [np.interp(steps, places, task.command), np.interp(steps, places, task.load)]
    ).tolist()
    currents = []
    for m in task.each(k):
        found = solve_ivp(
            lambda t, y: y, (0.0, task.simulated), [*task.start, 0.0], method=TwinStep,
            dt=task.step, inputs=inputs, magnitudes=m, plant=task.plant,
        )  # fmt: skip
        currents.append(np.diff(found.y[-1, :: task.substeps]) / (task.step * task.substeps))
    return scored(np.array(currents), task)


@njit(error_model="numpy")
def friction(w, static, dynamic):
    """Dry friction made smooth: near Borello's, with a creep in place of rest."""
    v = w / CREEP
    # v exp((1 - v^2/4)/2)/2 is 1 at its peak, v = 2
    return dynamic * math.tanh(v) + (static - dynamic) * 0.5 * v * math.exp(0.5 - v * v / 8.0)


@njit(error_model="numpy")
def right_hand_side(t, y, m, c, command, load, interval):
    """Derivatives of ``i w_m x_m w_o x_o charge``."""
    place = min(max(t / interval, 0.0), command.size - 1.0)
    n = min(int(place), command.size - 2)
    part = place - n
    command_now = command[n] + part * (command[n + 1] - command[n])
    load_now = load[n] + part * (load[n + 1] - load[n])
    i, w_m, x_m, w_o, x_o = y[0], y[1], y[2], y[3], y[4]
    resistance, inductance, kappa = electrics_of_step(x_m, 0.0, m, c)
    drop = resistance * i + kappa * w_m
    wanted = c.k_speed * (wanted_speed(command_now, x_o, m, c) - w_m) / (2.0 * c.k_e)
    wanted = min(max(wanted, -c.current_limit), c.current_limit)
    voltage = inductance * (wanted - i) / LAG + drop
    voltage = min(max(voltage, -c.supply), c.supply)
    dynamic_m = m.friction * c.t_m
    static_m = max(dynamic_m, c.static_ratio * dynamic_m - kappa * c.half_band)
    share = c.c_opposing if w_o * load_now > 0.0 else c.c_aiding
    dynamic_o = m.friction * (c.t_o + share * abs(load_now))
    twist = x_m - x_o
    squeeze = c.stiffness * (twist - min(max(twist, -m.half_gap), m.half_gap))
    push = squeeze + c.damping * (w_m - w_o)
    push = 0.0 if squeeze == 0.0 else (max(push, 0.0) if squeeze > 0.0 else min(push, 0.0))
    rate = np.empty(6)
    rate[0] = (voltage - drop) / inductance
    rate[1] = (kappa * i - c.viscous * w_m - friction(w_m, static_m, dynamic_m) - push) / c.j_m
    rate[2] = w_m
    rate[3] = (push - load_now - friction(w_o, c.static_ratio * dynamic_o, dynamic_o)) / c.j_o
    rate[4] = w_o
    rate[5] = i
    return rate


def lsoda(task: Task, k: np.ndarray) -> np.ndarray:
    """Costs (B,) by `solve_ivp(method="LSODA")`."""

    def charges(start: list[float], times: np.ndarray, args: tuple[object, ...]) -> np.ndarray:
        found = solve_ivp(
            right_hand_side, (0.0, times[-1]), start, method="LSODA", t_eval=times, args=args,
            **TOLERANCES,
        )  # fmt: skip
        return np.asarray(found.y[5])

    return _by_free_steps(task, k, charges)


def lsoda_inside(task: Task, k: np.ndarray) -> np.ndarray:
    """Costs (B,) by `odeint`, whose loop over the steps is compiled."""

    def charges(start: list[float], times: np.ndarray, args: tuple[object, ...]) -> np.ndarray:
        found = odeint(
            right_hand_side, start, times, tfirst=True, mxstep=100_000, args=args, **TOLERANCES
        )
        return np.asarray(found[:, 5])

    return _by_free_steps(task, k, charges)


def _by_free_steps(
    task: Task,
    k: np.ndarray,
    charges: Callable[[list[float], np.ndarray, tuple[object, ...]], np.ndarray],
) -> np.ndarray:
    """Costs (B,) from the charge (S,) that has flowed at each sample."""
    interval = task.step * task.substeps
    times = np.arange(task.target.size) * interval
    start = [*task.start[:5], 0.0]
    each = [
        charges(start, times, (m, task.plant, task.command, task.load, interval))
        for m in task.each(k)
    ]
    return scored(np.diff(np.array(each), axis=1) / interval, task)
