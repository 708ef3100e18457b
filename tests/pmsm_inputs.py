"""A PMSM servo as its tests set it up."""

import numpy as np

from ematwin.models.pmsm.batch import REFERENCE_COLUMNS, reference_trace
from ematwin.models.pmsm.parameters import PmsmActuator
from ematwin.models.pmsm.simulate import reference_states

ACTUATOR = PmsmActuator.load()
TICK = ACTUATOR.controller.current_time
SMOOTH = {  # what the textbook's drive does not have
    "motor.harmonic_5": 0.0, "motor.harmonic_7": 0.0, "motor.cogging_torque": 0.0,
    "motor.friction_torque": 0.0, "motor.viscous_damping": 0.0, "drive.dead_time": 0.0,
    "drive.device_drop": 0.0, "transmission.friction_torque": 0.0, "transmission.backlash": 1e-9,
    "transmission.damping": 0.0,
}  # fmt: skip


def bristles(motor, output):
    """Friction that gives before it slides, with these stiffnesses of its sides, N m/rad."""
    stiffness = {"presliding.motor_stiffness": motor, "presliding.output_stiffness": output}
    return {**stiffness, "presliding.damping": 0.01}


def healthy(actuator=ACTUATOR, **faults):
    """Values of all unknowns, healthy where they are not given."""
    from ematwin.models.pmsm.model import MODEL

    return MODEL.values_of(actuator, faults)


def reference(actuator, values, command, load, *, substeps=20):
    """Columns of the reference model by name; command and load on the motor shaft, at ticks."""
    step = actuator.controller.current_time / substeps
    c, *states = reference_states(actuator, values, 0.0, step)
    trace, *_ = reference_trace(
        np.asarray(command, float), np.asarray(load, float), *states, c, step, substeps,
        np.array(actuator.ticks), np.zeros(3), 1, len(command),
    )  # fmt: skip
    return dict(zip(REFERENCE_COLUMNS, trace.T, strict=True))


def smooth_move(actuator, duration, travel):
    """A command (rad on the motor shaft) that goes there along half a cosine, at the ticks."""
    time = np.arange(round(duration / actuator.controller.current_time) + 1)
    return 0.5 * travel * (1.0 - np.cos(np.pi * time / time[-1]))
