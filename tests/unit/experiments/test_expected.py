"""Expected posterior of a command, beside that which `identify` finds."""

import numpy as np
import pytest

import ematwin
from ematwin.recordings.noise import Noise

MIDDLE = {
    "friction": 0.3, "backlash": 0.3, "short_a": 0.2, "short_b": 0.3, "short_c": 0.4,
    "eccentricity": 0.3, "eccentricity_phase": 0.3, "gain": 0.4,
}  # fmt: skip
MAGNITUDES = [name for name in MIDDLE if name != "eccentricity_phase"]


def told(noise):
    return ematwin.identifiability(faults=MIDDLE, noise=Noise(white=noise), exact=True, threads=1)


def test_it_is_the_standard_error_that_identify_states():
    record = ematwin.simulate("reference", faults=MIDDLE, noise=Noise(white=0.02), seed=8)
    found, expected = ematwin.identify(record, exact=True, threads=1), told(0.02)
    ratios = [expected[n].error / found.estimate.standard_errors[n] for n in MAGNITUDES]
    assert 0.8 < float(np.median(ratios)) < 1.3
    assert all(0.4 < one < 2.5 for one in ratios)


def test_noise_errs_in_proportion():
    loud, louder = told(0.2), told(0.4)
    for name in MAGNITUDES:
        assert louder[name].error == pytest.approx(2.0 * loud[name].error, rel=0.15)
