"""Inputs of the brushless models that several tests share."""

import math
from functools import cache

import numpy as np

from ematwin.models.bldc.channels import PHASES, signed_current
from ematwin.models.bldc.model import MODEL
from ematwin.models.simulating import simulate
from ematwin.numerics.signals import LowPass
from ematwin.recordings.noise import Noise

HALF = MODEL.load_scenario(None).lasting(0.25)  # tells of each fault, in half the time
SEVERE = {
    "friction": 0.6, "backlash": 0.3, "short_a": 0.4, "short_b": 0.1, "short_c": 0.7,
    "eccentricity": 0.6, "eccentricity_phase": 0.8, "gain": 0.9,
}  # fmt: skip
# Sections that shipped actuators leave out, by their names; each form changes the answer.
FORMS = {
    "shorted_turns": {"shorted_turns.resistance": 0.1},
    "eccentricity": {"eccentricity.turning_share": 0.3},
    "emf": {"emf.rounding": 0.4, "emf.harmonic_5": 0.06, "emf.harmonic_7": -0.04},
    "torque_ripple": {
        "torque_ripple.share": 0.05, "torque_ripple.cycles": 6, "torque_ripple.phase": 0.4,
    },
    "presliding": {
        "presliding.motor_stiffness": 100.0, "presliding.output_stiffness": 150.0,
        "presliding.damping": 0.01, "presliding.stribeck_speed": 2.0,
    },
    "winding_heat": {"winding_heat.thermal_resistance": 2.0, "winding_heat.time_constant": 0.2},
    "supply": {"supply.resistance": 1.0, "supply.capacitance": 0.001},
    "cogging": {"cogging.torque": 0.003, "cogging.cycles": 12, "cogging.phase": 0.7},
    "speed_loop": {
        "speed_loop.integral_gain": 0.5, "speed_loop.sample_time": 4e-5, "speed_loop.delay": 1e-5,
    },
    "current_loop": {
        "current_loop.proportional_gain": 5.0, "current_loop.integral_gain": 9000.0,
        "current_loop.sample_time": 3e-5, "current_loop.delay": 1e-5,
        "current_loop.lost_voltage": 1.5,
    },
    "compliance": {"compliance.stiffness": 5.0, "compliance.damping": 0.003},
}  # fmt: skip
ENCODER = {
    "encoder.motor_steps": 2_000, "encoder.output_steps": 400_000, "encoder.filter_time": 1e-4,
}  # fmt: skip
ALL_FORMS = {place: value for one in (*FORMS.values(), ENCODER) for place, value in one.items()}


NOISE = Noise(white=0.02, bits=12)


@cache
def _clean(scenario, *faults):
    return simulate("reference", scenario, dict(faults))


def recorded(scenario="default", faults=None, noise=NOISE):
    """A recording by the reference model, which a process simulates once without its noise."""
    clean = _clean(scenario, *(faults or {}).items())
    return clean if noise is None else noise.apply(clean, np.random.default_rng(5))


def history(steps, dt):
    """A command (rad) and load (N m) on the motor shaft that cross the gap and turn the motor."""
    t = dt * np.arange(steps + 1)
    command = 12.0 * np.sin(2.0 * math.pi * 40.0 * t) + 5.0 * (t > 0.3 * t[-1])
    return command, np.where(t > 0.5 * t[-1], 0.05, -0.02)


def rms(x):
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(x))))


def misfit(one, other):
    """RMS of the difference, as a share of the other's."""
    return rms(one - other) / rms(other)


def signed(record):
    """Equivalent current (S,), A, of a recording by either model, with its sign."""
    current = signed_current(record, MODEL.parameters.load().motor.pole_pairs)
    return record.current if current is None else current


def with_one_current(record):
    """A recording with its signed equivalent current in place of those of the phases."""
    return record.changed(**dict.fromkeys(PHASES), current=signed(record))


def equivalent(record):
    """The same (S,), A, through the filter of a comparison."""
    return LowPass(500.0).apply(signed(record), record.sample_rate)
