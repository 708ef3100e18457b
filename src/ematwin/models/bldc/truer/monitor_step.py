"""One step of the monitor model with the truer forms.

As `monitor_step`, but with the EMF shapes as they are and a loop current in each phase. Of the two
phases of the sector one takes the current i, the other -i, so that with g_k = 1, -1, 0

    kappa_eq = sum g_k kappa_k,   T = kappa_eq i - sum mu_k kappa_k i_fk + T_cog.

The third phase carries no current, but its loop may. Backward Euler for the loops leaves one
equation for the equivalent current, whose inductance is what the loops leave of it in a step. Of a
step with a commutation each pair counts by its share, so that g_k lies in between.

With a current loop the supply gives the voltage that it asks for, and a phase that was not in the
last pair brings no current into the flux linkage of this one (`current_loop`).
In its steps, which are shorter, a commutation counts for a whole one.
"""

from ematwin.models.bldc.inverter import gate_signals
from ematwin.models.bldc.monitor_step import (
    Impact,
    answer_impact,
    controller_stiffness,
    move_rigidly,
    touching,
    within_ends,
)
from ematwin.models.bldc.motor import hall_sector, phase_inductance
from ematwin.models.bldc.truer.cogging import cogging_torque
from ematwin.models.bldc.truer.commutation import sector_of_step
from ematwin.models.bldc.truer.compliance import carried_share, move_compliantly
from ematwin.models.bldc.truer.current_loop import (
    advance_current_loop,
    left_of_voltage,
    run_out,
    since_commutation,
)
from ematwin.models.bldc.truer.emf import truer_emf_constants
from ematwin.models.bldc.truer.shorted_turns import loop_answer, split_short
from ematwin.models.bldc.truer.speed_loop import advance_speed_loop
from ematwin.models.bldc.truer.state import TruerState
from ematwin.numerics.compile import part
from ematwin.numerics.scalar import clip


@part
def _phase_in_pair(gate, gate_before, brings, i, w, kappa, h, mu, loop, c, truer, dt):
    """What a phase adds to the equation of the pair, and how its loop answers.

    ``brings`` is 0 where it had no current before and brings none.

    Gives ``inertia`` (H) and ``push`` (V s), with which inertia i' = push + dt u over the pair,
    ``remains`` and ``follows`` of `loop_answer`, and the inductance of the phase in the pair (H),
    all of it and that which brings a current along.
    """
    r = h * c.resistance
    turns = h * h * (1.0 - c.leakage) * c.inductance
    e = kappa * w
    remains, follows = loop_answer(mu, loop, gate_before * i, e, r, turns, truer.contact, dt)
    linked = mu * (turns + dt * r)
    size = abs(gate)
    inductance = size * phase_inductance(h, c.inductance, c.leakage)
    flux = inductance * brings
    drop = 0.5 * dt * r * size  # of the mean of both currents
    push = (flux - drop * brings) * i + gate * (linked * remains - mu * turns * loop - dt * e)
    inertia = inductance + drop - gate * gate * linked * follows
    return inertia, push, remains, follows, inductance, flux


@part
def truer_monitor_step(state, more, command, load, fault, c, truer, compliant, regulated, dt):
    """Advance the monitor model by ``dt``; arguments as in `monitor_step`.

    ``compliant`` is None for a rigid gear, ``regulated`` without a current loop: numba compiles the
    cases apart.

    Gives the state, what the truer forms add to it, and the mean electrical power of the step.
    """
    half = 0.5 * dt
    theta_mid = state.theta_m + half * state.w_m
    w_mid = state.w_m + 0.5 * state.dw_m
    h_a, mu_a = split_short(fault.h_a, truer.loops)
    h_b, mu_b = split_short(fault.h_b, truer.loops)
    h_c, mu_c = split_short(fault.h_c, truer.loops)
    kappa_a, kappa_b, kappa_c = truer_emf_constants(theta_mid, h_a, h_b, h_c, fault, c, truer)
    if regulated is None:
        sector = sector_of_step(c.pole_pairs * theta_mid, c.pole_pairs * dt * state.w_m)
    else:
        sector = hall_sector(c.pole_pairs * theta_mid)
    g_a, g_b, g_c = gate_signals(sector, 1.0)
    was_a, was_b, was_c = gate_signals(more.sector, 1.0)
    if regulated is None:
        brings_a, brings_b, brings_c = 1.0, 1.0, 1.0
    else:
        brings_a, brings_b, brings_c = was_a * was_a, was_b * was_b, was_c * was_c
    inertia_a, push_a, remains_a, follows_a, l_a, flux_a = _phase_in_pair(
        g_a, was_a, brings_a, state.i, w_mid, kappa_a, h_a, mu_a, more.loop_a, c, truer, dt
    )
    inertia_b, push_b, remains_b, follows_b, l_b, flux_b = _phase_in_pair(
        g_b, was_b, brings_b, state.i, w_mid, kappa_b, h_b, mu_b, more.loop_b, c, truer, dt
    )
    inertia_c, push_c, remains_c, follows_c, l_c, flux_c = _phase_in_pair(
        g_c, was_c, brings_c, state.i, w_mid, kappa_c, h_c, mu_c, more.loop_c, c, truer, dt
    )
    inertia = inertia_a + inertia_b + inertia_c
    push = push_a + push_b + push_c
    kappa_eq = g_a * kappa_a + g_b * kappa_b + g_c * kappa_c
    # what an ampere more makes of torque, with what the loops take of it at once
    per_ampere = kappa_eq - (
        g_a * kappa_a * mu_a * follows_a
        + g_b * kappa_b * mu_b * follows_b
        + g_c * kappa_c * mu_c * follows_c
    )

    if compliant is None:  # noqa: SIM108  # numba prunes statements
        joint = touching(state, fault)
    else:
        joint = carried_share(state, fault, c, dt)
    stiffness = per_ampere * controller_stiffness(state, joint, c, half)
    # what is sampled is that of the start of the step, and is held
    if regulated is None:  # noqa: SIM108
        held = truer.sample_time > 0.0
    else:
        held = True
    stiffness = 0.0 if held else stiffness
    demand, pending, integral, wait, late = advance_speed_loop(
        more.asked, more.pending, more.integral, more.wait, more.late,
        command, state.theta_o + (0.0 if held else half) * state.w_o,
        state.w_m if held else w_mid, c.k_position * fault.gain, c, truer, dt,
    )  # fmt: skip
    i_ref = clip((demand + stiffness * state.i) / (1.0 + stiffness), -c.i_max, c.i_max)
    if regulated is None:
        fall = state.i - (push - dt * c.v_supply) / inertia
        rise = (push + dt * c.v_supply) / inertia - state.i
        i = clip(i_ref, state.i_from - fall, state.i_from + rise)
        voltage, voltage_pending, voltage_integral = 0.0, 0.0, 0.0
        voltage_wait, voltage_late, leaving, beside, torque_beside = 0.0, 0.0, 0.0, 0.0, 0.0
    else:
        passed = state.i * (flux_a + flux_b + flux_c) / (l_a + l_b + l_c)
        since = since_commutation(c.pole_pairs * theta_mid, c.pole_pairs * state.w_m, dt)
        # it samples at the start of the step, half a step after the last current
        before = left_of_voltage(more.voltage, passed, truer)
        gained = 0.5 * ((push + dt * before) / inertia - passed)
        seen = (state.i if since < half else passed) + gained
        voltage, voltage_pending, voltage_integral, voltage_wait, voltage_late = (
            advance_current_loop(
                more.voltage, more.voltage_pending, more.voltage_integral, more.voltage_wait,
                more.voltage_late, i_ref, seen, c.v_supply, truer, dt,
            )
        )  # fmt: skip
        # from the middle of the last step, with its voltage, to that of this one
        applied = 0.5 * (before + left_of_voltage(voltage, passed, truer))
        i = (push + dt * applied) / inertia
        # commutation is seen in the middle of a step: what the current fell earlier or later
        early = (0.5 - since / dt) * (state.i - passed)
        # the leg that was switched off
        off_a, off_b, off_c = 1.0 - g_a * g_a, 1.0 - g_b * g_b, 1.0 - g_c * g_c
        switched = (off_a * was_a + off_b * was_b + off_c * was_c) * state.i
        kappa_off = off_a * kappa_a + off_b * kappa_b + off_c * kappa_c
        leaving, left = run_out(
            more.leaving if sector == more.sector else switched,
            kappa_off * w_mid, c.v_supply, c.v_diode, c.inductance, dt,
        )  # fmt: skip
        beside = early + 0.5 * left * kappa_off / c.k_e
        torque_beside = kappa_eq * early + kappa_off * left
    p_mean = i * (inertia * i - push) / dt
    loop_a = remains_a + follows_a * g_a * i
    loop_b = remains_b + follows_b * g_b * i
    loop_c = remains_c + follows_c * g_c * i

    lost = mu_a * kappa_a * loop_a + mu_b * kappa_b * loop_b + mu_c * kappa_c * loop_c
    lost_before = (
        mu_a * kappa_a * more.loop_a + mu_b * kappa_b * more.loop_b + mu_c * kappa_c * more.loop_c
    )
    passive = cogging_torque(theta_mid, truer)
    act_m = kappa_eq * i + torque_beside - lost + passive - c.viscous * w_mid
    before_m = kappa_eq * state.i - lost_before + passive - c.viscous * state.w_m
    if compliant is None:
        after, impact = move_rigidly(state, i, load, kappa_eq, act_m, before_m, fault, c, dt)
        if regulated is None:
            left = 0.0 if held else impact.left
            impact = Impact(impact.jump, left)
            after = answer_impact(after, impact, i_ref, fall, rise, per_ampere, c, dt)
        after = within_ends(after, fault, c)
    else:
        after = move_compliantly(state, i, load, kappa_eq, act_m, before_m, fault, c, dt)
    more_after = TruerState(
        loop_a, loop_b, loop_c, sector, demand, pending, integral, wait, late,
        voltage, voltage_pending, voltage_integral, voltage_wait, voltage_late, leaving, beside,
    )  # fmt: skip
    return after, more_after, p_mean
