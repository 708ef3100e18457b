"""Verdict: healthy, changed, a fault by name, or none, with the reason.

A fault is named if it lies beyond what noise, what the twin misses, and all that nobody knows
exactly may account for (`ematwin.estimation.significance`). A change beyond noise that a drift of
the actuator's parameters accounts for as well is a change without a name; against a data sheet,
whose tolerances are wider, it is no ground for any verdict. A recording that the twin does not
explain as well as healthy ones, or that moves too little, gives none either.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ematwin.estimation.constants import (
    EXPLAINED,
    LEVEL,
    SMALLEST,
    TELLING,
    UNCALIBRATED,
    WORSE,
    WORST,
)
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.significance import is_present, present
from ematwin.showing import markup
from ematwin.showing.words import listed

Grade = Literal["healthy", "changed", "fault", "none"]
INTERVAL = f"{100 * LEVEL:.0f} % interval"
_COUNTS = {2: "Two", 3: "Three", 4: "Four", 5: "Five", 6: "Six", 7: "Seven", 8: "Eight"}


@dataclass(frozen=True)
class Verdict:
    """What a recording is worth.

    Attributes
    ----------
    grade : "healthy", "changed" (not named), "fault", or "none"
    faults : names of the faults that are named
    reason : why there is no verdict, or what the change may be; "" if there is nothing to say
    sentence : all of it, for people
    """

    grade: Grade
    faults: tuple[str, ...]
    reason: str
    sentence: str

    def __str__(self) -> str:
        return self.sentence

    def _repr_html_(self) -> str:
        """The sentence in the colour of its grade, in a notebook."""
        return markup.verdict(self.sentence, self.grade)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "grade": self.grade,
            "faults": list(self.faults),
            "reason": self.reason,
            "sentence": self.sentence,
        }


def most_misfit(healthy: float) -> float:
    """The relative misfit up to which a fit is a ground for a verdict.

    ``healthy`` is that of healthy recordings, NaN where there are none.
    """
    if math.isnan(healthy):
        return UNCALIBRATED
    return min(max(EXPLAINED, WORSE * healthy), worst_misfit(healthy))


def worst_misfit(healthy: float) -> float:
    """The relative misfit beyond which no fit is a ground for a verdict; ``healthy`` as above."""
    return WORST if math.isnan(healthy) else max(WORST, 1.2 * healthy)


def judged(
    estimate: Estimate,
    *,
    calibrated: bool,
    sharp_errors: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    obstacles: Sequence[str],
    ambiguities: Mapping[str, str],
    found: Mapping[str, str],
    ranges: Mapping[str, str],
) -> Verdict:
    """The verdict on an estimate.

    Parameters
    ----------
    estimate : values with a covariance that includes all that is uncertain
    calibrated : whether its twin was fitted to healthy recordings of the actuator
    sharp_errors : standard errors by fault, as if all parameters were known exactly
    intervals : 95 %, by fault
    obstacles : sentences, each of which forbids a verdict
    ambiguities : by fault, what else may be the cause where only a drift would excuse it
    found : by fault, its size for people, "friction +50 % (0.045 N m, 95 % interval ...)"
    ranges : by fault, its interval for people, "short a, 0 to 2.2 turns"
    """
    magnitudes = [name for name in estimate.names if name in found]
    named = tuple(name for name in present(estimate) if name in found)
    moved = [
        name
        for name in magnitudes
        if is_present(
            estimate[name] - estimate.healthy[name], estimate.ranges[name], sharp_errors[name]
        )
    ]
    if not magnitudes:
        obstacles = [*obstacles, "No fault was searched."]
    if obstacles:
        reason = " ".join(obstacles)
        return Verdict("none", (), reason, f"No verdict: {reason}")
    unexplained = [name for name in moved if name not in named]
    said = _together([found[name] for name in unexplained]) if unexplained else ""
    causes = list(dict.fromkeys(ambiguities[n] for n in unexplained if n in ambiguities))
    because = f" {' '.join(causes)}" if causes else ""

    far = {
        name: max(abs(end - estimate.healthy[name]) for end in intervals[name])
        / estimate.ranges[name]
        for name in magnitudes
    }
    if named:
        reason = rest = ""
        if unexplained:
            excuse = "drift" if calibrated else "the tolerances of the data sheet"
            reason = rest = f"{said[:1].upper()}{said[1:]} may be due to {excuse}.{because}"
        elif others := [name for name in magnitudes if name not in named]:
            rest = least_certain("No other fault", {name: far[name] for name in others}, ranges)
        sentence = f"{faults_said([found[name] for name in named])} {rest}".rstrip()
        return Verdict("fault", named, reason, sentence)
    if moved:
        if calibrated:
            reason = f"{said}, no more than drift since the calibration can cause.{because}"
            return Verdict("changed", (), reason, f"Changed: {reason}")
        reason = (
            f"{said} would explain the recording, and so would the tolerances of the data sheet."
            f"{because} Calibrate with healthy recordings of this actuator."
        )
        return Verdict("none", (), reason, f"No verdict: {reason}")
    unseen = [name for name in magnitudes if far[name] > TELLING]
    if unseen:
        reason = (
            f"Nothing has changed beyond doubt, but {listed(unseen)} could be present unseen"
            + (". " if calibrated else " within the tolerances of the data sheet. ")
            + (
                "Use a command that moves the actuator more."
                if calibrated
                else "Calibrate with healthy recordings of this actuator."
            )
        )
        return Verdict("none", (), reason, f"No verdict: {reason}")
    return Verdict("healthy", (), "", f"Healthy: {least_certain('no fault', far, ranges)}")


def faults_said(said: Sequence[str]) -> str:
    """Named faults in one sentence, from the size of each: "Two faults: ... and ..."."""
    count = _COUNTS.get(len(said), str(len(said)))
    lead = f"{count} faults" if len(said) > 1 else "Fault"
    return f"{lead}: {_together(said)}."


def least_certain(none: str, far: Mapping[str, float], ranges: Mapping[str, str]) -> str:
    """The bound that intervals set to faults that are not seen.

    Parameters
    ----------
    none : "no fault"
    far : by fault, how far its interval reaches from healthy, as a share of its range
    ranges : by fault, its interval for people
    """
    if max(far.values()) <= SMALLEST:
        return f"{none} larger than {100 * SMALLEST:g} % of its range."
    worst = ranges[max(far, key=lambda name: far[name])]
    return f"{none} found; the least certain is {worst} ({INTERVAL})."


def _together(said: Sequence[str]) -> str:
    """Sizes of several faults; the first one says that its interval is of 95 %."""
    return listed([said[0], *(one.replace(f"{INTERVAL} ", "") for one in said[1:])])
