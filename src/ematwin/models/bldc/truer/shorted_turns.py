"""Shorted turns as a loop that carries a current.

A share mu of the turns of a phase is bridged by a contact of resistance R_f, through which the loop
current i_f leaves the winding. The turns of a phase share one flux; with ``l`` the share of the
inductance outside them, L' = (1 - l) L, and the EMF e of the whole phase:

    v - v_n = R (i - mu i_f) + L di/dt - mu L' di_f/dt + e,
    R_f i_f = mu R (i - i_f) + mu L' d(i - mu i_f)/dt + mu e,
    T = (e/omega) (i - mu i_f).

Two-winding form of Vaseghi, Nahid-Mobarakeh, Takorabet and Meibody-Tabar (2008), IEEE IECON,
1966-1971, with turns that are coupled perfectly, as the self-inductance of the healthy phase has it
(docs/models.md). For R_f to infinity it is a healthy phase; for R_f to zero the flux of the shorted
turns hardly changes, and i_f brakes.

A loop answers within mu^2 L'/(R_f + mu R), for few turns far below any step: both models advance
it by backward Euler,

    i_f <- remains + follows i,

with the phase current ``i`` at the end of the step.
"""

from ematwin.numerics.compile import part


@part
def split_short(h, loops):
    """Share of turns left, and share in a loop, of a phase with a share ``h`` of sound turns."""
    shorted = 1.0 - h
    return h + loops * shorted, loops * shorted


@part
def loop_answer(mu, loop, i, e, resistance, turns_inductance, contact, dt):
    """Loop current after ``dt``: ``remains`` (A) and the share it ``follows`` of the phase current.

    ``loop`` and ``i`` are the currents before, A; ``e`` is the EMF of the whole phase, V.
    """
    linked = mu * turns_inductance
    inverse = 1.0 / (mu * linked + dt * (contact + mu * resistance))
    remains = (mu * linked * loop - linked * i + dt * mu * e) * inverse
    return remains, (linked + dt * mu * resistance) * inverse
