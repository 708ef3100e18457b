"""Reference and monitor model against the naive servo, which has coils and no closed forms."""

import numpy as np
import pytest

from ematwin.models.pmsm.channels import to_rotor
from ematwin.models.pmsm.simulate import monitor_columns
from naive.pmsm import servo
from pmsm_inputs import ACTUATOR, TICK, bristles, healthy, reference, smooth_move

TICKS = 240  # 24 ms: a reversal of the gap, half a turn of the motor, two electrical turns
CASES = {
    "healthy": {},
    "worn": {"friction": 0.6, "backlash": 0.7, "gain": 0.9},
    "short": {"short_b": 0.8},
    "magnets and bore": {
        "demagnetisation": 0.5, "static_eccentricity": 0.6, "static_direction": 0.3,
        "dynamic_eccentricity": 0.4, "dynamic_direction": 0.9,
    },
    "wiring and sensors": {
        "connector_a": 0.7, "connector_c": 0.3, "sensor_gain_a": 0.8, "sensor_gain_b": 0.3,
        "sensor_offset_a": 0.7, "sensor_offset_b": 0.4, "resolver_offset": 0.8,
    },
    "short beside others": {
        "short_a": 0.5, "connector_a": 0.5, "static_eccentricity": 0.5, "static_direction": 0.1,
        "sensor_gain_b": 0.7, "demagnetisation": 0.2,
    },
}  # fmt: skip


def motion():
    """Command and load at the ticks: fast out and back, under a load."""
    half = smooth_move(ACTUATOR, TICKS // 2 * TICK, 9.0)
    return np.concatenate([half, half[::-1][1:]]), np.full(2 * half.size - 1, 0.3)


def electrical(columns):
    """The angle of the drive's frame."""
    return ACTUATOR.motor.pole_pairs * columns["motor_position"]


def with_terminals(columns):
    """The columns with the voltages at the terminals in the drive's frame."""
    phases = [columns[f"terminal_voltage_{x}"] for x in "abc"]
    both = to_rotor(*phases, electrical(columns))
    return columns | dict(zip(("terminal_d", "terminal_q"), both, strict=True))


def monitor(values, command, load, step=ACTUATOR.steps.monitor, actuator=ACTUATOR):
    """Columns of the monitor model by name; command and load on the motor shaft, at ticks."""
    ratio, substeps = actuator.transmission.ratio, actuator.substeps(step)
    found = with_terminals(
        monitor_columns(actuator, values, command / ratio, load * ratio, 0.0, substeps, 1)
    )
    # in the phases themselves it leaves out the common part that space-vector modulation adds
    return {n: x for n, x in found.items() if not n.startswith("terminal_voltage")}


def gaps(one, other):
    """RMS of the differences over that of the quantity, in per cent, by name."""
    size = {name: np.sqrt(np.mean(other[name] ** 2)) for name in other}
    for kind in ("current", "voltage", "terminal"):
        size[f"{kind}_d"] = size[f"{kind}_q"]
    return {
        name: 100.0 * np.sqrt(np.mean((one[name] - other[name]) ** 2)) / size[name]
        for name in one.keys() & other.keys()
    }


@pytest.mark.parametrize("faults", CASES.values(), ids=CASES)
def test_both_models_are_the_naive_servo(faults):
    values, (command, load) = healthy(**faults), motion()
    slow = servo(ACTUATOR, values, command, load)
    fine = with_terminals(reference(ACTUATOR, values, command, load))
    for name, gap in gaps(fine, slow).items():
        assert gap < 1.0, f"reference: {name} differs by {gap:.2f} %"
    for name, gap in gaps(monitor(values, command, load), fine).items():
        assert gap < 1.0, f"monitor: {name} differs by {gap:.2f} %"
    for n, x in enumerate("abc"):
        drawn = fine[f"loop_{x}"]
        if faults.get(f"short_{x}"):
            gap = np.sqrt(np.mean((drawn - slow["loop"]) ** 2) / np.mean(slow["loop"] ** 2))
            assert gap < 0.01, f"current of the loop in phase {'abc'[n]} differs by {gap:.3f}"
        else:
            assert np.all(drawn == 0.0)


def test_reference_with_bristles_in_a_warming_winding_is_the_naive_servo():
    heat = {"winding_heat.thermal_resistance": 4.0, "winding_heat.time_constant": 0.01}
    actuator = ACTUATOR.changed(bristles(20.0, 20.0) | heat)
    values, (command, load) = healthy(friction=0.3), motion()
    slow = servo(actuator, values, command, load)
    fine = reference(actuator, values, command, load)
    without = gaps(reference(ACTUATOR, values, command, load), slow)
    for name, gap in gaps(fine, slow).items():
        assert gap < 1.0, f"{name} differs by {gap:.2f} %"
        assert without[name] > 2.0 * gap


def test_monitor_with_bristles_is_the_reference_with_them():
    actuator = ACTUATOR.changed(bristles(20.0, 40.0))
    values, (command, load) = healthy(friction=0.3), motion()
    fine = with_terminals(reference(actuator, values, command, load))
    without = gaps(monitor(values, command, load), fine)
    for name, gap in gaps(monitor(values, command, load, actuator=actuator), fine).items():
        assert gap < 1.0, f"{name} differs by {gap:.2f} %"
        assert without[name] > 1.5 * gap
