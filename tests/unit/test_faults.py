"""The eight fault parameters: names, bounds, physical magnitudes, Err%."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ematwin.errors import InputError
from ematwin.models.bldc.faults import (
    FAULTS,
    HEALTHY,
    PAPER_CASES,
    Faults,
    error_percent,
    error_percent_wrapped,
)
from ematwin.models.registry import load_actuator, model_of
from naive import signals as naive_signals

vectors = st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8).map(np.array)

# ESREL 2020 paper, Table 1: rows in its order, columns F B Na Nb Nc Z phi Gain, per cent.
TABLE_1 = [
    [25, 0, 0, 0, 0, 0, 50, 50],
    [75, 0, 0, 0, 0, 0, 50, 50],
    [0, 10, 0, 0, 0, 0, 50, 50],
    [0, 75, 0, 0, 0, 0, 50, 50],
    [0, 0, 80, 0, 0, 0, 50, 50],
    [0, 0, 30, 0, 0, 0, 50, 50],
    [0, 0, 0, 0, 0, 25, 50, 50],
    [0, 0, 0, 0, 0, 75, 50, 50],
    [0, 0, 0, 0, 0, 0, 50, 25],
    [0, 0, 0, 0, 0, 0, 50, 75],
]


def test_paper_cases_are_table_1_of_the_paper():
    vectors = [Faults(**values).vector for values in PAPER_CASES.values()]
    np.testing.assert_allclose(vectors, np.array(TABLE_1) / 100.0)


def test_no_faults_are_the_healthy_vector_of_the_paper():
    np.testing.assert_array_equal(Faults().vector, [0, 0, 0, 0, 0, 0, 0.5, 0.5])
    np.testing.assert_array_equal(Faults().vector, HEALTHY)
    assert tuple(Faults().as_dict()) == FAULTS


@pytest.mark.parametrize("value", [-0.01, 1.01, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", FAULTS)
def test_a_value_outside_zero_to_one_is_refused_with_its_name(name, value):
    with pytest.raises(InputError, match=rf"{name} must lie in \[0, 1\], received"):
        Faults(**{name: value})


def test_a_vector_of_another_length_is_refused():
    with pytest.raises(InputError, match=r"8 components .* received shape \(7,\)"):
        Faults.of(np.zeros(7))


def physical(**values):
    return {row.name: row for row in Faults(**values).physical()}


@pytest.mark.parametrize(
    ("name", "at_zero", "at_one", "unit"),
    [
        ("friction", 0.03, 0.09, "N m"),
        ("backlash", 0.005, 0.5, "rad"),
        ("short_b", 0.0, 40.0, "turns"),
        ("eccentricity", 0.0, 1.0, ""),
        ("eccentricity_phase", -180.0, 180.0, "deg"),
        ("gain", 75.0, 225.0, "1/s"),
    ],
)
def test_physical_values_are_those_of_the_paper_and_the_default_actuator(
    name, at_zero, at_one, unit
):
    for k in (0.0, 0.25, 1.0):
        row = physical(**{name: k})[name]
        assert row.value == pytest.approx(at_zero + k * (at_one - at_zero))
        assert row.unit == unit


def test_printing_marks_what_is_not_healthy_and_gives_its_unit():
    lines = str(Faults(friction=0.25)).splitlines()
    marked = [line for line in lines if line.rstrip().endswith("<")]
    assert len(lines) == 9
    assert len(marked) == 1
    assert marked[0].startswith("friction")
    assert "0.045 N m" in marked[0]


@given(vectors, vectors)
def test_err_per_cent_is_the_formula_of_the_paper(found, injected):
    expected = naive_signals.error_percent(found, injected)
    assert error_percent(found, injected) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_err_per_cent_of_known_vectors():
    injected = Faults(eccentricity=0.25).vector
    found = injected.copy()
    found[0] = 0.03
    found[7] = 0.54
    assert error_percent(found, injected) == pytest.approx(5.0)
    # the direction counts by the root of the eccentricity that is there
    found = injected.copy()
    found[6] = 0.6
    assert error_percent(found, injected) == pytest.approx(100.0 * 0.1 * 0.5)
    assert error_percent(Faults(eccentricity_phase=1.0).vector, HEALTHY) == 0.0


@given(vectors, vectors)
def test_the_wrapped_error_never_exceeds_that_of_the_paper(found, injected):
    wrapped = error_percent_wrapped(found, injected)
    assert wrapped <= error_percent(found, injected) + 1e-9
    other_end = found.copy()
    other_end[6] = 1.0 if found[6] == 0.0 else found[6]
    assert error_percent_wrapped(other_end, injected) == pytest.approx(wrapped)


def test_the_common_part_of_shorts_is_said_in_turns_and_of_connectors_in_ohms():
    for name, k, said in (("servo48", 0.1002, "4.0 turns"), ("servo400", 0.01, "ohm")):
        actuator = load_actuator(name)
        common = model_of(actuator).contrasts(actuator)[0]
        number, _ = common.said(actuator, k, 0.9 * k, 1.1 * k)
        assert number.endswith(said)
