"""The PMSM servo sample by sample, each a tick of its current loops: reference and monitor model.

As in `ematwin.models.pmsm.batch`; the drive has held its first position under the first load before
the first sample, as in `ematwin.models.pmsm.simulate`.
"""

from collections.abc import Mapping
from typing import Any

from ematwin.models.pmsm import batch
from ematwin.models.pmsm.channels import phase_values
from ematwin.models.pmsm.comparison import SETTLED
from ematwin.models.pmsm.monitor_step import (
    ControlState,
    MonitorState,
    control_step,
    monitor_step,
    terminal_currents,
)
from ematwin.models.pmsm.parameters import PmsmActuator
from ematwin.models.pmsm.reference_step import ReferenceState, leg_voltages, reference_step
from ematwin.models.pmsm.simulate import quanta_of
from ematwin.models.pmsm.unknowns import Constants, fields_of
from ematwin.models.stepped import Stepped, initial_position
from ematwin.numerics.compile import part
from ematwin.numerics.scalar import sincos

_OUTPUTS = (
    "current_a", "current_b", "current_c", "voltage_a", "voltage_b", "voltage_c",
    "motor_position", "output_position",
)  # fmt: skip
_START = len(Constants._fields)
_PHASES = part(phase_values)


def stepped(actuator: PmsmActuator, fidelity: str) -> Stepped:
    """The servo, its drive holding a position, then tick by tick."""
    tick = actuator.controller.current_time
    substeps = actuator.substeps(getattr(actuator.steps, fidelity))

    def constants(candidates: Mapping[str, Any]) -> list[Any]:
        own = fields_of(actuator, candidates, tick / substeps)
        return [*own, candidates["initial_position"]]

    make = _reference if fidelity == "reference" else _monitor
    return Stepped(
        inputs=("command", "load"), outputs=_OUTPUTS, constants=constants, interval=tick,
        substeps=substeps, at=(0.0, 0.5), constant_count=_START + 1,
        starts=(initial_position(actuator),), held=actuator.whole_ticks(SETTLED),
        **make(actuator, tick, substeps),
    )  # fmt: skip


@part
def _show(y, seen, pole_pairs, theta_m, theta_o, ratio):
    """Fill the outputs with the log of the drive."""
    angle = pole_pairs * theta_m
    y[0, 0], y[1, 0], y[2, 0] = _PHASES(seen.i_d, seen.i_q, angle)
    y[3, 0], y[4, 0], y[5, 0] = _PHASES(seen.v_d, seen.v_q, angle)
    y[6, 0] = theta_m
    y[7, 0] = theta_o / ratio


def _resting(ratio: float, loops: int) -> Any:
    """Function that fills the state at rest; the states of the loops follow those in the plant."""

    @part
    def begin(c, u, x):
        own = batch.lane(c, 0)
        theta = c[_START, 0] * ratio
        x[:, 0] = 0.0
        x[6, 0] = x[8, 0] = theta
        x[loops + 3, 0] = theta + own.resolver / own.pole_pairs
        u[0, 0] = c[_START, 0]

    return begin


def _monitor(actuator: PmsmActuator, tick: float, substeps: int) -> dict[str, Any]:
    ratio, dt = actuator.transmission.ratio, tick / substeps
    speed_ticks, position_ticks = actuator.ticks
    loops = len(MonitorState._fields)
    applied = loops + len(ControlState._fields)

    @part
    def sample(c, x, u, n, y):
        own, now, drive = batch.lane(c, 0), batch.plant_of(x, 0), batch.loops_of(x[loops:], 0)
        s, co = sincos(own.pole_pairs * now.theta_m)
        i_a, i_b, _ = terminal_currents(s, co, now)
        x[applied, 0], x[applied + 1, 0] = drive.v_alpha, drive.v_beta
        reading = now.theta_m + own.resolver / own.pole_pairs
        after, seen = control_step(
            drive, u[0, 0] * ratio, reading, now.theta_o,
            own.gain_a * i_a + own.offset_a, own.gain_b * i_b + own.offset_b,
            n % position_ticks == 0, n % speed_ticks == 0, speed_ticks, tick, own,
        )  # fmt: skip
        batch.write_loops(x[loops:], 0, after)
        _show(y, seen, own.pole_pairs, reading, now.theta_o, ratio)

    @part
    def advance(c, x, u):
        own = batch.lane(c, 0)
        load = own.load_gain * (u[1, 0] / ratio) + own.load_offset
        after = monitor_step(batch.plant_of(x, 0), x[applied, 0], x[applied + 1, 0], load, own, dt)
        batch.write_plant(x, 0, after)

    return {
        "begin": _resting(ratio, loops), "sample": sample, "advance": advance,
        "state_count": applied + 2,
    }  # fmt: skip


def _reference(actuator: PmsmActuator, tick: float, substeps: int) -> dict[str, Any]:
    ratio, dt = actuator.transmission.ratio, tick / substeps
    speed_ticks, position_ticks = actuator.ticks
    of_current, of_motor, of_output = quanta_of(actuator).tolist()
    loops = len(ReferenceState._fields)
    applied = loops + len(ControlState._fields)

    @part
    def sample(c, x, u, n, y):
        own, now, drive = batch.lane(c, 0), batch.read_reference(x, 0), batch.loops_of(x[loops:], 0)
        v_a, v_b, v_c = leg_voltages(drive.v_alpha, drive.v_beta, own.v_supply)
        x[applied, 0], x[applied + 1, 0], x[applied + 2, 0] = v_a, v_b, v_c
        after, seen, _, _, theta_m, theta_o = batch.read_by_drive(
            now, drive, u[0, 0] * ratio, of_current, of_motor, of_output,
            n % position_ticks == 0, n % speed_ticks == 0, speed_ticks, tick, own,
        )  # fmt: skip
        batch.write_loops(x[loops:], 0, after)
        _show(y, seen, own.pole_pairs, theta_m, theta_o, ratio)

    @part
    def advance(c, x, u):
        own = batch.lane(c, 0)
        load = own.load_gain * (u[1, 0] / ratio) + own.load_offset
        v_a, v_b, v_c = x[applied, 0], x[applied + 1, 0], x[applied + 2, 0]
        after = reference_step(batch.read_reference(x, 0), v_a, v_b, v_c, load, own, dt)
        batch.write_reference(x, 0, after)

    return {
        "begin": _resting(ratio, loops), "sample": sample, "advance": advance,
        "state_count": applied + 3,
    }  # fmt: skip
