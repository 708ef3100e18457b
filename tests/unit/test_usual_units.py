"""The factors of usual units are those of pint."""

import pint
import pytest

from ematwin.errors import ParameterError
from ematwin.quantities import _USUAL, to_si

REGISTRY = pint.UnitRegistry(cache_folder=None)


@pytest.mark.parametrize(
    ("spelled", "proper"),
    [
        ("gcm²", "g*cm^2"), ("gcm2", "g*cm^2"), ("g cm²", "g*cm^2"), ("gcm^2", "g*cm^2"),
        ("kgcm²", "kg*cm^2"), ("kg cm2", "kg*cm^2"), ("kgm²", "kg*m^2"), ("kgmm²", "kg*mm^2"),
    ],
)  # fmt: skip
def test_inertias_may_be_spelled_as_on_data_sheets(spelled, proper) -> None:
    assert to_si(33.3, spelled, "kg*m^2", "it") == pytest.approx(
        float(REGISTRY.Quantity(33.3, proper).to("kg*m^2").magnitude), rel=1e-12
    )


def test_a_mass_in_another_power_of_length_is_refused() -> None:
    for unit in ("gcm", "gcm3", "gcm20", "kgs2"):
        with pytest.raises(ParameterError, match="must have a unit of the kind"):
            to_si(1.0, unit, "kg*m^2", "it")


@pytest.mark.parametrize(("unit", "si_unit"), _USUAL)
@pytest.mark.parametrize("value", [0.72, 25.0, 1.0 / 3.0, 8000.0])
def test_a_usual_unit_gives_to_the_last_bit_what_pint_gives(unit, si_unit, value) -> None:
    expected = float(REGISTRY.Quantity(value, unit).to(si_unit).magnitude)
    assert to_si(value, unit, si_unit, "it") == expected
