"""Inputs of the brushless models that several tests share."""

import math

import numpy as np

from ematwin.models.bldc.model import MODEL

HALF = MODEL.load_scenario(None).lasting(0.25)  # tells of each fault, in half the time
SEVERE = {
    "friction": 0.6, "backlash": 0.3, "short_a": 0.4, "short_b": 0.1, "short_c": 0.7,
    "eccentricity": 0.6, "eccentricity_phase": 0.8, "gain": 0.9,
}  # fmt: skip


def history(steps, dt):
    """A command (rad) and load (N m) on the motor shaft that cross the gap and turn the motor."""
    t = dt * np.arange(steps + 1)
    command = 12.0 * np.sin(2.0 * math.pi * 40.0 * t) + 5.0 * (t > 0.3 * t[-1])
    return command, np.where(t > 0.5 * t[-1], 0.05, -0.02)
