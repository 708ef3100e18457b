"""Archives of actuators, each exported once."""

from functools import cache

import pytest

import ematwin
from shared import made_once

# forms that shipped actuators leave out, all that the reference has
TRUER = {
    "cogging.torque": 0.003, "cogging.cycles": 12, "cogging.phase": 0.7, "emf.rounding": 0.4,
    "eccentricity.turning_share": 0.3, "shorted_turns.resistance": 0.1,
    "speed_loop.integral_gain": 0.5, "speed_loop.sample_time": 4e-5, "speed_loop.delay": 1e-5,
    "current_loop.proportional_gain": 5.0, "current_loop.integral_gain": 9000.0,
    "current_loop.sample_time": 3e-5, "current_loop.delay": 1e-5,
    "current_loop.lost_voltage": 1.5,
    "compliance.stiffness": 5.0, "compliance.damping": 0.003,
    "emf.harmonic_5": 0.06, "emf.harmonic_7": -0.04, "torque_ripple.share": 0.05,
    "torque_ripple.cycles": 6, "torque_ripple.phase": 0.4, "presliding.motor_stiffness": 100.0,
    "presliding.output_stiffness": 150.0, "presliding.damping": 0.01,
    "presliding.stribeck_speed": 2.0, "winding_heat.thermal_resistance": 2.0,
    "winding_heat.time_constant": 0.2, "supply.resistance": 1.0, "supply.capacitance": 0.001,
    "encoder.motor_steps": 4096, "encoder.output_steps": 2**20, "encoder.filter_time": 1e-5,
}  # fmt: skip


TRUER_400 = {
    "presliding.motor_stiffness": 20.0, "presliding.output_stiffness": 30.0,
    "presliding.damping": 0.01, "winding_heat.thermal_resistance": 4.0,
    "winding_heat.time_constant": 0.1,
}  # fmt: skip


def actuator_of(name):
    """A shipped actuator; "truer" and "truer400" are servo48 and servo400 with all forms."""
    shipped, forms = {"truer": ("servo48", TRUER), "truer400": ("servo400", TRUER_400)}.get(
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
