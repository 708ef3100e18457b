"""Verdict: healthy, changed, a fault by name, or none, with the reason.

A fault is named if it is there with a probability of `CERTAIN`, and a recording is healthy if no
large one is, with the same probability, and more likely none at all
(`ematwin.estimation.spike_and_slab`). Where some fault is certain, but none by itself, it is a
change without a name. In between there is no verdict, nor on a recording that the twin does not
explain as well as healthy ones, or that moves too little.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ematwin.estimation.constants import (
    BEFOREHAND,
    CERTAIN,
    EXPLAINED,
    LEVEL,
    SMALLEST,
    UNCALIBRATED,
    WORSE,
    WORST,
)
from ematwin.showing import markup
from ematwin.showing.text import listed

Grade = Literal["healthy", "changed", "fault", "none"]
UNNAMED = "unnamed change"  # of an actuator that is like no fault that can be named
INTERVAL = f"{100 * LEVEL:.0f} % interval"
_COUNTS = {2: "Two", 3: "Three", 4: "Four", 5: "Five", 6: "Six", 7: "Seven", 8: "Eight"}


@dataclass(frozen=True)
class Verdict:
    """The verdict on a recording.

    Attributes
    ----------
    grade : "healthy", "changed" (not named), "fault", or "none"
    faults : names of the faults that are named
    reason : why there is no verdict, or candidates for the change; "" if there is nothing to say
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


def most_misfit(healthy: float, has_reference: bool = False, scatter: float = 0.0) -> float:
    """The relative misfit up to which a fit is a ground for a verdict.

    Parameters
    ----------
    healthy : of healthy recordings, NaN where there are none
    has_reference : whether the twin is corrected by a reference model: what healthy recordings
        leave is then all that is usual, and else no less than `EXPLAINED`
    scatter : by which answers of the reference differ: a recording is one of them
    """
    if math.isnan(healthy):
        return UNCALIBRATED
    least = 0.0 if has_reference else EXPLAINED
    # near instability answers differ by more than they have in common: scatter excuses no such fit
    return min(max(least, WORSE * math.hypot(healthy, scatter)), WORST)


def judged(
    probability: Mapping[str, float],
    faulty: float,
    large: Mapping[str, float],
    *,
    calibrated: bool,
    reach: Mapping[str, float],
    found: Mapping[str, str],
    ranges: Mapping[str, str],
    obstacles: Sequence[str] = (),
    ambiguities: Mapping[str, str] | None = None,
) -> Verdict:
    """The verdict from the probabilities of the faults.

    Parameters
    ----------
    probability : by fault, that it is as far from healthy as matters; `UNNAMED` names none
    faulty : that any of them is
    large : by fault, that it is as large as is not overlooked (`TELLING`)
    calibrated : whether the twin was fitted to healthy recordings of the actuator
    reach : by fault, how far its interval reaches from healthy, as a share of its range
    found : by fault, its size for people, "friction +50 % (0.045 N m, 95 % interval ...)"
    ranges : by fault, its interval for people, "short a, 0 to 2.2 turns"
    obstacles : reasons that each forbid a verdict, as sentences
    ambiguities : by fault, what else may be the cause
    """
    if not probability:
        obstacles = [*obstacles, "No fault was searched."]
    if obstacles:
        return _without(" ".join(obstacles))
    named = tuple(n for n, share in probability.items() if share > CERTAIN and n != UNNAMED)
    unsure = sorted(
        (name for name in probability if name not in named and probability[name] > 1.0 - CERTAIN),
        key=lambda name: -probability[name],
    )
    told = {n: (found if probability[n] > BEFOREHAND else ranges)[n] for n in unsure}
    perhaps = _listed_or([f"{told[n]}, {100.0 * probability[n]:.0f} % probable" for n in unsure])
    causes = dict.fromkeys((ambiguities or {}).get(name, "") for name in unsure)
    because = "".join(f" {cause}" for cause in causes if cause)
    advice = (
        "Use a command that moves the actuator more, or judge more recordings."
        if calibrated
        else "Calibrate with healthy recordings of this actuator."
    )
    if named:
        reason = rest = ""
        if unsure:
            reason = rest = f"Perhaps also {perhaps}.{because}"
        elif others := {name: far for name, far in reach.items() if name not in named}:
            rest = least_certain("No other fault", others, ranges)
        sentence = f"{faults_said([found[name] for name in named])} {rest}".rstrip()
        return Verdict("fault", named, reason, sentence)
    if faulty > CERTAIN:
        which = "; the recording does not tell which" if len(unsure) > 1 else ""
        reason = f"{perhaps}{which}.{because}"
        return Verdict("changed", (), reason, f"Changed: {reason}")
    doubt = f"A fault is {100.0 * faulty:.0f} % probable: {perhaps}." if perhaps else ""
    if faulty > BEFOREHAND:
        return _without(f"{doubt}{because} {advice}")
    unseen = [name.replace("_", " ") for name, share in large.items() if share > 1.0 - CERTAIN]
    if unseen:
        reason = f"A fault of {listed(unseen)} would hardly show in this recording."
        return _without(f"{doubt} {reason} {advice}".lstrip())
    sentence = f"Healthy: {least_certain('no fault', reach, ranges)} {doubt}".rstrip()
    return Verdict("healthy", (), doubt, sentence)


def _without(reason: str) -> Verdict:
    return Verdict("none", (), reason, f"No verdict: {reason}")


def _listed_or(said: Sequence[str]) -> str:
    """Alternatives in words."""
    return " or ".join([", ".join(said[:-1]), said[-1]]) if len(said) > 1 else "".join(said)


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
    if not far:
        return f"{none} found."
    if max(far.values()) <= SMALLEST:
        return f"{none} larger than {100 * SMALLEST:g} % of its range."
    worst = ranges[max(far, key=lambda name: far[name])]
    return f"{none} found; the least certain is {worst} ({INTERVAL})."


def _together(said: Sequence[str]) -> str:
    """Sizes of several faults; the first one says that its interval is of 95 %."""
    return listed([said[0], *(one.replace(f"{INTERVAL} ", "") for one in said[1:])])
