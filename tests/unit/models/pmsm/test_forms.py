"""Forms of a PMSM servo that its file has otherwise, found in healthy recordings."""

import numpy as np
import pytest

from ematwin import Noise, simulate
from ematwin.estimation.forms import find_forms
from ematwin.models.pmsm.forms import equation
from ematwin.models.pmsm.model import MODEL
from pmsm_inputs import ACTUATOR, bristles

# within the tolerances of the sheet
BUILT = ACTUATOR.changed({
    "motor.resistance": 1.24, "motor.inertia": 3.15e-5, "motor.flux": 0.0507,
    "transmission.friction_torque": 0.055,
})  # fmt: skip
COGGING = {
    "motor.cogging_torque": 0.02, "motor.cogging_periods": 12, "motor.cogging_phase": 1.0,
}  # fmt: skip
HARMONICS = {"motor.harmonic_5": -0.04, "motor.harmonic_7": 0.02}


def found(**without):
    """Forms of a drive, by two healthy recordings with 1 % noise."""
    actuator = BUILT.changed(without)
    recordings = [
        simulate("reference", command, actuator=actuator, noise=Noise(white=0.01, bits=12), seed=n)
        for n, command in enumerate(("moves", "swing"))
    ]
    return find_forms(MODEL, ACTUATOR, [MODEL.compare(one, ACTUATOR) for one in recordings])


def test_cogging_harmonics_and_friction_that_gives_are_found_with_their_values():
    forms = found(**COGGING, **HARMONICS, **bristles(20.0, 20.0))
    motor, presliding = forms.actuator.motor, forms.actuator.presliding
    assert motor.cogging_periods == 12
    assert motor.cogging_torque == pytest.approx(0.02, rel=0.02)
    assert motor.cogging_phase == pytest.approx(1.0, abs=0.02)
    assert forms.values["motor.harmonic_5"] == pytest.approx(-0.04, abs=0.001)
    assert forms.values["motor.harmonic_7"] == pytest.approx(0.02, abs=0.001)
    assert presliding.motor_stiffness == pytest.approx(20.0, rel=0.15)
    assert presliding.output_stiffness == pytest.approx(20.0, rel=0.15)
    # what has a tolerance stays at its centre, also beside a form in its section
    assert motor.resistance == ACTUATOR.motor.resistance
    assert motor.inertia == ACTUATOR.motor.inertia


def test_a_small_harmonic_is_found_where_there_is_no_other_form():
    """It leaves 0.3 % of the response, and taken for none it pulls inductances by 5 %."""
    forms = found(**{"motor.harmonic_7": 0.017})
    assert not forms.found
    assert forms.absent == ("cogging", "presliding friction")
    assert forms.values["motor.harmonic_7"] == pytest.approx(0.017, abs=0.001)
    for place in ("motor.inductance_d", "transmission.friction_torque"):
        assert forms.values[place] == pytest.approx(BUILT.value(place), rel=0.02)


def test_what_a_load_cell_has_wrong_is_no_form():
    """2 % and 0.3 N m leave 1 % of a recording where they are not fitted."""
    plain = simulate("reference", "moves", actuator=ACTUATOR)
    off = plain.changed(load=plain.channels["load"] / 1.02 - 0.3)
    one = equation(MODEL.compare(off, ACTUATOR), ACTUATOR, ("motor.inertia",))
    assert np.linalg.norm(one.left(ACTUATOR, {})) < 3e-3 * one.size
