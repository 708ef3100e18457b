"""The error to be expected of each fault."""

import numpy as np
import pytest

import ematwin
from ematwin.estimation import expected
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.noise import Noise

MIDDLE = {
    "friction": 0.3, "backlash": 0.3, "short_a": 0.2, "short_b": 0.3, "short_c": 0.4,
    "eccentricity": 0.3, "eccentricity_phase": 0.3, "gain": 0.4,
}  # fmt: skip


def told(noise, **more):
    return ematwin.identifiability(
        faults=MIDDLE, noise=Noise(white=noise), exact=True, threads=1, **more
    )


@pytest.fixture(scope="module")
def quiet():
    return told(0.001)


def test_what_the_twin_misses_is_expected_more_of_the_gap_than_of_shorts(quiet):
    # the stated error widens both alike
    ratio = {name: quiet[name].expected / quiet[name].error for name in ("backlash", "short_b")}
    assert ratio["backlash"] > 2.0 * ratio["short_b"]


def test_noise_is_expected_to_err_in_proportion(quiet):
    # in a short, of which the twin misses little
    loud, louder = told(0.2), told(0.4)
    assert louder["short_b"].expected == pytest.approx(2.0 * loud["short_b"].expected, rel=0.3)
    assert loud["short_b"].expected > 5.0 * quiet["short_b"].expected


def test_uncertain_parameters_widen_what_is_expected_as_what_is_stated(quiet):
    of_sheet = ematwin.identifiability(faults=MIDDLE, noise=Noise(white=0.001), threads=1)
    gain = of_sheet["gain"]  # an alias of the nominal gain, whatever else is known
    assert gain.expected == pytest.approx(gain.error, rel=0.05)
    assert gain.expected > 50.0 * quiet["gain"].expected


def test_a_kind_without_a_finer_model_expects_noise_alone():
    actuator = load_actuator("rm1605")
    found = ematwin.identifiability(actuator=actuator, exact=True, threads=1)
    factor = model_of(actuator).model_error
    ratios = [one.expected / (one.error / factor) for one in found.told]
    assert 0.3 < float(np.median(ratios)) < 2.0


def test_where_the_misfit_is_smooth_it_does_not_matter_where_a_descent_sets_out(monkeypatch):
    far = told_of_axis()
    monkeypatch.setattr(expected, "_AWAY", 0.0)
    near = told_of_axis()
    assert [one.expected for one in far] == pytest.approx([one.expected for one in near], rel=0.05)


def test_impacts_make_no_dips_in_which_a_descent_would_end(monkeypatch):
    """They count from when they happen; counted from the next step on, they doubled some errors."""
    far = told(0.02)
    monkeypatch.setattr(expected, "_AWAY", 0.0)
    near = told(0.02)
    for name in MIDDLE:
        if name != "eccentricity_phase":
            assert far[name].expected == pytest.approx(near[name].expected, rel=0.4)


def told_of_axis():
    return ematwin.identifiability(actuator="rm1605", exact=True, threads=1).told
