"""Monitoring: the part of a kind of actuator that a healthy population uses.

`calibrate` learns the scatter of features between healthy runs of kinds such as the ball screw, and
`detect` compares a run with them. A kind without one reports its faults.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ematwin.models.comparison import Comparison
from ematwin.recordings.recording import Recording


@dataclass(frozen=True)
class Reported:
    """A quantity that is reported where a healthy population judges.

    Parameters
    ----------
    name : str; an unknown, or a statistic that the model derives from features
    unit : str, of ``scale`` times the value; "x" for a multiple of the healthy mean
    meaning : str
    logarithmic : bool, the population is one of logarithms and the unit is "x"
    scale : float, shown value over SI value
    named : str, the fault that a raised value names; "" if it names none
    either : bool, a lowered value names it as well
    least : float, in SI or as a logarithm: no healthy run is so far from the others; infinite
        where that is not known
    """

    name: str
    unit: str
    meaning: str
    logarithmic: bool = False
    scale: float = 1.0
    named: str = ""
    least: float = math.inf
    either: bool = False


@dataclass(frozen=True)
class Statistic:
    """A number that a comparison measures beside the values, such as noise shared by sensors.

    Parameters
    ----------
    name : str, in `Comparison.statistics`
    unit : str, SI
    changed : str, sentence on a recording whose value is unlike the healthy ones
    advice : str, a sentence on why that may be
    """

    name: str
    unit: str
    changed: str
    advice: str


@dataclass(frozen=True)
class Monitoring:
    """Reported quantities, features and statistics of a kind; a kind overrides the methods.

    Parameters
    ----------
    covariate : name of the nuisance on which healthy features depend, or None
    statistics : numbers that comparisons measure beside the values
    short : names of compared channels in features, where shorter
    """

    covariate: str | None = None
    statistics: tuple[Statistic, ...] = ()
    short: Mapping[str, str] = field(default_factory=dict)

    def reported(self, model: Any, actuator: Any) -> tuple[Reported, ...]:
        """Reported quantities; by default each fault as it is searched."""
        return tuple(
            Reported(
                one.name, one.unit, one.meaning, named=one.name, either=one.lower < one.healthy
            )
            for one in model.faults(actuator)
            if one.direction_of is None
        )

    def settling_time(self, actuator: Any) -> float:
        """Seconds from a change of the command until its transient has died out."""
        return 0.0

    def compare(
        self, model: Any, recording: Recording, actuator: Any, settling_time: float
    ) -> Comparison:
        """A recording prepared for the population.

        A kind whose preparation depends on steady motion takes ``settling_time`` (s) of the
        calibration.
        """
        compared: Comparison = model.compare(recording, actuator)
        return compared

    @staticmethod
    def of(model: Any) -> "Monitoring":
        """The one of a kind that is judged by a healthy population."""
        found = model.monitoring
        assert isinstance(found, Monitoring), f"{model.kind} has no healthy population"
        return found

    def derived(self, features: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Reported quantities that are no unknowns, (N,) by name, from features (N,) by name."""
        return {}
