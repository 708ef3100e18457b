"""One table says what is unknown of an actuator; everything else is derived from it."""

import numpy as np
import pytest

from ematwin import BldcActuator, Faults
from ematwin.errors import InputError
from ematwin.models.registry import model_of
from ematwin.models.unknown import Unknown

ACTUATOR = BldcActuator.load()


def test_the_laws_are_those_of_the_kernel() -> None:
    from ematwin.models.bldc.constants import fault_state, kernel_constants

    k = [0.25, 0.5, 0.1, 0.2, 0.3, 0.4, 0.7, 0.9]
    half_gap = kernel_constants(ACTUATOR).half_gap
    state = fault_state.py_func(k, half_gap)
    told = {row.name: row.value for row in Faults.of(np.array(k)).physical(ACTUATOR)}
    torque = ACTUATOR.motor.friction_torque + ACTUATOR.transmission.friction_torque
    assert told["friction"] == pytest.approx(torque * state.friction)
    assert told["backlash"] == pytest.approx(2.0 * state.half_gap)
    assert told["short_b"] == pytest.approx(ACTUATOR.motor.turns_per_phase * (1.0 - state.h_b))
    assert told["gain"] == pytest.approx(ACTUATOR.controller.position_gain * state.gain)
    angle = np.arctan2(state.zeta_sin, state.zeta_cos)
    assert told["eccentricity_phase"] == pytest.approx(np.degrees(angle))


def test_impossible_unknowns_are_refused() -> None:
    for values, said in (
        ((2.0, 0.0, 1.0), "healthy value between"),
        ((0.5, 1.0, 0.0), "lower < upper"),
    ):
        with pytest.raises(InputError, match=said):
            Unknown("x", "", "", *values)
    with pytest.raises(InputError, match="positive lower bound"):
        Unknown("x", "", "", 0.5, 0.0, 1.0, logarithmic=True)
    with pytest.raises(InputError, match="positive spread"):
        Unknown("x", "", "", 0.5, 0.0, 1.0, spread=0.0)


def test_a_name_that_there_is_not_is_refused_with_the_closest() -> None:
    model = model_of("bldc")
    for name, close in (("fricton", "friction"), ("motor.resistence", "motor.resistance")):
        with pytest.raises(InputError, match=f"Did you mean {close}"):
            model.unknown(ACTUATOR, name)
