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
from ematwin.showing.results import html, plain
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

    @classmethod
    def none(cls, reason: str) -> "Verdict":
        """No verdict, for a reason in one sentence or several."""
        return cls("none", (), reason, f"No verdict: {reason}")

    def __str__(self) -> str:
        return self.sentence

    def _repr_html_(self) -> str:
        """The sentence in the colour of its grade, in a notebook."""
        return html(self.sentence, grade=self.grade)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return plain(vars(self))


def most_misfit(healthy: float, has_reference: bool = False, scatter: float = 0.0) -> float:
    """The relative misfit up to which a fit is a ground for a verdict.

    By what ``healthy`` recordings leave, NaN without any, and the ``scatter`` of the reference: a
    recording is one of its answers. Without a reference no less than `EXPLAINED` is usual.
    """
    if math.isnan(healthy):
        return UNCALIBRATED
    least = 0.0 if has_reference else EXPLAINED
    # near instability answers differ by more than they have in common: scatter excuses no such fit
    return min(max(least, WORSE * math.hypot(healthy, scatter)), WORST)


def most_of_healthy(expected: float, lacks_forms: bool) -> float:
    """The most that a twin with a reference may leave of healthy recordings for its closed loop.

    Known forms that ``lacks_forms`` says only the reference has scatter. Else what is left beyond
    the ``expected`` misfit is of a form that is not known, and passes for faults.
    """
    return WORST if lacks_forms else max(EXPLAINED, WORSE * expected)


def judged(
    probability: Mapping[str, float],  # by fault, that it is as far from healthy as matters
    faulty: float,  # the probability that any of them is
    large: Mapping[str, float],  # by fault, that it is as large as is not overlooked (`TELLING`)
    *,
    calibrated: bool,  # whether the twin was fitted to healthy recordings of the actuator
    reach: Mapping[str, float],  # by fault, from healthy to the end of its interval, over its range
    found: Mapping[str, str],  # by fault, its size: "friction +50 % (0.045 N m, 95 % interval ...)"
    ranges: Mapping[str, str],  # by fault, its interval: "short a, 0 to 2.2 turns"
    obstacles: Sequence[str] = (),  # sentences on reasons that each forbid a verdict
    ambiguities: Mapping[str, str] | None = None,  # by fault, what else may be the cause
) -> Verdict:
    """The verdict from the probabilities of the faults; `UNNAMED` is none that can be named."""
    if not probability:
        obstacles = [*obstacles, "No fault was searched."]
    if obstacles:
        return Verdict.none(" ".join(obstacles))
    named = tuple(n for n, share in probability.items() if share > CERTAIN and n != UNNAMED)
    unsure = sorted(
        (name for name in probability if name not in named and probability[name] > 1.0 - CERTAIN),
        key=lambda name: -probability[name],
    )
    told = {n: (found if probability[n] > BEFOREHAND else ranges)[n] for n in unsure}
    each = [f"{told[n]}, {100.0 * probability[n]:.0f} % probable" for n in unsure]
    perhaps = listed(each, "or") if each else ""
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
            rest = _least_certain("No other fault", others, ranges)
        sentence = f"{_named([found[name] for name in named])} {rest}".rstrip()
        return Verdict("fault", named, reason, sentence)
    if faulty > CERTAIN:
        which = "; the recording does not tell which" if len(unsure) > 1 else ""
        reason = f"{perhaps}{which}.{because}"
        return Verdict("changed", (), reason, f"Changed: {reason}")
    doubt = f"A fault is {100.0 * faulty:.0f} % probable: {perhaps}." if perhaps else ""
    if faulty > BEFOREHAND:
        return Verdict.none(f"{doubt}{because} {advice}")
    unseen = [name.replace("_", " ") for name, share in large.items() if share > 1.0 - CERTAIN]
    if unseen:
        reason = f"A fault of {listed(unseen)} would hardly show in this recording."
        return Verdict.none(f"{doubt} {reason} {advice}".lstrip())
    sentence = f"Healthy: {_least_certain('no fault', reach, ranges)} {doubt}".rstrip()
    return Verdict("healthy", (), doubt, sentence)


def _named(sizes: Sequence[str]) -> str:
    """Named faults, from the size of each: "Two faults: ... and ..."; one says its interval."""
    if len(sizes) == 1:
        return f"Fault: {sizes[0]}."
    beside = (one.replace(f"{INTERVAL} ", "") for one in sizes[1:])
    count = _COUNTS.get(len(sizes), str(len(sizes)))
    return f"{count} faults: {listed([sizes[0], *beside])}."


def _least_certain(none: str, far: Mapping[str, float], ranges: Mapping[str, str]) -> str:
    """The bound that intervals set to faults that are not seen; as of `judged`."""
    if not far:
        return f"{none} found."
    if max(far.values()) <= SMALLEST:
        return f"{none} larger than {100 * SMALLEST:g} % of its range."
    worst = ranges[max(far, key=lambda name: far[name])]
    return f"{none} found; the least certain is {worst} ({INTERVAL})."
