"""What is said where another form of a fault explains a recording as well, or better."""

import math

import numpy as np
import pytest

import ematwin
from bldc_inputs import HALF
from ematwin.estimation.rivals import Rival, hints, objections, qualified
from ematwin.estimation.verdict import Verdict
from ematwin.models.base import OtherForm
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.unknowns import fixed_in_space

PLAIN = BldcActuator.load()
SHORTS = ("short_a", "short_b", "short_c")
NAMED = Verdict("fault", ("short_b",), "", "Short b: fault.")


def rival(rise, present=("eccentricity",)):
    form = OtherForm(
        PLAIN, "an eccentricity that is fixed in space", "[eccentricity]",
        ("eccentricity", "eccentricity_phase"), frozenset((*SHORTS, "eccentricity")), (),
    )  # fmt: skip
    return Rival(form, present, ", ".join(f"{name} 0.2" for name in present), rise)


@pytest.mark.parametrize(("zeta", "phi"), [(0.05, 0.0), (0.2, -1.3), (0.4, 3.0)])
def test_the_offset_of_three_shorts_gives_each_phase_the_same_constant(zeta, phi):
    gaps = np.array([1.0 + zeta * math.cos(phi - 2.0 * math.pi * k / 3.0) for k in range(3)])
    shorts = 1.0 - gaps / gaps.max()
    found = fixed_in_space({**dict(zip(SHORTS, shorts, strict=True)), "friction": 0.3})
    assert found["eccentricity"] == pytest.approx(zeta)
    turned = 2.0 * math.pi * (found["eccentricity_phase"] - 0.5) - phi
    assert math.cos(turned) == pytest.approx(1.0)
    assert [found[name] for name in SHORTS] == [0.0, 0.0, 0.0]
    assert found["friction"] == 0.3


def test_a_nearer_form_that_says_something_else_forbids_the_verdict():
    (said,) = objections([rival(-10.0)], NAMED)
    assert "eccentricity 0.2" in said
    assert "[eccentricity]" in said
    assert hints([rival(-10.0)], NAMED) == []
    (bare,) = objections([rival(-10.0, ())], NAMED)
    assert bare.startswith("An eccentricity that is fixed in space explains it better")


@pytest.mark.parametrize("rise", [-4.0, 4.0])
def test_a_form_that_is_about_as_near_is_told_and_forbids_nothing(rise):
    assert objections([rival(rise)], NAMED) == []
    (said,) = hints([rival(rise)], NAMED)
    assert said == (
        "Put [eccentricity] into the file of the actuator if it may have an eccentricity that is "
        "fixed in space."
    )
    told = qualified([rival(rise), rival(20.0)], NAMED)
    assert told.sentence == (
        "Short b: fault. Not certain: an eccentricity that is fixed in space (eccentricity 0.2) "
        "would explain this recording about as well."
    )
    assert told.reason == told.sentence.removeprefix("Short b: fault. ")
    assert told.faults == NAMED.faults


def test_a_form_that_explains_a_wrong_load_hardly_better_is_not_told():
    faults = {"friction": 0.6, "backlash": 0.3}
    record = ematwin.simulate("reference", HALF, faults, noise=ematwin.Noise(white=0.02, bits=12))
    found = ematwin.identify(record.changed(load=0.5 * record.load), exact=True)
    assert found.verdict.grade == "none"
    assert found.relative_misfit > 0.05
    # with loops of their own 9.2 % of the current are left, and 10.4 without
    assert not any("would explain this recording" in one for one in found.warnings)


def test_forms_that_share_the_cores_say_what_one_after_another_says():
    record = ematwin.simulate("reference", HALF, {"short_b": 0.2, "friction": 0.1}, seed=3)
    alone, shared = (ematwin.identify(record, threads=count) for count in (1, 2))
    assert alone.present == ("short_b",)  # a loop of turns may pass for it, and is asked for
    assert shared.verdict == alone.verdict
    assert shared.warnings == alone.warnings
