"""Answers counted against the truth: intervals that hold it, verdicts that are silently wrong.

`NOISE` is that of the recordings of a brushless motor: 2 % of the RMS, and a converter of 12 bits.
"""

from collections.abc import Mapping, Sequence

from ematwin import Noise
from ematwin.models.bldc.faults import FAULTS

NOISE = Noise(white=0.02, bits=12)
MAGNITUDES = tuple(name for name in FAULTS if name != "eccentricity_phase")
OFF, BEYOND = 0.01, 0.5  # silently wrong: off by so much, and by half widths outside

Interval = Sequence[float]  # its two ends


def holds(interval: Interval, truth: float) -> bool:
    """Whether an interval holds the truth; at a bound both may be the same number."""
    low, high = interval
    return low - 1e-9 <= truth <= high + 1e-9


def outside_by(interval: Interval, truth: float) -> float:
    """How far the truth lies outside an interval, in half widths of it."""
    low, high = interval
    return max(low - truth, truth - high, 0.0) / max(0.5 * (high - low), 1e-12)


def silently_wrong(
    grade: str,
    values: Mapping[str, float],
    intervals: Mapping[str, Interval],
    truth: Mapping[str, float],
) -> bool:
    """Off by 0.01, outside an interval by half its half width, and nothing said."""
    return grade != "none" and any(
        abs(values[name] - truth[name]) > OFF and outside_by(intervals[name], truth[name]) > BEYOND
        for name in MAGNITUDES
    )


def table(columns: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    """Markdown: the first column is text."""
    head = f"| {' | '.join(columns)} |\n|---|{'--:|' * (len(columns) - 1)}"
    return "\n".join([head, *(f"| {' | '.join(map(str, line))} |" for line in lines)])
