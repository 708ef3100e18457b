"""What every simulator is given: one recording, one twin, and a batch of fault vectors.

The recorded side (equivalent current, filter, weights) is prepared once, by ematwin; a peer gets it
as plain arrays. The candidates' side is the peer's: from fault vectors (B, 8) to costs (B,).
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi

from ematwin import simulate
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.faults import FAULTS
from ematwin.models.bldc.parameters import BldcActuator

CUTOFF = 500.0  # Hz
INJECTED = {"friction": 0.3, "backlash": 0.1, "short_a": 0.15, "eccentricity": 0.2}


class Plant(NamedTuple):
    """The actuator in plain numbers: SI, one phase, on the motor shaft (docs/models.md)."""

    resistance: float
    inductance: float
    leakage: float
    k_e: float
    pole_pairs: float
    supply: float  # V
    half_band: float  # A
    current_limit: float
    speed_limit: float
    k_position: float
    k_speed: float
    j_m: float
    j_o: float
    viscous: float
    t_m: float  # N m, dynamic friction
    t_o: float
    static_ratio: float
    c_opposing: float  # 1/eta_o - 1
    c_aiding: float  # 1 - eta_a
    stiffness: float  # of the contact, for those that need one
    damping: float
    low: float  # rad, end stops
    high: float


class Magnitudes(NamedTuple):
    """What fault vectors do, in the quantities of the equations; floats or (B,) arrays."""

    friction: Any  # factor
    half_gap: Any  # rad
    h_a: Any  # share of turns left
    h_b: Any
    h_c: Any
    zeta: Any
    phi: Any  # rad
    gain: Any


class Filter(NamedTuple):
    """Second-order low-pass and its state after rest at the first value."""

    b: float  # b0 = b2 = b, b1 = 2 b
    a1: float
    a2: float
    z1: float
    z2: float


@dataclass(frozen=True)
class Task:
    """A recording and its twin, as a simulator gets them.

    Attributes
    ----------
    command, load : (S,) arrays at the samples, rad and N m on the motor shaft; straight between
    start : current (A), speed and angle of the motor and of the output, what the motor's speed
        gains in a step, and the current from which the next one goes on, at the first sample
    target, weights : (S,) arrays, filtered recorded current (A) and weight of each sample (s/A)
    step : float, s; ``substeps`` of them make a sampling interval
    """

    actuator: BldcActuator
    comparison: BldcComparison
    plant: Plant
    command: np.ndarray
    load: np.ndarray
    start: tuple[float, ...]
    target: np.ndarray
    weights: np.ndarray
    filter: Filter
    step: float
    substeps: int
    half_gap: float  # rad, healthy

    @classmethod
    def make(cls, duration: float | None = None) -> "Task":
        """A recording of the reference model with four faults, or its first ``duration`` s."""
        actuator = BldcActuator.load()
        record = simulate("reference", faults=INJECTED, actuator=actuator)
        if duration is not None:
            record = record.between(0.0, duration)
        comparison = BldcComparison(record, actuator, rectify=True, threads=1)
        c = kernel_constants(actuator)
        plant = Plant(
            c.resistance, c.inductance, c.leakage, c.k_e, c.pole_pairs, c.v_supply, c.half_band,
            c.i_max, c.w_max, c.k_position, actuator.controller.speed_gain, actuator.motor.inertia,
            actuator.transmission.output_inertia, c.viscous, c.t_m, c.t_o,
            c.static_ratio, c.c_opposing, c.c_aiding, c.contact_stiffness, c.contact_damping,
            c.travel_low, c.travel_high,
        )  # fmt: skip
        return cls(
            actuator, comparison, plant, comparison.command, comparison.load,
            tuple(comparison.state.tolist()), comparison.target, comparison.weights,
            butterworth(record.sample_rate, float(comparison.current[0])), comparison.step,
            comparison.substeps, actuator.transmission.backlash / 2.0,
        )  # fmt: skip

    @property
    def simulated(self) -> float:
        """Seconds that one candidate simulates."""
        return (self.target.size - 1) * self.substeps * self.step

    def magnitudes(self, k: np.ndarray) -> Magnitudes:
        """Of fault vectors (B, 8), as (B,) arrays (paper, section 6)."""
        return Magnitudes(
            1.0 + 2.0 * k[:, 0], self.half_gap * (1.0 + 99.0 * k[:, 1]), 1.0 - k[:, 2],
            1.0 - k[:, 3], 1.0 - k[:, 4], k[:, 5], 2.0 * math.pi * (k[:, 6] - 0.5), 0.5 + k[:, 7],
        )  # fmt: skip

    def each(self, k: np.ndarray) -> list[Magnitudes]:
        """Of fault vectors (B, 8), one after another."""
        rows = np.column_stack(self.magnitudes(k)).tolist()
        return [Magnitudes(*row) for row in rows]

    def own_costs(self, k: np.ndarray, comparison: BldcComparison | None = None) -> np.ndarray:
        """What ematwin says (B,)."""
        named = {name: k[:, n] for n, name in enumerate(FAULTS)}
        return (comparison or self.comparison).costs(named, len(k))


def butterworth(rate: float, first: float) -> Filter:
    """The low-pass of docs/models.md, at rest at ``first``."""
    b, a = butter(2, CUTOFF, fs=rate)
    return Filter(b[0], a[1], a[2], *(lfilter_zi(b, a) * first))


def scored(currents: np.ndarray, task: Task) -> np.ndarray:
    """Costs (B,) of mean currents (B, S - 1) of the sampling intervals, by scipy's filter."""
    f = task.filter
    at_rest = np.broadcast_to([f.z1, f.z2], (len(currents), 2))
    filtered, _ = lfilter(
        [f.b, 2.0 * f.b, f.b], [1.0, f.a1, f.a2], np.abs(currents), axis=1, zi=at_rest
    )
    return np.asarray((task.weights[1:] * (task.target[1:] - filtered) ** 2).sum(axis=1))
