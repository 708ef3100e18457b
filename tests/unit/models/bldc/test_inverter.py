"""Commutation, current regulator and bridge against closed forms and ``tests/naive``."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ematwin.models.bldc import inverter, motor
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.inverter import advance_bridge
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.compile import plain
from naive import motor as naive_motor
from naive import reference as naive_reference

ACTUATOR = BldcActuator.load()
C = kernel_constants(ACTUATOR)
terminal_voltages = plain(inverter.terminal_voltages)


@settings(max_examples=300)
@given(
    st.integers(0, 5), st.sampled_from([-1.0, 1.0]),
    st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)), st.booleans(),
    st.tuples(*[st.floats(-60.0, 60.0)] * 3), st.tuples(*[st.floats(0.05, 1.0)] * 3),
)  # fmt: skip
def test_bridge_voltages_are_those_of_a_linear_system(sector, sign, i, idle, emf, h):
    """Star point and conducting legs against a matrix solution; slopes add up to zero."""
    gates = naive_motor.gates(sector, sign)
    off = gates.index(0)
    currents = [i[0], i[1], -i[0] - i[1]]
    if idle:  # the off leg carries nothing
        driven = [k for k in range(3) if k != off]
        currents[off], currents[driven[0]], currents[driven[1]] = 0.0, i[0], -i[0]
    resistances = [x * C.resistance for x in h]
    inductances = [motor.phase_inductance(x, C.inductance, C.leakage) for x in h]
    expected = naive_reference.leg_voltages(
        gates, C.v_supply, currents, emf, resistances, inductances, ACTUATOR.drive
    )
    slopes, star = naive_reference.slopes(expected, currents, emf, resistances, inductances)
    seen, seen_star, conducts = terminal_voltages(
        [float(g) for g in gates], currents, emf, resistances, [1.0 / x for x in inductances],
        C.v_supply, C.v_diode,
    )  # fmt: skip
    if idle:
        margin = star + emf[off]
        assume(abs(margin + C.v_diode) > 1e-6)
        assume(abs(margin - C.v_supply - C.v_diode) > 1e-6)
    for leg in range(3):
        assert bool(conducts[leg]) == (expected[leg] is not None)
        if expected[leg] is not None:
            assert seen[leg] == expected[leg]
    assert seen_star == pytest.approx(star, abs=1e-7)
    assert sum(slopes) == pytest.approx(0.0, abs=1e-6)


def test_current_of_an_off_leg_runs_out_and_stays_zero():
    """After commutation, without back-EMF, the off leg decays through its diode and is done."""
    currents = np.empty((400, 3))
    i_a, i_b, i_c = 5.0, -5.0, 0.0
    r, y = C.resistance, 1.0 / C.inductance
    for n in range(400):  # a has gone off; c is driven high, b low
        (i_a, i_b, i_c), *_ = plain(advance_bridge)(
            (i_a, i_b, i_c), (0.0,) * 3, (0.0, -1.0, 1.0), ((r,) * 3, (y,) * 3), C, 1e-6
        )
        currents[n] = i_a, i_b, i_c
    ended = int(np.argmax(currents[:, 0] == 0.0))
    # the three slopes add up to zero: v_n = (V - 0.8 V)/3, and L di/dt = -0.8 V - v_n - R i
    drive = C.v_diode + (C.v_supply - C.v_diode) / 3.0
    expected = C.inductance / C.resistance * math.log1p(5.0 * C.resistance / drive)
    assert (ended + 1) * 1e-6 == pytest.approx(expected, abs=3e-6)
    assert (np.diff(currents[:ended, 0]) < 0.0).all()
    assert (currents[ended:, 0] == 0.0).all()
    np.testing.assert_allclose(currents.sum(axis=1), 0.0, atol=1e-12)
