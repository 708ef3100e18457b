"""A brushless axis that does not exist, with days on which its friction differs a little."""

from functools import cache

import numpy as np

import ematwin
from ematwin.models.scenario import Chirp

# What the axis is, as factors on the template that a calibration starts from.
TRUTH = {"motor.friction_torque": 1.2, "transmission.friction_torque": 1.2}
RATE = 5000.0  # Hz


@cache
def axis() -> ematwin.BldcActuator:
    """The template with the parameters of `TRUTH`."""
    template = ematwin.BldcActuator.load()
    return template.changed({place: f * template.value(place) for place, f in TRUTH.items()})


@cache
def run(number: int, **fault: float) -> ematwin.Recording:
    """One recording of a day, with noise and a friction of its own."""
    return _recorded(number, axis(), fault)


def drifted(number: int) -> ematwin.Recording:
    """One recording with magnets 1 % weaker and a winding 8 % warmer."""
    known = axis()
    factors = {"motor.emf_constant": 0.99, "motor.resistance": 1.08}
    return _recorded(
        number, known.changed({place: f * known.value(place) for place, f in factors.items()}), {}
    )


def _recorded(
    number: int, actuator: ematwin.BldcActuator, fault: dict[str, float]
) -> ematwin.Recording:
    day = {"friction": abs(np.random.default_rng(number).normal(0.0, 0.02)), **fault}
    recording = ematwin.simulate(
        "reference",
        ematwin.Scenario(duration=0.15, command=[Chirp(amplitude=0.005, f_start=5.0, f_end=25.0)]),
        day,
        actuator,
        noise=ematwin.Noise(white=0.02, bits=12),
        seed=number,
        sample_rate=RATE,
    )
    return recording.changed(labels={"run": str(number)})
