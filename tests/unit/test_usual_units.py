"""The factors of usual units are those of pint."""

import pint
import pytest

from ematwin.quantities import _USUAL, to_si

REGISTRY = pint.UnitRegistry(cache_folder=None)


@pytest.mark.parametrize(("unit", "si_unit"), _USUAL)
@pytest.mark.parametrize("value", [0.72, 25.0, 1.0 / 3.0, 8000.0])
def test_a_usual_unit_gives_to_the_last_bit_what_pint_gives(unit, si_unit, value) -> None:
    expected = float(REGISTRY.Quantity(value, unit).to(si_unit).magnitude)
    assert to_si(value, unit, si_unit, "it") == expected
