"""Position and speed controller against the slow version in ``tests/naive``."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ematwin.models.bldc import controller
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.faults import Faults
from ematwin.models.bldc.parameters import BldcActuator
from naive import motor as naive_motor

ACTUATOR = BldcActuator.load()
C = kernel_constants(ACTUATOR)

# Products of speeds below 1e-150 rad/s underflow; no mass moves so slowly.
speeds = st.floats(1e-6, 500.0) | st.floats(-500.0, -1e-6) | st.just(0.0)
shares = st.floats(0.0, 1.0)


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), speeds, shares)
def test_controller_is_that_of_the_naive_version(command, output, w, gain):
    seen = controller.current_reference(
        command, output, w, C.k_position * (0.5 + gain), C.k_speed, C.w_max, 2.0 * C.k_e, C.i_max
    )
    expected = naive_motor.current_reference(command, output, w, Faults(gain=gain), ACTUATOR)
    assert seen == pytest.approx(expected, rel=1e-9, abs=1e-9)
