"""The brushless actuator sample by sample: the reference and the monitor model.

As in `ematwin.models.bldc.batch`: constants are the constants of the kernels, the fault, the first
position of the output, the truer forms, and pairs. The currents of a sample are means since the one
before.
"""

from collections.abc import Mapping
from typing import Any

from ematwin.models.bldc import batch
from ematwin.models.bldc.constants import (
    Constants,
    FaultState,
    Truer,
    TruerState,
    fault_state,
    kernel_constants,
    truer_constants,
)
from ematwin.models.bldc.monitor_step import (
    MonitorState,
    Pairs,
    looped_monitor_step,
    monitor_step,
    pairs_of,
)
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.reference_step import (
    ReferenceState,
    last_reading,
    read_angle,
    reference_step,
)
from ematwin.models.bldc.simulate import TimeGrid
from ematwin.models.bldc.unknowns import FAULTS, FIXED
from ematwin.models.stepped import Stepped, initial_position
from ematwin.numerics.compile import part, plain
from ematwin.numerics.lanes import columns

_FAULT = len(Constants._fields)  # where it begins in the constants
_START = _FAULT + len(FaultState._fields)
_TRUER = _START + 1
_PAIRS = _TRUER + len(Truer._fields)
_READ = TruerState._fields.index("read")


def stepped(actuator: BldcActuator, fidelity: str, rate: float) -> Stepped:
    """The actuator at rest, then sample by sample at a rate (Hz)."""
    longest = getattr(actuator.steps, fidelity)
    grid = TimeGrid(longest, 2.0 / rate, rate)
    substeps = grid.substeps * grid.decimation

    def constants(candidates: Mapping[str, Any]) -> list[Any]:
        own = actuator.varied(candidates, FIXED)
        c = kernel_constants(own)
        fault = plain(fault_state)([candidates[name] for name in FAULTS], c.half_gap)
        pairs = plain(pairs_of)(fault, c) if fidelity == "monitor" else ()
        return [*c, *fault, candidates["initial_position"], *truer_constants(own), *pairs]

    make = _reference if fidelity == "reference" else _monitor
    return Stepped(
        inputs=("command", "load"), constants=constants, interval=1.0 / rate, substeps=substeps,
        starts=(initial_position(actuator),), **make(actuator, grid.step, substeps),
    )  # fmt: skip


def _monitor(actuator: BldcActuator, dt: float, substeps: int) -> dict[str, Any]:
    ratio, share = actuator.transmission.ratio, 1.0 / substeps
    looped = actuator.shorted_turns is not None
    loops = len(MonitorState._fields)
    total = loops + 4

    @part
    def begin(c, u, x):
        x[:, 0] = 0.0
        x[2, 0] = x[4, 0] = c[_START, 0] * ratio

    @part
    def sample(c, x, u, n, y):
        now = batch.read_state(x, 0)
        y[0, 0] = x[total, 0]
        y[1, 0], y[2, 0] = now.theta_m, now.w_m
        y[3, 0], y[4, 0] = now.theta_o / ratio, now.w_o / ratio
        x[total, 0] = 0.0

    @part
    def advance(c, x, u):
        own, fault = batch.read_constants(c, 0), batch.read_fault(c[_FAULT:], 0)
        now, command = batch.read_state(x, 0), u[0, 0] * ratio
        load = own.load_gain * (u[1, 0] / ratio) + own.load_offset
        if looped:
            now, after, _ = looped_monitor_step(
                now, batch.read_loops(x[loops:], 0), command, load, fault, own, dt
            )
            batch.write_loops(x[loops:], 0, after)
        else:
            pairs = batch.read_pairs(c[_PAIRS:], 0)
            now, _ = monitor_step(now, command, load, fault, pairs, own, dt)
        batch.write_state(x, 0, now)
        x[total, 0] += share * now.i

    return {
        "begin": begin, "sample": sample, "advance": advance, "at": (0.5, 0.5),
        "outputs": batch.MONITOR_COLUMNS[:5], "state_count": total + 1,
        "constant_count": _PAIRS + len(Pairs._fields),
    }  # fmt: skip


_, read_truer, _ = columns(Truer)


def _reference(actuator: BldcActuator, dt: float, substeps: int) -> dict[str, Any]:
    ratio, share = actuator.transmission.ratio, 1.0 / substeps
    more = len(ReferenceState._fields)
    total = more + len(TruerState._fields)

    @part
    def begin(c, u, x):
        x[:, 0] = 0.0
        start = c[_START, 0] * ratio
        x[4, 0] = x[6, 0] = start
        x[7, 0] = 1.0
        x[more + _READ, 0] = last_reading(read_truer(c[_TRUER:], 0), start, 0.0)

    @part
    def sample(c, x, u, n, y):
        now = batch.read_reference(x, 0)
        for m in range(3):
            y[m, 0] = x[total + m, 0]
            x[total + m, 0] = 0.0
        forms = read_truer(c[_TRUER:], 0)
        y[3, 0] = read_angle(now.theta_m, forms.motor_step, forms.count_offset)
        y[5, 0] = read_angle(now.theta_o, forms.output_step, forms.count_offset) / ratio
        y[4, 0], y[6, 0] = now.w_m, now.w_o / ratio

    @part
    def advance(c, x, u):
        own, fault = batch.read_constants(c, 0), batch.read_fault(c[_FAULT:], 0)
        now, command, load = batch.read_reference(x, 0), u[0, 0] * ratio, u[1, 0] / ratio
        now, after, means, _ = reference_step(
            now, batch.read_more(x[more:], 0), command, load, fault, own,
            read_truer(c[_TRUER:], 0), dt,
        )  # fmt: skip
        batch.write_reference(x, 0, now)
        batch.write_more(x[more:], 0, after)
        for m in range(3):
            x[total + m, 0] += share * means[m]

    return {
        "begin": begin, "sample": sample, "advance": advance, "at": (0.0, 0.0),
        "outputs": batch.REFERENCE_COLUMNS[:7], "state_count": total + 3,
        "constant_count": _PAIRS,
    }  # fmt: skip
