"""Archives of actuators, each exported once."""

from functools import cache

import pytest

import ematwin
from bldc_inputs import ALL_FORMS
from shared import made_once

TRUER_400 = {
    "presliding.motor_stiffness": 20.0, "presliding.output_stiffness": 30.0,
    "presliding.damping": 0.01, "winding_heat.thermal_resistance": 4.0,
    "winding_heat.time_constant": 0.1,
}  # fmt: skip


def actuator_of(name):
    """A shipped actuator; "truer" and "truer400" are servo48 and servo400 with all forms."""
    shipped, forms = {"truer": ("servo48", ALL_FORMS), "truer400": ("servo400", TRUER_400)}.get(
        name, (name, {})
    )
    return ematwin.load_actuator(shipped).changed(forms)


@pytest.fixture(scope="session")
def archive(tmp_path_factory):
    """Path of an archive, made once for each kind and fidelity."""

    @cache
    def made(name, fidelity, fmi=3):
        return made_once(
            tmp_path_factory, f"{name}-{fidelity}-{fmi}.fmu",
            lambda path: ematwin.export_fmu(actuator_of(name), path, fidelity=fidelity, fmi=fmi),
        )  # fmt: skip

    return made


@pytest.fixture(scope="session")
def actuator():
    """Gives an actuator by its name in these tests."""
    return actuator_of
