"""Forms of a PMSM servo that its file has otherwise, found in healthy recordings."""

import copy

import numpy as np
import pytest

from ematwin import Noise, simulate
from ematwin.estimation.forms import find_forms
from ematwin.models.pmsm.forms import equation
from ematwin.models.pmsm.model import MODEL
from pmsm_inputs import ACTUATOR

# within the tolerances of the sheet
BUILT = ACTUATOR.changed({
    "motor.resistance": 1.24, "motor.inertia": 3.15e-5, "motor.flux": 0.0507,
    "transmission.friction_torque": 0.055,
})  # fmt: skip
COGGING = {
    "motor.cogging_torque": 0.02, "motor.cogging_periods": 12, "motor.cogging_phase": 1.0,
}  # fmt: skip
HARMONICS = {"motor.harmonic_5": -0.04, "motor.harmonic_7": 0.02}
BRISTLES = {
    "presliding.motor_stiffness": 20.0, "presliding.output_stiffness": 20.0,
    "presliding.damping": 0.01,
}  # fmt: skip


def found(**without):
    """Forms of a drive, by two healthy recordings with 1 % noise."""
    actuator = BUILT.changed(without)
    recordings = [
        simulate("reference", command, actuator=actuator, noise=Noise(white=0.01, bits=12), seed=n)
        for n, command in enumerate(("moves", "swing"))
    ]
    return find_forms(MODEL, ACTUATOR, [MODEL.compare(one, ACTUATOR) for one in recordings])


def test_cogging_harmonics_and_friction_that_gives_are_found_with_their_values():
    forms = found(**COGGING, **HARMONICS, **BRISTLES)
    print(forms.said)
    motor, bristles = forms.actuator.motor, forms.actuator.presliding
    assert motor.cogging_periods == 12
    assert motor.cogging_torque == pytest.approx(0.02, rel=0.1)
    assert motor.cogging_phase == pytest.approx(1.0, abs=0.1)
    assert motor.harmonic_5 == pytest.approx(-0.04, abs=0.004)
    assert motor.harmonic_7 == pytest.approx(0.02, abs=0.004)
    assert 10.0 < bristles.motor_stiffness < 40.0
    assert 10.0 < bristles.output_stiffness < 40.0
    # what has a tolerance stays at its centre, also beside a form in its section
    assert motor.resistance == ACTUATOR.motor.resistance
    assert motor.inertia == ACTUATOR.motor.inertia


def test_drives_side_by_side_leave_what_each_leaves_alone():
    recording = simulate("reference", "swing", actuator=BUILT, noise=Noise(white=0.01), seed=1)
    drives = [ACTUATOR.changed(form) for form in ({}, COGGING, BRISTLES, COGGING | BRISTLES)]
    compared = MODEL.compare(recording, ACTUATOR)
    together = equation(compared, ACTUATOR, ()).each(drives)
    alone = equation(compared, ACTUATOR, ())
    for drive, left in zip(drives, together, strict=True):
        np.testing.assert_allclose(left, alone.left(drive, {}), atol=1e-9)
    # a correction is that of the first drive with such friction: of itself it is the reference
    exact = copy.copy(compared.with_missed({}))
    exact.actuator = drives[2]
    size = np.linalg.norm(exact.exact_residuals({}))
    assert np.linalg.norm(together[2]) == pytest.approx(size, rel=1e-3)


def test_a_drive_that_is_as_its_file_says_has_no_other_form():
    forms = found()
    assert not forms.found
    assert forms.absent == ("cogging", "harmonics of the back-EMF", "presliding friction")
