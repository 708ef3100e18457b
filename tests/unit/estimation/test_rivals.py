"""What is said where another form of a fault explains a recording as well, or better."""

import math

import numpy as np
import pytest

import ematwin
from bldc_inputs import HALF
from ematwin.estimation.rivals import Rival, weighed
from ematwin.estimation.verdict import Verdict
from ematwin.models.bldc.faults import fixed_in_space, other_forms
from ematwin.models.bldc.parameters import BldcActuator

PLAIN = BldcActuator.load()
SHORTS = ("short_a", "short_b", "short_c")


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


OFFSET, LOOP = other_forms(PLAIN, {})
NAMED = Verdict("fault", ("short_b",), "", "Short b: fault.")
BOTH = Verdict("fault", ("backlash", "eccentricity"), "", "Eccentricity: fault.")
NONE = Verdict("none", (), "bad fit", "No verdict: bad fit")
WEIGHED = {
    "nearer, and another fault": (OFFSET, ("eccentricity",), -10.0, NAMED, "none", "explains it"),
    "nearer, and no fault": (OFFSET, (), -10.0, NAMED, "none", "explains it better"),
    "as near": (OFFSET, ("eccentricity",), 4.0, NAMED, "fault", "Put [eccentricity] with"),
    "hardly nearer": (OFFSET, ("eccentricity",), -4.0, NAMED, "fault", "Put [eccentricity] with"),
    "a mixture": (OFFSET, (*SHORTS, "eccentricity"), 1.0, NAMED, "fault", ""),
    "nearer, and the same fault": (LOOP, ("short_b",), -50.0, NAMED, "fault", "of another size"),
    "nearer, and a part of the same": (LOOP, ("eccentricity",), -18.0, BOTH, "fault", ""),
    "a bad fit, as near": (OFFSET, ("eccentricity",), -1.0, NONE, "none", ""),
    "a bad fit, far nearer": (OFFSET, ("eccentricity",), -50.0, NONE, "none", "far better"),
}


@pytest.mark.parametrize(
    ("form", "present", "rise", "given", "grade", "said"), WEIGHED.values(), ids=WEIGHED
)
def test_another_form_forbids_a_verdict_or_is_told_by_how_well_it_explains(
    form, present, rise, given, grade, said
):
    found, hints = weighed([Rival(form, present, "so much", rise)], given)
    assert found.grade == grade
    assert said in " ".join([found.reason, *hints])
    assert bool(hints or found != given) == bool(said)


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
