"""Cogging: magnets are drawn to teeth, with as many cycles in a turn as both have in common.

T_cog = -A sin(N theta_m + phi_c): it does no work over a turn, whether a current flows or not. The
fundamental of what textbooks on permanent-magnet machines give as a Fourier series.
"""

from ematwin.numerics.compile import part
from ematwin.numerics.scalar import sincos


@part
def cogging_torque(theta_m, truer):
    """Cogging torque on the rotor, N m."""
    s, _ = sincos(truer.cogging_cycles * theta_m + truer.cogging_phase)
    return -truer.cogging * s
