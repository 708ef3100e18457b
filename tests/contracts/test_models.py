"""Every kind of actuator keeps the contract of models, and so does the example package."""

import inspect
from typing import ClassVar

import numpy as np
import pytest

from ematwin import Noise, identify, simulate
from ematwin.models.registry import load_actuator, model_of, models
from ematwin.recordings.channel import Channel
from ematwin.testing.draws import Bench
from ematwin.testing.model_contract import ModelContract
from own_model import laid_out, on_path
from reference_fmus import van_der_pol


class OfOurs(ModelContract):
    kind: ClassVar[str]

    @pytest.fixture
    def model(self):
        return models()[self.kind]


class TestBldc(OfOurs):
    kind = "bldc"
    # recordings are simulated with the reference model, and the monitor model is the twin
    healthy_misfit = 0.005
    step = "steps.monitor"
    thinned = 0.01
    units = 0  # seconds each: benchmarks/certainty.py counts them

    def test_each_fault_is_found_again(self):
        pytest.skip("seconds each: test_identify.py finds them in the cases of the paper")


class TestPmsm(OfOurs):
    kind = "pmsm"
    # recordings are simulated with the reference model, and the monitor model is the twin
    healthy_misfit = 0.002
    step = "steps.monitor"
    units = 0  # seconds each: benchmarks/certainty_kinds.py counts them

    def test_each_fault_is_found_again(self):
        pytest.skip("seconds each: test_identification.py finds them in two mixtures")


class TestBallScrew(OfOurs):
    kind = "ball-screw"
    # what current and position error seem to share is taken out, also where nothing is shared
    healthy_misfit = 0.005
    step = "steps.twin"


class TestLinearAxis(OfOurs):
    kind = "linear-axis"
    step = "steps.twin"


class TestPositionServo(OfOurs):
    kind = "position-servo"
    step = "steps.twin"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The model of the example package, laid out as pip would and found by its entry point."""
    with on_path(laid_out(tmp_path_factory.mktemp("site-packages"))):
        yield models()["dc-gearmotor"]


class TestOwnModel(ModelContract):
    step = "steps.twin"

    @pytest.fixture
    def model(self, installed):
        return installed

    @pytest.mark.parametrize("faults", [{}, {"friction": 3.0}], ids=["healthy", "faulty"])
    def test_a_late_command_and_sensors_that_are_off_are_no_faults(self, bench, faults):
        noisy = Noise(white=0.01)
        seen = simulate(actuator=bench.actuator, faults=faults, noise=noisy, seed=3)
        late = np.r_[np.full(2, seen.command[0]), seen.command[:-2]]
        for changed in ({"command": late}, {"current": 1.02 * seen.current + 0.02}):
            found = identify(seen.changed(**changed), bench.actuator)
            assert set(found.present) == faults.keys(), found.verdict.sentence


@pytest.fixture(scope="module")
def oscillator(tmp_path_factory):
    """A Reference FMU, and the file that states it."""
    return load_actuator(van_der_pol(tmp_path_factory.mktemp("oscillator") / "files"))


class TestFmu(ModelContract):
    units = 0  # half a minute: examples/reference_fmu.py counts them

    @pytest.fixture
    def model(self, oscillator):
        return model_of(oscillator)

    @pytest.fixture
    def actuator(self, oscillator):
        return oscillator


def test_every_kind_of_ours_is_tested_here():
    ours = {n for n, one in models().items() if type(one).__module__.startswith("ematwin.")}
    assert {one.kind for one in OfOurs.__subclasses__()} == ours


# The contract says what is wrong with a model that does not keep it.


def _of(change):
    """Respond to other candidates than those that were given."""

    def respond(self, actuator, inputs, candidates, count):
        given = change(candidates, count)
        return type(self).__mro__[1].respond(self, actuator, inputs, given, count)

    return {"respond": respond}


def _of_one_candidate(self, actuator, inputs, candidates, count):
    found = type(self).__mro__[1].respond(self, actuator, inputs, candidates, count)
    return {name: trace[0] for name, trace in found.items()}


BROKEN = [
    ("a_candidate_that_is_not_a_number_says_so",
     _of(lambda given, _: {k: np.nan_to_num(v, nan=1.0) for k, v in given.items()}), "to NaN"),
    ("a_batch_equals_its_candidates_one_by_one",
     _of(lambda given, n: {k: np.full(n, v.mean()) for k, v in given.items()}), "simulated alone"),
    ("parameters_differ_between_candidates",
     _of(lambda given, _: {k: v for k, v in given.items() if "." not in k}), "with_arrays"),
    ("every_compared_channel_has_a_row_for_each_candidate", {"respond": _of_one_candidate},
     r"has shape \(2001,\) where \(3, 2001\) is needed"),
    ("each_fault_can_be_seen", _of(lambda given, _: {}), "command more motion"),
    ("the_kind_is_found_by_its_name", {"kind": "dc"}, "name them alike"),
    ("channels_are_named_once_and_have_units",
     {"channels": (Channel("command", "mm", "in millimetres"),)}, "not SI"),
    ("unknowns_have_names_bounds_and_meanings", {"unknowns": lambda self, actuator: ()},
     "no unknown with the role 'fault'"),
    ("scenarios_are_shipped_and_followed", {"scenarios": lambda self: {}}, "put a TOML file"),
]  # fmt: skip


@pytest.mark.parametrize(("check", "members", "said"), BROKEN, ids=[row[0] for row in BROKEN])
def test_the_contract_says_what_is_missing(installed, check, members, said):
    model = type("Broken", (type(installed),), members)()
    given = {"model": model, "bench": Bench(model, installed.parameters.load())}
    test = getattr(ModelContract(), f"test_{check}")
    with pytest.raises(AssertionError, match=said):
        test(**{name: given[name] for name in inspect.signature(test).parameters})


def test_a_kind_that_takes_tolerances_as_exact_does_not_keep_the_contract(installed, monkeypatch):
    exact = "steps.twin", "motor.torque_constant", "motor.friction_torque", "gear.backlash"
    monkeypatch.setattr(type(installed), "fixed", exact)
    contract = ModelContract()
    contract.units = 6  # five of which show it
    with pytest.raises(AssertionError, match="check"):
        contract.test_units_within_their_tolerances_are_judged_honestly(
            Bench(installed, installed.parameters.load())
        )
