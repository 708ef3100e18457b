"""What is said where another form of a fault explains a recording as well, or better."""

import math
from dataclasses import replace

import numpy as np
import pytest

import ematwin
from bldc_inputs import HALF
from ematwin.estimation.rivals import Rival, weighed
from ematwin.estimation.verdict import Verdict
from ematwin.models.base import OtherForm
from ematwin.models.bldc.faults import fixed_in_space, other_forms
from ematwin.models.bldc.parameters import BldcActuator

PLAIN = BldcActuator.load()
SHORTS = ("short_a", "short_b", "short_c")
NAMED = Verdict("fault", ("short_b",), "", "Short b: fault.")
NONE = Verdict("none", (), "bad fit", "No verdict: bad fit")


LOOP = next(one for one in other_forms(PLAIN, {}) if "short_a" in one.names)


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


def test_forms_that_a_file_has_are_no_rivals():
    both = PLAIN.changed({"eccentricity.turning_share": 0.0, "shorted_turns.resistance": 0.1})
    assert len(other_forms(PLAIN, {})) == 2
    assert other_forms(both, {}) == ()
    offset, loops = (one.actuator for one in other_forms(PLAIN, {}))
    assert offset == PLAIN.changed({"eccentricity.turning_share": 0.0})
    assert loops == PLAIN.changed({"shorted_turns.resistance": 0.1})


def test_a_nearer_form_that_says_something_else_forbids_the_verdict():
    told, hints = weighed([rival(-10.0)], NAMED)
    assert (told.grade, told.faults, hints) == ("none", (), [])
    assert "eccentricity 0.2" in told.reason
    assert "[eccentricity]" in told.reason
    bare, _ = weighed([rival(-10.0, ())], NAMED)
    assert bare.reason.startswith("An eccentricity that is fixed in space explains it better")


@pytest.mark.parametrize("rise", [-4.0, 4.0])
def test_a_form_that_is_about_as_near_is_told_and_forbids_nothing(rise):
    told, (said,) = weighed([rival(rise), rival(20.0)], NAMED)
    assert said == (
        "Put [eccentricity] into the file of the actuator if it may have an eccentricity that is "
        "fixed in space."
    )
    assert told.sentence == (
        "Short b: fault. Not certain: an eccentricity that is fixed in space (eccentricity 0.2) "
        "would explain this recording about as well."
    )
    assert told.reason == told.sentence.removeprefix("Short b: fault. ")
    assert told.faults == NAMED.faults


def test_a_mixture_is_no_other_explanation_of_what_one_fault_explains():
    mixture = rival(1.0, ("short_a", "short_b", "short_c", "eccentricity"))
    assert weighed([mixture], NAMED) == (NAMED, [])


def test_a_nearer_form_of_the_same_fault_leaves_its_name():
    same = Rival(LOOP, ("short_b",), "short b 12 turns", -50.0)
    told, (said,) = weighed([same], NAMED)
    assert told == NAMED
    assert "of another size" in said


def test_a_form_without_faults_of_its_own_that_says_the_same_says_nothing():
    # lanes of another form fit a little better where a rotor all but touches
    named = Verdict("fault", ("backlash", "eccentricity"), "", "Eccentricity: fault.")
    same = Rival(LOOP, ("eccentricity",), "eccentricity 0.97", -18.0)
    assert weighed([same], named) == (named, [])
    assert weighed([replace(same, rise=0.0)], named) == (named, [])


def test_without_a_verdict_only_a_far_better_form_is_told():
    assert weighed([rival(-1.0)], NONE) == (NONE, [])
    told, (said,) = weighed([rival(-50.0)], NONE)
    assert told == NONE
    assert "far better" in said


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
