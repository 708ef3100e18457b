"""Conclusions of a study in plain sentences, each drawn only where its numbers allow it."""

import math
from collections import Counter
from typing import Any

import numpy as np

from ematwin.benchmarking.statistics import ALPHA, RankComparison, matrix
from ematwin.benchmarking.table import RunTable
from ematwin.showing.text import counted, listed

ENOUGH = 5  # runs of a case and algorithm, below which nothing is claimed
_TO_ZERO = {"gwo", "woa", "da"}  # families whose moves scale the coordinates themselves


def conclude(study: Any) -> list[str]:
    """Give the sentences on a `StudyAnalysis`, most important first."""
    return [
        *_runs(study.table, study.cells),
        *_differences(study.ranks),
        *_diagnosis(study.diagnosis, study.threshold),
        *_machines(study.table),
        *_limits(study.table),
    ]


def lead_of(study: Any) -> str:
    """Who has the lowest mean Err%, and whether by more than chance, of a `StudyAnalysis`."""
    table, ranks = study.table, study.ranks
    whole = matrix(study.cells, "err_mean").dropna()
    if not len(whole) or len(table.algorithms) < 2:
        return f"{int(table.done.sum())} of {counted(len(table), 'run')} ended well."
    wins = Counter(whole.idxmin(axis=1))
    cases = counted(len(whole), "case")
    best, count = wins.most_common(1)[0]
    tied = [str(name) for name, won in wins.items() if won == count]
    if len(tied) > 1:
        return (
            f"{listed(tied)} have the lowest mean Err% equally often, on {count} of {cases} each."
        )
    others = len(table.algorithms) - 1
    surely = sum(
        (pair.a12 > 0.5) == (pair.first == best)
        for pair in ranks.different
        if best in (pair.first, pair.second)
    )
    sure = "no test tells that from chance"
    if surely:
        whom = "the other" if others == 1 else f"{surely} of the {others} others"
        sure = f"it is better than {whom} by more than chance"
    return f"{best} has the lowest mean Err% on {count} of {cases}; {sure}."


def _runs(table: RunTable, cells: Any) -> list[str]:
    done, failed = int(table.done.sum()), int((~table.done).sum())
    sentences = [f"{done} of {len(table)} runs ended well."]
    if failed:
        sentences[0] += (
            f" Those that did not ({failed}) count as failures in the success rates, lose every "
            "comparison of runs, and have no Err% to average."
        )
    if not done:
        return [*sentences, "No run has a result: no errors, times or ranks can be given."]
    missing = cells[cells["done"] == 0]
    if len(missing):
        named = [f"{cell.algorithm} on {cell.case}" for cell in missing.head(5).itertuples()]
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        sentences.append(f"No result yet: {', '.join(named)}{more}.")
    fewest = int(cells["done"].min())
    if fewest < ENOUGH:
        sentences.append(
            f"Some cases have fewer than {ENOUGH} runs of a method (the fewest {fewest}): their "
            "spread is poorly known, and nothing is claimed about single cases."
        )
    return sentences


def _differences(ranks: RankComparison) -> list[str]:
    if not all(map(math.isfinite, ranks.average.values())):
        return list(ranks.notes)
    listed = ", ".join(f"{name} {ranks.average[name]:.2f}" for name in ranks.order)
    sentences = [
        f"Average rank by mean Err% over {counted(len(ranks.blocks), 'case')}, 1 the best: "
        f"{listed}."
    ]
    if math.isfinite(ranks.friedman_p):
        test = f"Friedman test: chi-squared {ranks.friedman:.3g}, p = {ranks.friedman_p:.2g}"
        if ranks.friedman_p >= ALPHA:
            sentences.append(
                f"{test}. That the algorithms differ in Err% cannot be concluded; the order above "
                "may be chance."
            )
            return [*sentences, *ranks.notes]
        sentences.append(f"{test}: the algorithms differ in Err%.")
    return [*sentences, *_pairs(ranks), *ranks.notes]


def _pairs(ranks: RankComparison) -> list[str]:
    """Which pairs differ after Holm's correction."""
    if not ranks.pairs:
        return []
    if not ranks.different:
        return [
            "No pair of algorithms differs significantly after Holm's correction: which of two is "
            "the better cannot be concluded."
        ]
    before = []
    for n, better in enumerate(ranks.order):
        worse = [other for other in ranks.order[n + 1 :] if ranks.differ(better, other)]
        if worse:
            before.append(f"{better} before {', '.join(worse)}")
    count, every = len(ranks.different), len(ranks.pairs)
    rest = " Nothing can be concluded about the others." if count < every else ""
    return [
        f"Of {every} pairs, {count} differ after Holm's correction (p at most "
        f"{max(pair.p_holm for pair in ranks.different):.2g}): {'; '.join(before)}.{rest}"
    ]


def _diagnosis(diagnosis: Any, threshold: float) -> list[str]:
    named = (diagnosis["exact"] / diagnosis["runs"]).set_axis(diagnosis["algorithm"]).dropna()
    if not len(named):
        return []
    order = named.sort_values(ascending=False, kind="stable")
    shares = ", ".join(f"{algorithm} {100.0 * share:.0f} %" for algorithm, share in order.items())
    return [
        f"With a deviation of {threshold:g} of the range counted as a fault, the faults were named "
        f"exactly, none missed and none false, in this share of the runs: {shares}."
    ]


def _machines(table: RunTable) -> list[str]:
    machines = len(table.provenance.get("machine", ()))
    if machines < 2:
        return []
    return [
        f"The runs were made on several machines ({machines}): their seconds should not be "
        "compared, nor coefficients built on them."
    ]


def _limits(table: RunTable) -> list[str]:
    sentences = [
        "Spread and intervals here come from repeating the search with other seeds. They are "
        "search spread, not measurement uncertainty, and say nothing about how far the twin is "
        "from a real actuator: the records are simulated."
    ]
    subject, box = table.subject, table.settings["search box"]
    corner = (subject.healthy == subject.lower) | (subject.healthy == subject.upper)
    zero = subject.healthy == 0.0
    if box == "plain" and (corner | zero).any():
        drawn = [name for name in table.algorithms if name.partition("-")[0] in _TO_ZERO]
        favoured = [f"{', '.join(drawn)} (drawn to the origin)"] if drawn and zero.any() else []
        favoured += ["every method that clips at the bounds"] if corner.any() else []
        special = int((corner | zero).sum())
        sentences.append(
            f"{special} of the {len(corner)} healthy values lie at a bound of this search box or "
            f"at the origin, which favours {' and '.join(favoured) or 'methods drawn there'}. "
            "Repeat the study with the remapped box before concluding that a method is good at "
            "finding faults."
        )
    if box == "remapped" and np.any(corner):
        sentences.append(
            "In the remapped box a healthy value lies beside a cliff, where the plain box has a "
            "wall, so all methods err more. What a method loses between the boxes it owed to the "
            "corner of the plain one."
        )
    return sentences
