"""The paper's claims (section 7.2 and 8), each held against a study.

A claim about one number holds or fails only if its 95 % bootstrap interval lies wholly on one
side, a claim about an order of means only where they differ by more than their intervals allow.
Coefficients and wins have no intervals and are read as they are. With fewer than `ENOUGH` runs
nothing is decided.
"""

import math
from dataclasses import dataclass

import numpy as np

from ematwin.comparison.analysis.paper import HIGH_CASES, LOW_CASES, PAPER_ALGORITHMS
from ematwin.comparison.analysis.summary import Cell, matrix

ENOUGH = 5  # runs of a case and algorithm, below which nothing is claimed
HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper, where it stands, and what came out here.

    Attributes
    ----------
    verdict : "holds", "does not hold" or "cannot be told"
    evidence : the numbers
    """

    text: str
    source: str
    verdict: str
    evidence: str


def check_claims(
    cells: list[list[Cell]], shared: list[str], coefficients: np.ndarray
) -> list[Claim]:
    """Hold every claim against the study; empty if it has none of the paper's cases.

    Parameters
    ----------
    shared : the paper's algorithms that the study has
    coefficients : (C, S) array, PC over them
    """
    by_case = {row[0].case: {cell.algorithm: cell for cell in row} for row in cells}
    if not set(by_case) & {*LOW_CASES, *HIGH_CASES}:
        return []
    whole = all(
        case in by_case and by_case[case].get(name) and by_case[case][name].done
        for case in (*LOW_CASES, *HIGH_CASES)
        for name in PAPER_ALGORITHMS
    )
    enough = whole and all(
        by_case[case][name].done >= ENOUGH
        for case in (*LOW_CASES, *HIGH_CASES)
        for name in PAPER_ALGORITHMS
    )
    claims = []
    if whole:
        rows = [n for n, row in enumerate(cells) if row[0].case in (*LOW_CASES, *HIGH_CASES)]
        claims += _over_all(cells, rows, shared, coefficients[rows], enough)
    claims += [
        _below(by_case, "pso", "Low B", 0.5),
        _below(by_case, "pso", "Low Gain", 0.5),
        _above(by_case, "gwo", "High Z", 4.0),
        _worst(by_case, "gwo", "High Z"),
        _poor(by_case, "da", "High Z"),
        _poor(by_case, "woa", "High Z"),
        _poor(by_case, "woa", "Low Z"),
        _best(by_case, "woa", "High Gain"),
    ]
    return claims


def _over_all(
    cells: list[list[Cell]], rows: list[int], shared: list[str], pc: np.ndarray, enough: bool
) -> list[Claim]:
    """Claims about all ten cases: the best three, the PC over 90, the fastest."""
    chosen = [cells[n] for n in rows]
    places = [[cell.algorithm for cell in chosen[0]].index(name) for name in shared]
    average = dict(zip(shared, pc.mean(axis=0).tolist(), strict=True))
    order = sorted(shared, key=lambda name: -average[name])
    listed = ", ".join(f"{name.upper()} {average[name]:.0f} %" for name in order)
    columns = {name: [row[a] for row in chosen] for name, a in zip(shared, places, strict=True)}
    seconds = {name: _over(column, "seconds") for name, column in columns.items()}
    low_error = {
        name: _over([cell for cell in column if cell.case in LOW_CASES], "err")
        for name, column in columns.items()
    }
    wins = np.argmin(matrix(chosen, "err")[:, places], axis=1)
    da_wins = int((wins == shared.index("da")).sum())

    def judged(truth: bool | None) -> str:
        return _verdict(truth, enough)

    return [
        Claim(
            "PSO, DE and GWO are the best of the six",
            "section 8, Table 2",
            judged({*order[:3]} == {"pso", "de", "gwo"}),
            f"average performance coefficient: {listed}",
        ),
        Claim(
            "PSO, DE and GWO have a performance coefficient over 90 %",
            "section 8, Table 2",
            judged(all(average[name] > 90.0 for name in ("pso", "de", "gwo"))),
            f"average performance coefficient: {listed}",
        ),
        Claim(
            "PSO has the lowest mean Err% for low faults",
            "section 7.2, figure 4",
            judged(_lowest({"pso"}, low_error)),
            "mean Err%: "
            + ", ".join(f"{name.upper()} {mean}" for name, mean in _sorted(low_error)),
        ),
        Claim(
            "GWO and DE are the fastest",
            "section 7.2, figures 6 and 7",
            judged(_lowest({"gwo", "de"}, seconds)),
            "mean time, s: "
            + ", ".join(f"{name.upper()} {mean}" for name, mean in _sorted(seconds)),
        ),
        Claim(
            "DA gives the lowest error in almost 30 % of the cases",
            "section 7.2",
            judged(da_wins in (2, 3, 4)),
            f"DA has the lowest mean Err% in {da_wins} of {len(chosen)} cases",
        ),
    ]


_Cells = dict[str, dict[str, Cell]]


@dataclass(frozen=True)
class _Mean:
    """A mean and half the width of its 95 % interval."""

    value: float
    reach: float

    def above(self, other: "_Mean") -> bool:
        """Higher by more than the intervals allow."""
        return self.value - other.value > math.hypot(self.reach, other.reach)

    def __str__(self) -> str:
        if not math.isfinite(self.reach):
            return f"{self.value:.3g}"
        reach = np.format_float_positional(float(f"{self.reach:.1g}"), trim="-")
        return f"{self.value:.3g} ± {reach}"


def _mean(cell: Cell, metric: str) -> _Mean:
    low, high = cell.metrics[metric].mean_interval
    return _Mean(cell.metrics[metric].mean, (high - low) / 2.0 if math.isfinite(low) else math.inf)


def _over(column: list[Cell], metric: str) -> _Mean:
    """Mean over cases, which were searched independently of one another."""
    means = [_mean(cell, metric) for cell in column]
    return _Mean(
        float(np.mean([mean.value for mean in means])),
        math.hypot(*(mean.reach for mean in means)) / len(means),
    )


def _sorted(means: dict[str, _Mean]) -> list[tuple[str, _Mean]]:
    return sorted(means.items(), key=lambda item: item[1].value)


def _lowest(group: set[str], means: dict[str, _Mean]) -> bool | None:
    """Whether a group lies below all others; None where the intervals do not tell."""
    pairs = [(means[a], means[b]) for a in group for b in means if b not in group]
    if all(other.above(one) for one, other in pairs):
        return True
    return False if any(one.above(other) for one, other in pairs) else None


def _verdict(truth: bool | None, enough: bool) -> str:
    return OPEN if truth is None or not enough else HOLDS if truth else FAILS


def _known(by_case: _Cells, name: str, case: str) -> Cell | None:
    cell = by_case.get(case, {}).get(name)
    return cell if cell and cell.done else None


def _number(cell: Cell) -> str:
    err = cell.metrics["err"]
    low, high = err.mean_interval
    spread = f" (95 % bootstrap {low:.3g} to {high:.3g})" if math.isfinite(low) else ""
    return f"{cell.algorithm.upper()}: mean Err% {err.mean:.3g}{spread}, {cell.done} runs"


def _bound(by_case: _Cells, name: str, case: str, limit: float, below: bool, text: str) -> Claim:
    cell = _known(by_case, name, case)
    source = "section 7.2, figure 4" if below else "section 7.2, figure 5"
    if cell is None:
        return Claim(text, source, OPEN, f"no result of {name.upper()} on {case}")
    low, high = cell.metrics["err"].mean_interval
    verdict = OPEN
    if cell.done >= ENOUGH and (high < limit or low > limit):
        verdict = HOLDS if (high < limit) == below else FAILS
    return Claim(text, source, verdict, _number(cell))


def _below(by_case: _Cells, name: str, case: str, limit: float) -> Claim:
    text = f"{name.upper()} errs by less than {limit:g} % on {case}"
    return _bound(by_case, name, case, limit, True, text)


def _above(by_case: _Cells, name: str, case: str, limit: float) -> Claim:
    text = f"{name.upper()} errs by more than {limit:g} % on {case}"
    return _bound(by_case, name, case, limit, False, text)


def _worst(by_case: _Cells, name: str, case: str) -> Claim:
    """The case is the algorithm's own worst."""
    text = f"{case} is the worst case of {name.upper()}"
    source = "section 7.2, figure 5"
    known = {
        other: cell
        for other in (*LOW_CASES, *HIGH_CASES)
        if (cell := _known(by_case, name, other)) is not None
    }
    if case not in known or len(known) < 2:
        return Claim(text, source, OPEN, f"too few results of {name.upper()}")
    enough = min(cell.done for cell in known.values()) >= ENOUGH
    means = {other: _mean(cell, "err") for other, cell in known.items()}
    shown = ", ".join(f"{other} {mean}" for other, mean in _sorted(means)[:-4:-1])
    others = [mean for other, mean in means.items() if other != case]
    truth = None
    if all(means[case].above(mean) for mean in others):
        truth = True
    elif any(mean.above(means[case]) for mean in others):
        truth = False
    return Claim(text, source, _verdict(truth, enough), f"largest mean Err%: {shown}")


def _on(by_case: _Cells, case: str) -> tuple[dict[str, _Mean], str, bool]:
    """Mean Err% of the paper's algorithms on a case, as text, and whether runs are enough."""
    known = {
        name: cell for name in PAPER_ALGORITHMS if (cell := _known(by_case, name, case)) is not None
    }
    means = {name: _mean(cell, "err") for name, cell in known.items()}
    shown = ", ".join(f"{name.upper()} {mean}" for name, mean in _sorted(means))
    enough = len(known) == len(PAPER_ALGORITHMS) and all(
        cell.done >= ENOUGH for cell in known.values()
    )
    return means, f"mean Err%: {shown}" if shown else "no results", enough


def _poor(by_case: _Cells, name: str, case: str) -> Claim:
    means, shown, enough = _on(by_case, case)
    truth = None
    if enough:
        better = sum(means[name].above(mean) for mean in means.values())
        worse = sum(mean.above(means[name]) for mean in means.values())
        truth = True if better >= len(means) - 2 else False if worse >= 2 else None
    text = f"{name.upper()} is poor on {case} (among the two worst)"
    return Claim(text, "section 7.2, figures 4 and 5", _verdict(truth, enough), shown)


def _best(by_case: _Cells, name: str, case: str) -> Claim:
    means, shown, enough = _on(by_case, case)
    truth = _lowest({name}, means) if enough else None
    text = f"{name.upper()} is the best on {case}"
    return Claim(text, "section 7.2, figure 5", _verdict(truth, enough), shown)
