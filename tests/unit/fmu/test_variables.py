"""Followed calculations against the same calculations with numbers."""

import numpy as np
import pytest

from ematwin.errors import InputError
from ematwin.fmu.variables import followed, table_of
from ematwin.models.registry import load_actuator, model_of


def with_all_forms(actuator):
    """The actuator with each section that may be left out."""
    left_out = {
        f"{key}.{name}": value
        for key in type(actuator).model_fields
        if (section := type(actuator).section(key)) and getattr(actuator, key) is None
        for name, value in section.example.items()
    }
    return actuator.changed(left_out)


@pytest.mark.parametrize("forms", [False, True])
@pytest.mark.parametrize(
    "name", ["emps", "rm1605", "sts3215", "servo48", "servo48-drive", "servo400"]
)
def test_constants_of_a_kind_are_followed_exactly(name, forms):
    actuator, random = load_actuator(name), np.random.default_rng(1)
    actuator = with_all_forms(actuator) if forms else actuator
    model = model_of(actuator)
    for fidelity in model.fidelities:
        stepped = model.stepped(actuator, fidelity)
        table = table_of(model, actuator, stepped)
        settable = table.of("tunable", "fixed")
        healthy = {one.name: one.healthy for one in model.unknowns(actuator)}
        for _ in range(20):
            drawn = {
                one.name: random.uniform(one.lower, one.upper)
                if one.role == "tunable"
                else one.start * random.uniform(0.9, 1.1)
                for one in settable
            }
            expected = [float(x) for x in stepped.constants({**healthy, **drawn})]
            c = np.full((stepped.constant_count, 1), np.nan)
            table.constants_from(np.array([[x] for x in drawn.values()]), c)
            np.testing.assert_allclose(c[: len(expected), 0], expected, rtol=1e-14)


def test_faults_of_a_kind_all_reach_its_constants():
    for name in ("emps", "rm1605", "sts3215", "servo48", "servo400"):
        actuator = load_actuator(name)
        model = model_of(actuator)
        stepped = model.stepped(actuator, model.fidelities[-1])
        tunable = {one.name for one in table_of(model, actuator, stepped).of("tunable")}
        assert {one.name for one in model.faults(actuator)} <= tunable


def test_a_branch_on_a_value_is_refused():
    with pytest.raises(InputError, match="without a branch on a value"):
        followed(lambda k: [1.0 if k["a"] > 0.0 else 2.0], ["a"])
