"""Diagnosis measured as diagnosis: faults missed, false alarms and faults taken for another.

A fault is present from ``threshold`` of its range away from healthy, in the injected vector as in
the one found. An injected deviation below the threshold, but not zero, is neither: reporting it is
no false alarm, and passing over it is no miss. The direction of a fault is not a fault; where the
fault was injected and found, directions with an error of ``threshold`` of a turn or more are
counted separately.
"""

from collections import Counter
from typing import Any

import numpy as np

from ematwin.benchmarking.table import RunTable
from ematwin.showing.results import frame

THRESHOLD = 0.05


def diagnose(table: RunTable, threshold: float = THRESHOLD) -> Any:
    """Count the faults that each algorithm would have named.

    Returns
    -------
    DataFrame, a row for each algorithm, over its runs that ended well

        runs, without : runs that ended well, and failed runs, which diagnosed nothing
        exact : runs that named the faults exactly: none missed, none false
        faults, missed : injected faults, and how many of them were passed over
        chances, false_alarms : healthy components, and how many of them were called faulty
        confused : runs that missed a fault and named a healthy component instead
        directions, direction_wrong : faults found that have a direction, and those with it turned
        confusions : dict, (missed, named instead) -> runs
    """
    done, subject = table.done, table.subject
    injected, found = (
        table.frame.reindex(columns=[f"{which}_{name}" for name in subject.names]).to_numpy(float)
        for which in ("injected", "found")
    )
    width, slack = subject.upper - subject.lower, 1e-12  # 0.55 - 0.5 is less than 0.05
    least = threshold - slack
    deviation = np.abs(injected - subject.healthy) / width
    faulty = (deviation >= least) & done[:, None]
    called = (np.abs(found - subject.healthy) / width >= least) & done[:, None]
    present, named = (part[:, subject.magnitudes] for part in (faulty, called))
    absent = (deviation[:, subject.magnitudes] <= slack) & done[:, None]
    missed, false = present & ~named, absent & named
    confused = missed.any(axis=1) & false.any(axis=1)
    directed, turned = np.zeros((2, len(table)), dtype=int)
    for magnitude, direction in subject.directions:
        both = faulty[:, magnitude] & called[:, magnitude]
        turn = (found - injected)[:, direction] / width[direction]
        directed += both
        turned += both & (np.abs(turn - np.round(turn)) >= least)
    algorithm = table.frame["algorithm"]
    counts = frame({
        "runs": done, "without": ~done,
        "exact": done & ~missed.any(axis=1) & ~false.any(axis=1),
        "faults": present.sum(axis=1), "missed": missed.sum(axis=1),
        "chances": absent.sum(axis=1), "false_alarms": false.sum(axis=1), "confused": confused,
        "directions": directed, "direction_wrong": turned,
    }).groupby(algorithm).sum().reindex(table.algorithms)  # fmt: skip
    names = np.array(subject.names)[subject.magnitudes].tolist()
    confusions = {name: Counter[tuple[str, str]]() for name in table.algorithms}
    for run in np.flatnonzero(confused):
        confusions[algorithm[run]].update(
            (names[i], names[j])
            for i in np.flatnonzero(missed[run])
            for j in np.flatnonzero(false[run])
        )
    counts["confusions"] = [dict(one.most_common()) for one in confusions.values()]
    return counts.reset_index()
