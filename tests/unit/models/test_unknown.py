"""One table says what is unknown of an actuator; everything else is derived from it."""

import pytest

from ematwin import BldcActuator
from ematwin.errors import InputError
from ematwin.models.registry import model_of
from ematwin.models.unknown import Unknown

ACTUATOR = BldcActuator.load()


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
