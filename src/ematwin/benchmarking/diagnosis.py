"""Diagnosis measured as diagnosis: faults missed, false alarms and faults taken for another.

A fault is present from ``threshold`` of its range away from healthy, in the injected vector as in
the one found. An injected deviation below the threshold, but
not zero, is neither: reporting it is no false alarm, and passing over it is no miss. The direction
of a fault is not a fault; where the fault was injected and found, directions with an error of
``threshold`` of a turn or more are counted separately.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from ematwin.benchmarking.subject import Subject
from ematwin.benchmarking.table import RunTable

THRESHOLD = 0.05
_SLACK = 1e-12  # 0.55 - 0.5 is a little less than 0.05


@dataclass(frozen=True)
class Diagnosis:
    """The faults that an algorithm would have named, over all runs that ended well.

    Attributes
    ----------
    runs : int, ended well; without : int, failed runs, which diagnosed nothing
    exact : runs that named the faults exactly: none missed, none false
    faults, missed : injected faults, and how many of them were passed over
    chances, false_alarms : healthy components, and how many of them were called faulty
    confused : runs that missed a fault and named a healthy component instead
    directions, direction_wrong : faults found that have a direction, and those with it turned
    confusions : (missed, named instead) -> runs
    """

    algorithm: str
    runs: int
    without: int
    exact: int
    faults: int
    missed: int
    chances: int
    false_alarms: int
    confused: int
    directions: int
    direction_wrong: int
    confusions: dict[tuple[str, str], int]


def diagnose(table: RunTable, threshold: float = THRESHOLD) -> list[Diagnosis]:
    """Give the `Diagnosis` of each algorithm."""
    done, subject = table.done, table.subject
    injected, found = (
        table.frame[[f"{which}_{name}" for name in subject.names]].to_numpy(dtype=float)
        if done.any()
        else np.empty((len(table), len(subject.names)))
        for which in ("injected", "found")
    )
    answers = []
    for name in table.algorithms:
        its = np.asarray(table.frame["algorithm"] == name)
        kept = its & done
        without = int((its & ~done).sum())
        answers.append(_diagnosis(subject, name, injected[kept], found[kept], without, threshold))
    return answers


def _diagnosis(
    subject: Subject,
    algorithm: str,
    injected: np.ndarray,
    found: np.ndarray,
    without: int,
    threshold: float,
) -> Diagnosis:
    width = subject.upper - subject.lower
    deviation = (injected - subject.healthy) / width
    faulty = np.abs(deviation) >= threshold - _SLACK
    called = np.abs(found - subject.healthy) / width >= threshold - _SLACK
    judged = subject.magnitudes
    present, named = faulty[:, judged], called[:, judged]
    absent = np.abs(deviation[:, judged]) <= _SLACK
    missed, false = present & ~named, absent & named
    confused = missed.any(axis=1) & false.any(axis=1)
    names = [subject.names[n] for n in judged]
    confusions = Counter(
        (names[i], names[j])
        for run in np.flatnonzero(confused)
        for i in np.flatnonzero(missed[run])
        for j in np.flatnonzero(false[run])
    )
    directions = turned = 0
    for magnitude, direction in subject.directions:
        both = faulty[:, magnitude] & called[:, magnitude]
        turn = (found - injected)[both, direction] / width[direction]
        directions += int(both.sum())
        turned += int((np.abs(turn - np.round(turn)) >= threshold - _SLACK).sum())
    return Diagnosis(
        algorithm,
        runs=len(injected),
        without=without,
        exact=int((~missed.any(axis=1) & ~false.any(axis=1)).sum()),
        faults=int(present.sum()),
        missed=int(missed.sum()),
        chances=int(absent.sum()),
        false_alarms=int(false.sum()),
        confused=int(confused.sum()),
        directions=directions,
        direction_wrong=turned,
        confusions=dict(confusions.most_common()),
    )
