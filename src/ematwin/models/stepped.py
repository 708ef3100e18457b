"""A kind one sample at a time: what its loops over time do, for a simulator that steps itself.

`ematwin.models.simulating.simulate` knows the command beforehand; a co-simulation does not. Here a
kind gives the same compiled steps as functions of plain arrays, so that they can leave Python as
machine code (`ematwin.fmu`). Every array is (N, 1): one lane of `ematwin.numerics.lanes.columns`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from ematwin.models.unknown import Unknown
from ematwin.numerics.compile import part
from ematwin.numerics.lanes import columns


class Stepped(NamedTuple):
    """What an actuator is, sample by sample.

    ``begin``, ``sample`` and ``advance`` are compiled steps (`ematwin.numerics.compile.step`) on
    constants ``c``, state ``x``, inputs ``u`` and outputs ``y``, (N, 1) arrays of floats.
    """

    inputs: tuple[str, ...]  # channels in the order of ``u``; the command comes first
    outputs: tuple[str, ...]  # channels in the order of ``y``
    # ``candidates -> numbers``, the entries of ``c``. ``candidates`` hold values of unknowns and
    # starts by name and of parameters by place. It computes with them by operators and functions of
    # numpy alone: an export follows it with values that are not known yet
    constants: Callable[[Mapping[str, Any]], Sequence[Any]]
    # ``(c, u, x)``: state at rest; its values in ``u`` hold while ``held`` samples settle
    begin: Any
    sample: Any  # ``(c, x, u, n, y)`` at sample ``n``: the state after it, and its outputs
    advance: Any  # ``(c, x, u)`` over a step
    interval: float  # s, from one sample to the next
    substeps: int  # in it
    at: tuple[float, ...]  # of each input, at which share of a step it is taken
    constant_count: int  # N of ``c``
    state_count: int  # N of ``x``
    starts: tuple[Unknown, ...] = ()  # what only the start depends on
    fixed: tuple[str, ...] = ()  # places that are not followed: the grid of steps depends on them
    held: int = 0  # samples for which the start is held before the first one


def initial_position(actuator: Any) -> Unknown:
    """The position at which an actuator rests at first, rad on the output."""
    gear, meaning = actuator.transmission, "position of the output at rest before the first command"
    return Unknown(
        "initial_position", "rad", meaning, 0.0, gear.travel_low, gear.travel_high, "nuisance"
    )


def stepped_of(
    traces: Any, rest: Any, constants: Callable[[Mapping[str, Any]], Sequence[Any]], *,
    inputs: tuple[str, ...], interval: float, substeps: int,
) -> Stepped:  # fmt: skip
    """The twin of an `ematwin.numerics.lanes.Traces`, from a state at rest.

    ``rest`` is a step ``(command, c) -> state``; the others are as of `Stepped`.
    """
    _, constants_of, _ = columns(traces.constants)
    _, state_of, write_state = columns(traces.state)
    _, _, write_answers = columns(traces.answers)
    sampled, advanced, dt = traces.sampled, traces.advanced, interval / substeps

    @part
    def begin(c, u, x):
        write_state(x, 0, rest(u[0, 0], constants_of(c, 0)))

    @part
    def sample(c, x, u, n, y):
        after, shown = sampled(state_of(x, 0), u[0, 0], u[1, 0], n, constants_of(c, 0), interval)
        write_state(x, 0, after)
        write_answers(y, 0, shown)

    @part
    def advance(c, x, u):
        write_state(x, 0, advanced(state_of(x, 0), u[0, 0], u[1, 0], constants_of(c, 0), dt))

    return Stepped(
        inputs=inputs, outputs=traces.answers._fields, constants=constants, begin=begin,
        sample=sample, advance=advance, interval=interval, substeps=substeps,
        at=(0.0,) * len(inputs), constant_count=len(traces.constants._fields),
        state_count=len(traces.state._fields),
    )  # fmt: skip
