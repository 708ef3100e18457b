"""The paper's claims (section 7.2 and 8), each held against a study.

A claim about one number holds or fails only if its 95 % bootstrap interval lies wholly on one
side; a claim about an order is read from the means, and says so. With fewer than `ENOUGH` runs
nothing is decided.
"""

import math
from dataclasses import dataclass

import numpy as np

from ematwin.analysis.paper import HIGH_CASES, LOW_CASES, PAPER_ALGORITHMS
from ematwin.analysis.summary import Cell, matrix

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
    seconds = dict(
        zip(shared, matrix(chosen, "seconds")[:, places].mean(axis=0).tolist(), strict=True)
    )
    fastest = sorted(shared, key=lambda name: seconds[name])
    low = [n for n, row in enumerate(chosen) if row[0].case in LOW_CASES]
    errors = matrix(chosen, "err")[:, places]
    low_error = dict(zip(shared, errors[low].mean(axis=0).tolist(), strict=True))
    best_low = sorted(shared, key=lambda name: low_error[name])
    wins = np.argmin(errors, axis=1)
    da_wins = int((wins == shared.index("da")).sum())

    def judged(truth: bool) -> str:
        return OPEN if not enough else HOLDS if truth else FAILS

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
            judged(best_low[0] == "pso"),
            ", ".join(f"{name.upper()} {low_error[name]:.2f} %" for name in best_low),
        ),
        Claim(
            "GWO and DE are the fastest",
            "section 7.2, figures 6 and 7",
            judged({*fastest[:2]} == {"gwo", "de"}),
            "mean time: " + ", ".join(f"{name.upper()} {seconds[name]:.3g} s" for name in fastest),
        ),
        Claim(
            "DA gives the lowest error in almost 30 % of the cases",
            "section 7.2",
            judged(da_wins in (2, 3, 4)),
            f"DA has the lowest mean Err% in {da_wins} of {len(chosen)} cases",
        ),
    ]


_Cells = dict[str, dict[str, Cell]]


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
    ordered = sorted(known, key=lambda other: -known[other].metrics["err"].mean)
    enough = min(cell.done for cell in known.values()) >= ENOUGH
    shown = ", ".join(f"{other} {known[other].metrics['err'].mean:.3g} %" for other in ordered[:3])
    verdict = OPEN if not enough else HOLDS if ordered[0] == case else FAILS
    return Claim(text, source, verdict, f"largest mean Err%: {shown}")


def _order(by_case: _Cells, case: str) -> tuple[list[str], str, bool]:
    """The paper's algorithms by mean Err% on a case, as text, and whether runs are enough."""
    known = {
        name: cell for name in PAPER_ALGORITHMS if (cell := _known(by_case, name, case)) is not None
    }
    order = sorted(known, key=lambda name: known[name].metrics["err"].mean)
    shown = ", ".join(f"{name.upper()} {known[name].metrics['err'].mean:.3g} %" for name in order)
    enough = len(known) == len(PAPER_ALGORITHMS) and all(
        cell.done >= ENOUGH for cell in known.values()
    )
    return order, shown or "no results", enough


def _poor(by_case: _Cells, name: str, case: str) -> Claim:
    order, shown, enough = _order(by_case, case)
    verdict = OPEN if not enough else HOLDS if name in order[-2:] else FAILS
    return Claim(
        f"{name.upper()} is poor on {case} (among the two worst)",
        "section 7.2, figures 4 and 5",
        verdict,
        f"mean Err%: {shown}",
    )


def _best(by_case: _Cells, name: str, case: str) -> Claim:
    order, shown, enough = _order(by_case, case)
    verdict = OPEN if not enough else HOLDS if order[0] == name else FAILS
    return Claim(
        f"{name.upper()} is the best on {case}",
        "section 7.2, figure 5",
        verdict,
        f"mean Err%: {shown}",
    )
