"""Whole simulations, step by step, against the plain loops in ``tests/naive``."""

import numpy as np
import pytest

from bldc_inputs import FORMS, SEVERE, history
from ematwin.models.bldc import batch
from ematwin.models.bldc.constants import (
    Truer,
    TruerState,
    kernel_constants,
    truer_constants,
)
from ematwin.models.bldc.faults import PAPER_CASES, Faults
from ematwin.models.bldc.parameters import BldcActuator
from naive import monitor as naive_monitor
from naive import reference as naive_reference

ACTUATOR = BldcActuator.load()
C = kernel_constants(ACTUATOR)


@pytest.mark.parametrize(
    ("values", "form"),
    [({}, {}), (SEVERE, {}), (SEVERE, FORMS["eccentricity"])],
    ids=["healthy", "all faults", "offset that turns in part"],
)
def test_reference_model_is_that_of_the_naive_loop(values, form):
    actuator = ACTUATOR.changed(form)
    assert truer_constants(actuator) == Truer()  # such an offset is a constant of the paper's form
    faults, dt, steps = Faults(**values), 1e-6, 12_000
    command, load = history(steps, dt)
    rest = np.zeros(13)
    rest[7] = 1.0
    trace = batch.reference_trace(
        faults.vector, command, load, rest, kernel_constants(actuator), dt, 1, 1, Truer(),
        np.array(TruerState()),
    )  # fmt: skip
    slow = naive_reference.simulate(actuator, faults, command[:-1], load[:-1], dt)
    assert np.ptp(slow["motor"]) > 2.0  # more than one electrical sector
    np.testing.assert_allclose(trace[:, :3], slow["mean_currents"], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(trace[:, 10:13], slow["mean_voltages"], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(trace[:, 13], slow["bus_current"], rtol=0.0, atol=1e-9)
    for column, name in enumerate(("motor", "motor_speed", "output", "output_speed"), start=3):
        np.testing.assert_allclose(trace[:, column], slow[name], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("values", [{}, SEVERE, *PAPER_CASES.values()])
def test_monitor_model_is_that_of_the_naive_loop(values):
    faults, dt, steps = Faults(**values), 1e-5, 4_000
    command, load = history(steps, dt)
    trace = batch.monitor_trace(faults.vector, command, load, np.zeros(7), C, dt, 1, 1, None)
    command, load = (0.5 * (x[:-1] + x[1:]) for x in (command, load))  # of the middles
    slow = naive_monitor.simulate(ACTUATOR, faults, command, load, dt)
    assert np.ptp(slow["motor"]) > 2.0
    names = ("mean_current", "motor", "motor_speed", "output", "output_speed", "power")
    for column, name in enumerate(names):
        np.testing.assert_allclose(trace[:, column], slow[name], rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_motor_is_stopped_half_a_gap_beyond_the_end_stop_of_the_output(way):
    backlash_share = 0.2
    k = Faults(backlash=backlash_share).vector
    half_gap = C.half_gap * (1.0 + 99.0 * backlash_share)
    end = C.travel_high if way > 0.0 else C.travel_low
    command = np.full(80_001, 2.0 * end)
    trace = batch.monitor_trace(
        k, command, np.zeros_like(command), np.zeros(7), C, 1e-5, 1, 100, None
    )
    assert trace[-1, 3] == end
    assert trace[-1, 1] == pytest.approx(end + way * half_gap, rel=1e-12)
    assert trace[-1, 2] == 0.0
    assert trace[-1, 4] == 0.0
    assert trace[-1, 0] == pytest.approx(way * C.v_supply / (2.0 * C.resistance), rel=1e-2)
    assert np.abs(trace[:, 3]).max() <= abs(end)


def test_reference_output_rests_on_its_end_stop_while_the_motor_pushes():
    command = np.full(80_001, 2.0 * C.travel_high)
    rest = np.zeros(13)
    rest[7] = 1.0
    k = Faults().vector
    trace = batch.reference_trace(
        k, command, 0.0 * command, rest, C, 1e-6, 10, 100, Truer(), np.array(TruerState())
    )
    assert trace[-1, 5] == C.travel_high
    assert trace[-1, 6] == 0.0
    # the motor stands where its torque bends the contact
    pushing = trace[-1, 3] - C.travel_high - C.half_gap
    torque = 2.0 * C.k_e * C.v_supply / (2.0 * C.resistance)
    assert pushing == pytest.approx(torque / C.contact_stiffness, rel=0.05)
