"""Plain sentences of what a study shows and what it does not, each guarded by its numbers."""

import math

import numpy as np

from ematwin.comparison.analysis.claims import ENOUGH
from ematwin.comparison.analysis.diagnosis import Diagnosis
from ematwin.comparison.analysis.ranks import ALPHA, RankComparison
from ematwin.comparison.analysis.runs import RunTable
from ematwin.comparison.analysis.summary import Cell
from ematwin.comparison.study.subject import Subject

_TO_ZERO = {
    "gwo",
    "woa",
    "da",
    "gwo-tuned",
    "woa-tuned",
    "da-tuned",
}  # their moves scale the coordinates themselves
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


def conclude(
    table: RunTable,
    cells: list[list[Cell]],
    ranks: RankComparison,
    within: dict[str, RankComparison],
    diagnosis: list[Diagnosis],
    threshold: float,
) -> list[str]:
    """The sentences, most important first."""
    return [
        *_runs(table, cells),
        *_differences(ranks),
        *_within(within),
        *_diagnosis(diagnosis, threshold, table.subject),
        *_mixtures(table),
        *_limits(table),
    ]


def _runs(table: RunTable, cells: list[list[Cell]]) -> list[str]:
    done = int(table.done.sum())
    sentences = [f"{done} of {len(table)} runs ended well."]
    if done < len(table):
        sentences[0] += (
            f" The other {len(table) - done} are listed below; they count as failures in the "
            "success rates and lose every comparison of runs, and have no Err% to average."
        )
    if not done:
        return [*sentences, "No run has a result: no errors, times or ranks can be given."]
    sizes = [cell.done for row in cells for cell in row]
    fewest = min(sizes)
    if fewest == 0:
        missing = [
            f"{cell.algorithm} on {cell.case}" for row in cells for cell in row if not cell.done
        ]
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        sentences.append(f"No result yet: {', '.join(missing[:5])}{more}.")
    if fewest < ENOUGH:
        sentences.append(
            f"Some cells have fewer than {ENOUGH} runs (the smallest {fewest}): their spread is "
            "poorly known, and nothing is claimed about single cases."
        )
    return sentences


def _differences(ranks: RankComparison) -> list[str]:
    if not np.isfinite(ranks.average_ranks).all():
        return list(ranks.notes)
    order = np.argsort(ranks.average_ranks)
    listed = ", ".join(f"{ranks.algorithms[n]} {ranks.average_ranks[n]:.2f}" for n in order)
    sentences = [
        f"Average rank by mean Err% over {_counted(len(ranks.blocks), 'case')}, 1 the best: "
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


def _within(within: dict[str, RankComparison]) -> list[str]:
    """The same among the methods of a preset, which makes fewer pairs."""
    return [
        f"Among the methods of the preset {preset} alone: {sentence[0].lower()}{sentence[1:]}"
        for preset, ranks in within.items()
        for sentence in _pairs(ranks)
    ]


def _pairs(ranks: RankComparison) -> list[str]:
    """Which pairs differ after Holm's correction."""
    order = np.argsort(ranks.average_ranks)
    pairs = [pair for pair in ranks.pairs if pair.p_holm < ALPHA]
    if pairs:
        rest = (
            " Nothing can be concluded about the others." if len(pairs) < len(ranks.pairs) else ""
        )
        return [
            f"Of {len(ranks.pairs)} pairs, {len(pairs)} differ after Holm's correction (p at most "
            f"{max(pair.p_holm for pair in pairs):.2g}): {_before(ranks, order)}.{rest}"
        ]
    if ranks.pairs:
        return [
            "No pair of algorithms differs significantly after Holm's correction: which of two is "
            "the better cannot be concluded."
        ]
    return []


def _before(ranks: RankComparison, order: np.ndarray) -> str:
    """Who comes before whom significantly, the best first."""
    p = ranks.significance()
    told = []
    for n, better in enumerate(order):
        worse = [ranks.algorithms[m] for m in order[n + 1 :] if p[better, m] < ALPHA]
        if worse:
            told.append(f"{ranks.algorithms[better]} before {', '.join(worse)}")
    return "; ".join(told)


def _diagnosis(diagnosis: list[Diagnosis], threshold: float, subject: Subject) -> list[str]:
    told = [
        f"{row.algorithm} {100.0 * row.exact / row.runs:.0f} %"
        for row in sorted(diagnosis, key=lambda row: -row.exact / max(row.runs, 1))
        if row.runs
    ]
    if not told:
        return []
    share = "" if np.all(subject.upper - subject.lower == 1.0) else " of the range"
    return [
        f"With a deviation of {threshold:g}{share} counted as a fault, the faults were named "
        f"exactly, none missed and none false, in this share of the runs: {', '.join(told)}."
    ]


def _mixtures(table: RunTable) -> list[str]:
    """What differs between the runs although it should not."""
    return [
        f"The runs differ in {name} ({', '.join(values)}): averages over them mix unlike things."
        for name, values in table.settings.items()
        if len(values) > 1
    ] + [
        f"The runs were made on several machines ({len(table.provenance[name])}): their seconds "
        "should not be compared, nor coefficients built on them."
        for name in ("machine",)
        if len(table.provenance.get(name, ())) > 1
    ]


def _limits(table: RunTable) -> list[str]:
    sentences = [
        "Spread and intervals here come from repeating the search with other seeds. They are "
        "search spread, not measurement uncertainty, and say nothing about how far the twin is "
        "from a real actuator: the records are simulated."
    ]
    subject, boxes = table.subject, table.settings.get("search box", ())
    corner = (subject.healthy == subject.lower) | (subject.healthy == subject.upper)
    zero = subject.healthy == 0.0
    if "plain" in boxes and (corner | zero).any():
        drawn = [name for name in table.algorithms if name in _TO_ZERO]
        favoured = [f"{', '.join(drawn)}, drawn to the origin,"] if drawn and zero.any() else []
        favoured += ["every method that clips at the bounds"] if corner.any() else []
        where = ["in the corner of this search box"] if corner.any() else []
        where += ["at the origin"] if zero.any() else []
        who = " and ".join(favoured).rstrip(",") or "methods that are drawn there"
        sentences.append(
            f"{_counted_of(int((corner | zero).sum()), len(corner))} "
            f"{(', ' if (corner == zero).all() else ' or ').join(where)}, which favours {who}. "
            "Repeat the study with the remapped box before concluding that a method is good at "
            "finding faults."
        )
    if "remapped" in boxes and corner.any():
        sentences.append(
            "In the remapped box a healthy value lies beside a cliff, where the plain box has a "
            "wall, so all methods err more. What a method loses between the boxes it owed to the "
            "corner of the plain one."
        )
    return sentences


def _counted_of(part: int, whole: int) -> str:
    words = [_NUMBERS[n] if n < len(_NUMBERS) else str(n) for n in (part, whole)]
    lie = "lies" if part == 1 else "lie"
    return f"{words[0].capitalize()} of the {words[1]} healthy values {lie}"


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
