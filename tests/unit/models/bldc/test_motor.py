"""Back-EMF and phases of the motor against the slow version in ``tests/naive``."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ematwin.models.bldc import constants, motor
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.faults import Faults
from ematwin.models.bldc.monitor_step import equivalent_phase, pairs_of
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.compile import plain
from naive import monitor as naive_monitor
from naive import motor as naive_motor

ACTUATOR = BldcActuator.load()
C = kernel_constants(ACTUATOR)
BOTH = [ACTUATOR, ACTUATOR.changed({"eccentricity.turning_share": 0.3})]
angles = st.floats(-1e4, 1e4)
shares = st.floats(0.0, 1.0)


def fault(**values):
    return constants.fault_state(Faults(**values).vector, C.half_gap)


def test_sectors_are_six_of_sixty_degrees_from_thirty_on():
    for degrees in range(-720, 1081):
        expected = ((degrees - 30) % 360) // 60
        if (degrees - 30) % 60 == 0:
            continue  # rounding decides on the boundary itself
        assert motor.hall_sector(math.radians(degrees)) == expected
        assert naive_motor.sector(math.radians(degrees)) == expected


@pytest.mark.parametrize("actuator", BOTH, ids=["turning", "turning in part"])
@given(angles, shares, shares, shares, shares, shares)
def test_emf_constants_are_those_of_the_naive_version(actuator, theta, a, b, c, zeta, phase):
    values = dict(short_a=a, short_b=b, short_c=c, eccentricity=zeta, eccentricity_phase=phase)
    seen = plain(motor.emf_constants)(theta, fault(**values), kernel_constants(actuator))
    expected = naive_motor.kappa(theta, Faults(**values), actuator)
    assert seen == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("actuator", BOTH, ids=["turning", "turning in part"])
@given(angles, st.just(0.0) | st.floats(-0.5, 0.5), shares, shares, shares, shares, shares)
def test_equivalent_phase_is_the_two_conducting_phases_in_series(
    actuator, theta, moved, a, b, c, zeta, phase
):
    values = dict(short_a=a, short_b=b, short_c=c, eccentricity=zeta, eccentricity_phase=phase)
    turns = C.pole_pairs * theta / (math.pi / 3.0) - 0.5
    assume(abs(turns - round(turns)) > 1e-6 + 1e-12 * abs(turns))
    pairs, constants = plain(pairs_of)(fault(**values), C), kernel_constants(actuator)
    r, per_l, kappa = plain(equivalent_phase)(theta, moved, pairs, constants)
    expected = naive_monitor.equivalent_phase(theta, moved, Faults(**values), actuator)
    assert (r, 1.0 / per_l, kappa) == pytest.approx(expected, abs=1e-9)
