"""What the reference model answers to a recorded command and load, as ideal sensors would show it.

One candidate, exact, where lanes simulate many nearly so. It is driven with the same inputs from
the same first state as the monitor model (`ematwin.models.bldc.comparison`), so that the difference
of both is what the monitor model misses.
"""

from collections.abc import Mapping

import numpy as np

from ematwin.models.bldc.channels import UNITS
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.simulate import INPUT_INTERVAL, TimeGrid, simulated
from ematwin.models.bldc.unknowns import UNKNOWNS
from ematwin.recordings.recording import Recording


def reference_answer(
    recording: Recording,
    actuator: BldcActuator,
    values: Mapping[str, float],
    start: tuple[float, float, float, float],
) -> Recording:
    """Currents, voltages and positions at the samples of a recording; NaN where it diverged.

    Parameters
    ----------
    recording : holds the command, and the load if there is one
    actuator : its parameters where ``values`` name none by their place
    values : faults, corrections of the load, and parameters of one candidate; what is not named is
        healthy or nominal
    start : speed and angle of the motor, those of the output, on the motor shaft
    """
    actuator = actuator.with_arrays({name: x for name, x in values.items() if "." in name})
    ratio, step = actuator.transmission.ratio, actuator.steps.reference
    rate, count = recording.sample_rate, len(recording)
    grid = TimeGrid(step, max(INPUT_INTERVAL, step), (count - 0.5) / rate, rate)
    time = np.arange(count) / rate
    load = np.zeros(count) if recording.load is None else recording.load
    # a command that was recorded late makes all of the twin late, and its load must be as late
    load = np.interp(grid.time - values.get("skew", 0.0), time, load)
    load = values.get("load_gain", 1.0) * load + values.get("load_offset", 0.0)
    faults = np.array([values.get(one.name, one.healthy) for one in UNKNOWNS])
    command = np.interp(grid.time, time, recording.command)
    columns = simulated("reference", faults, command * ratio, load / ratio, start, actuator, grid)
    return Recording(time, {"command": recording.command, **columns}, units=UNITS)
