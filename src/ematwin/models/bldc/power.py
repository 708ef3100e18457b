"""Electrical power from voltages or the current of the supply, beside the equivalent current.

    P = v_a i_a + v_b i_b + v_c i_c,

whatever point the voltages are measured against, because the currents add up to zero; or else the
supply's voltage times its current. The monitor model has

    P = (R_eq i + kappa_eq omega + L_eq di/dt) i.

Under current control a sensor that reads 3 % too much looks like a torque constant that is 3 %
smaller, as phases do that miss turns alike: the voltage for each ampere tells them apart. And watts
over radians a second fix the common scale of all torques, which currents alone leave open.
"""

from dataclasses import dataclass

import numpy as np

from ematwin.models.bldc.channels import PHASES, VOLTAGES
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.signals import LowPass
from ematwin.recordings.recording import Recording

# Relative error of the twin's power, against the reference model with means of 50 us: 0.8 to 2.1 %
# on three recordings, of which 0.9 to 1.8 % are the product of means in place of the mean product.
_TWIN_ERROR = 0.02
_PAIRS = tuple(zip(PHASES, VOLTAGES, strict=True))


@dataclass(frozen=True)
class Power:
    """Recorded electrical power.

    Attributes
    ----------
    watts : (S,) array
    by_phases : whether it is made of phase currents, whose sensors it shares
    nominal_supply : V by which a bus current was multiplied; None where voltages are recorded
    """

    watts: np.ndarray
    by_phases: bool
    nominal_supply: float | None = None

    def of(self, recording: Recording) -> np.ndarray:
        """The power (S,) of an answer of the reference model, formed as this was."""
        channels = recording.channels
        if self.by_phases:
            return np.sum([channels[i] * channels[v] for i, v in _PAIRS], axis=0)
        return channels["bus_current"] * channels["bus_voltage"]

    def error(self, filtered: np.ndarray, low_pass: LowPass, sample_rate: float) -> float:
        """Standard deviation of the residual of a filtered twin, W."""
        noise = low_pass.passed_noise(self.watts, filtered, sample_rate)
        return float(np.sqrt(noise + _TWIN_ERROR**2 * np.mean(filtered**2)))


def recorded_power(recording: Recording, actuator: BldcActuator) -> Power | None:
    """The electrical power of a recording; None where it does not tell it."""
    channels = recording.channels
    if {*PHASES, *VOLTAGES} <= channels.keys():
        return Power(np.sum([channels[i] * channels[v] for i, v in _PAIRS], axis=0), by_phases=True)
    if "bus_current" not in channels:
        return None
    current = channels["bus_current"]
    if "bus_voltage" in channels:
        return Power(current * channels["bus_voltage"], by_phases=False)
    supply = actuator.drive.supply_voltage
    return Power(current * supply, by_phases=False, nominal_supply=supply)
