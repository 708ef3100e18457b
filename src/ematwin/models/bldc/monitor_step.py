"""One step of the monitor model: one equivalent phase, rigid play, about 50 us.

docs/models.md, "Monitor model". With p and n the conducting phases of the sector,

    R_eq = R_p + R_n,  L_eq = L_p + L_n,  kappa_eq = |kappa_p| + |kappa_n|,
    L_eq di/dt = u - R_eq i - kappa_eq omega,   T = kappa_eq i,

which is exact for two conducting phases. The voltage drives the current to its reference within
the step, up to the limit of the supply. The current has no ripple here; the effect of ripple on
stiction is taken into account (`dithered_static`). The published shape functions could
not be had; these are derived here.

All of a step happens in its middle: inputs, angles, and the current, which follows the speed that
the rotor will have there (implicit midpoint). Commutations and impacts count from when they
happen (docs/models.md, "Steps").

`monitor_step` is a `part`, of steps that numba inlines: loops over it compile three times as fast
as where numba inlines all of it, and their lanes are as fast.
"""

from typing import NamedTuple

from ematwin.models.bldc.pairs import equivalent_phase
from ematwin.numerics.backlash import advance_rigid_play, stop_at_ends
from ematwin.numerics.compile import part, step
from ematwin.numerics.friction import dithered_static, loaded_friction
from ematwin.numerics.scalar import clip


class MonitorState(NamedTuple):
    """State of the monitor model."""

    i: float  # A, equivalent current, signed, mean of the last step
    w_m: float  # rad/s
    theta_m: float  # rad
    w_o: float
    theta_o: float
    dw_m: float  # rad/s, what w_m would gain in a step with the acceleration at the end of the last
    i_from: float  # A, from which the next current starts, in the middle of the last step


class Impact(NamedTuple):
    """What an impact did in a step."""

    jump: float  # rad/s, by how much it changed the speed of the motor
    left: float  # share of the step that was left, 0 without an impact


@step
def current_demand(command, theta_o, w_m, k_position, k_demand, w_max):
    """Current that position and speed loop ask for, A, before its limit.

    ``command`` and ``theta_o`` are output positions on the motor shaft, rad; ``k_demand`` is
    ``k_speed`` over the healthy torque constant, A s/rad.
    """
    w_ref = clip(k_position * (command - theta_o), -w_max, w_max)
    return k_demand * (w_ref - w_m)


@step
def touching(state, fault):
    """1 where motor and output touch, so that the current moves both; else 0."""
    apart = abs(abs(state.theta_m - state.theta_o) - fault.half_gap) > 1e-9  # rad
    return 0.0 if apart else 1.0


@step
def controller_stiffness(state, joint, c, half):
    """How much demand a torque of the motor takes back within half a step, A per N m.

    The speed in the middle is w + (dw + dt kappa (i_mean - i)/J)/2, if other torques stay: the
    speed loop responds to the torque of the same step.
    """
    moves = 0.0 if state.w_m == 0.0 else 1.0
    mobility = c.mobility_m + joint * (c.mobility_both - c.mobility_m)
    return moves * c.k_demand * half * mobility


@step
def move_rigidly(state, i, load, kappa_eq, act_m, before_m, fault, c, dt):
    """The state after motor and output have moved under torques, with a rigid contact; the impact.

    ``act_m`` acts on the motor in the middle of the step, ``before_m`` did in the step before;
    ``i`` is the new current.
    """
    td_m = fault.friction * c.t_m
    ts_m = dithered_static(c.static_ratio * td_m, td_m, kappa_eq * c.half_band)
    direction = state.w_o if state.w_o != 0.0 else state.w_m
    td_o = fault.friction * loaded_friction(direction, -load, c.t_o, c.c_opposing, c.c_aiding)
    theta_m, w_m, theta_o, w_o, gains, jump, left = advance_rigid_play(
        state.theta_m, state.w_m, state.theta_o, state.w_o, act_m, before_m, -load,
        c.mobility_m, c.mobility_o, c.mobility_both, c.share_o,
        ts_m, td_m, c.static_ratio * td_o, td_o, fault.half_gap, dt,
    )  # fmt: skip
    return MonitorState(i, w_m, theta_m, w_o, theta_o, dt * gains, i), Impact(jump, left)


@step
def within_ends(state, fault, c):
    """The state, held by the end stops."""
    theta_o, w_o = stop_at_ends(state.theta_o, state.w_o, c.travel_low, c.travel_high)
    # Contact is rigid: the stop also ends the motor's travel, half a gap further on.
    theta_m, w_m = stop_at_ends(
        state.theta_m, state.w_m, c.travel_low - fault.half_gap, c.travel_high + fault.half_gap
    )
    return MonitorState(state.i, w_m, theta_m, w_o, theta_o, state.dw_m, state.i_from)


@step
def answer_impact(state, impact, i_ref, fall, rise, kappa_eq, c, dt):
    """The state, where the current answers an impact from that instant on.

    ``i_ref`` is the reference without the impact; ``fall`` and ``rise`` are by how much the supply
    can change the current in a step, A. The current rises in the rest of the step, and pushes motor
    and output meanwhile. The next one starts from where it is at the end: from half a change
    less in the middle, so that it may change by a whole one as others do.
    """
    wanted = clip(i_ref - c.k_demand * impact.jump, -c.i_max, c.i_max) - state.i
    left = impact.left
    change = clip(wanted, -left * fall, left * rise)
    half_more = 0.5 * (rise if wanted > 0.0 else -fall)
    i_from = state.i + (change - half_more if left > 0.0 else 0.0)
    beside = 0.5 * left * change  # mean over the step
    gained = dt * c.mobility_both * kappa_eq * beside
    return MonitorState(
        state.i + beside, state.w_m + gained, state.theta_m,
        state.w_o + gained, state.theta_o, state.dw_m, i_from,
    )  # fmt: skip


@part
def monitor_step(state, command, load, fault, pairs, c, dt):
    """Advance the monitor model by ``dt``; ``command`` and ``load`` are taken in its middle.

    Gives the state, and the mean electrical power of the step.
    """
    half = 0.5 * dt
    r_eq, per_l_eq, kappa_eq = equivalent_phase(
        state.theta_m + half * state.w_m, dt * state.w_m, pairs, c
    )
    stiffness = kappa_eq * controller_stiffness(state, touching(state, fault), c, half)
    w_mid = state.w_m + 0.5 * state.dw_m
    demand = current_demand(
        command, state.theta_o + half * state.w_o, w_mid, c.k_position * fault.gain,
        c.k_demand, c.w_max,
    )  # fmt: skip
    i_ref = clip((demand + stiffness * state.i) / (1.0 + stiffness), -c.i_max, c.i_max)
    drop = r_eq * state.i + kappa_eq * state.w_m
    # u = clip(drop + l_eq (i_ref - i)/dt, -V, V), i <- i + dt (u - drop)/l_eq; the drop over r_eq
    # is that of the mean of both currents, to first order, where that is a small part of it
    per_volt = dt * per_l_eq
    reach = per_volt * max(1.0 - 0.5 * r_eq * per_volt, 0.5)
    fall, rise = reach * (c.v_supply + drop), reach * (c.v_supply - drop)
    i = clip(i_ref, state.i_from - fall, state.i_from + rise)
    p_mean = i * (r_eq * i + kappa_eq * w_mid + (i - state.i) / per_volt)

    act_m = kappa_eq * i - c.viscous * w_mid
    before_m = kappa_eq * state.i - c.viscous * state.w_m
    after, impact = move_rigidly(state, i, load, kappa_eq, act_m, before_m, fault, c, dt)
    after = answer_impact(after, impact, i_ref, fall, rise, kappa_eq, c, dt)
    return within_ends(after, fault, c), p_mean
