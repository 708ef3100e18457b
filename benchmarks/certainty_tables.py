"""Tables and pictures of the rows that `certainty` stores."""

from collections.abc import Callable, Sequence
from io import StringIO
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binom, binomtest, chisquare

import counted
from counted import MAGNITUDES, silently_wrong, table
from populations import FAULTS

Row = dict[str, Any]

ALL_PRESENT = ("flat", "middle", "box")  # populations that leave no fault out
EDGES = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)  # of probabilities that count as alike
PROMISED = (0.01, 0.05)  # of healthy recordings that may be called faulty: rule, and promise
BINS = 8  # of ranks, at most
_FEWEST = 5  # expected in a bin, for a chi-square
_SMALLEST, _HEALTHY_GAIN = 0.02, 0.5
_NO_DIRECTION = 0.05  # eccentricity below which its direction is not counted


def is_fault(row: Row, name: str) -> bool:
    """Whether a fault was there, as large as counts."""
    return abs(row["truth"][name] - (_HEALTHY_GAIN if name == "gain" else 0.0)) >= _SMALLEST


def holds(row: Row, name: str) -> bool:
    """Whether an interval holds the truth; of a direction also a turn further."""
    turns = (-1.0, 0.0, 1.0) if name == "eccentricity_phase" else (0.0,)
    return any(counted.holds(row["intervals"][name], row["truth"][name] + turn) for turn in turns)


def is_silently_wrong(row: Row) -> bool:
    """Whether a verdict is wrong, and nothing said."""
    return silently_wrong(row["grade"], row["values"], row["intervals"], row["truth"])


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Interval of a share, 95 % (Wilson 1927, J. Am. Stat. Assoc. 22, 209-212)."""
    return binomtest(hits, count).proportion_ci(method="wilson") if count else (0.0, 1.0)


def groups(rows: Sequence[Row], *keys: str) -> dict[tuple[str, ...], list[Row]]:
    """Rows by the values of some keys."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), []).append(row)
    return found


def coverage(rows: Sequence[Row]) -> str:
    """Shares of intervals that hold the truth, by component."""
    lines = []
    for (population, knowledge, fidelity, method), part in groups(
        rows, "population", "knowledge", "fidelity", "method"
    ).items():
        held = {
            name: [
                holds(row, name)
                for row in part
                if name != "eccentricity_phase" or row["truth"]["eccentricity"] > _NO_DIRECTION
            ]
            for name in FAULTS
        }
        every = [one for name in FAULTS for one in held[name]]
        lines.append(
            [
                f"{population}, {knowledge}, {fidelity}: {method}", len(part),
                *(_percent(held[name]) for name in FAULTS), _percent(every),
                sum(map(is_silently_wrong, part)), sum(row["grade"] == "none" for row in part),
                f"{np.median([row['seconds'] for row in part]):.1f}",
            ]
        )  # fmt: skip
    return table(["", "recordings", *FAULTS, "all", "silently wrong", "no verdict", "CPU s"], lines)


def _percent(values: Sequence[bool]) -> str:
    return f"{100.0 * sum(values) / len(values):.0f}" if values else "-"


class Bin(NamedTuple):
    """Probabilities that are about alike, and what came of them."""

    low: float
    high: float
    count: int
    said: float
    came: int


def reliability(rows: Sequence[Row]) -> list[Bin]:
    """How often a fault was there, by the probability that was said of it."""
    said = np.array([row["present"][name] for row in rows for name in MAGNITUDES])
    came = np.array([is_fault(row, name) for row in rows for name in MAGNITUDES])
    place = np.clip(np.searchsorted(EDGES, said, side="right") - 1, 0, len(EDGES) - 2)
    return [
        Bin(EDGES[n], EDGES[n + 1], int(one.sum()), float(said[one].mean()), int(came[one].sum()))
        for n in range(len(EDGES) - 1)
        if (one := place == n).any()
    ]


def verdicts(rows: Sequence[Row]) -> str:
    """Probabilities beside frequencies, what verdicts name, and false alarms."""
    parts = []
    for (knowledge, fidelity, method, faults), part in settings(rows).items():
        parts.append(
            f"**{knowledge}, {fidelity}, faults {faults}: {method}**, {len(part)} recordings"
        )
        parts.append(_reliability_table(part))
        parts.append(_named_table(part))
    return "\n\n".join(parts)


def settings(rows: Sequence[Row]) -> dict[tuple[str, ...], list[Row]]:
    """Rows by what is known, what was simulated, method, and how faults were drawn."""
    told = [
        row | {"faults": "all present" if row["population"] in ALL_PRESENT else "half absent"}
        for row in rows
    ]
    return groups(told, "knowledge", "fidelity", "method", "faults")


def _reliability_table(part: Sequence[Row]) -> str:
    lines = []
    for one in reliability(part):
        low, high = wilson(one.came, one.count)
        lines.append(
            [
                f"{one.low:g} to {one.high:g}", one.count, f"{one.said:.3f}",
                f"{one.came / one.count:.3f}", f"{low:.3f} to {high:.3f}",
            ]
        )  # fmt: skip
    columns = ["probability of a fault", "said", "mean", "came true", "95 % of that share"]
    return table(columns, lines)


def _named_table(part: Sequence[Row]) -> str:
    healthy = [row for row in part if row["population"] == "healthy"]
    faulty = [row for row in part if row["population"] != "healthy"]
    wrong = sum(row["grade"] == "fault" for row in healthy)
    low, high = wilson(wrong, len(healthy))
    named = [(row, name) for row in faulty for name in row["named"]]
    right = sum(is_fault(row, name) for row, name in named)
    there = [
        name in row["named"]
        for row in faulty
        for name in MAGNITUDES
        if row["grade"] != "none" and is_fault(row, name)
    ]
    limits = " and ".join(f"{100 * one:g} %" for one in PROMISED)
    lines = [
        ["healthy recordings", len(healthy)],
        [
            f"of them called faulty (rule and promise: {limits})",
            f"{wrong}, 95 %: {100 * low:.1f} to {100 * high:.1f} %",
        ],
        ["of them without verdict", sum(row["grade"] == "none" for row in healthy)],
        ["recordings with faults", len(faulty)],
        ["of them without verdict", sum(row["grade"] == "none" for row in faulty)],
        ["faults named", len(named)],
        ["of them there", right],
        ["faults there where there is a verdict, named, %", _percent(there)],
        ["silently wrong", sum(map(is_silently_wrong, part))],
    ]
    return table(["", "count"], lines)


class Uniformity(NamedTuple):
    """A test of ranks: counts in bins of equal width, chi-square, and its probability."""

    counts: np.ndarray
    statistic: float
    p: float


def uniformity(ranks: Sequence[float]) -> Uniformity:
    """Pearson's chi-square of ranks, as shares in [0, 1), in bins that expect five or more."""
    bins = max(2, min(BINS, len(ranks) // _FEWEST))
    counts = np.histogram(ranks, bins, (0.0, 1.0))[0]
    found = chisquare(counts)
    return Uniformity(counts, float(found.statistic), float(found.pvalue))


def calibration(rows: Sequence[Row]) -> str:
    """Tests of the ranks of each component; Bonferroni's limit for all of one line."""
    lines = []
    for (knowledge, fidelity, method), part in groups(
        rows, "knowledge", "fidelity", "method"
    ).items():
        tests = {name: uniformity([row["ranks"][name] for row in part]) for name in FAULTS}
        least = min(one.p for one in tests.values())
        lines.append(
            [
                f"{knowledge}, {fidelity}: {method}", len(part),
                *(f"{one.p:.2g}" for one in tests.values()),
                "yes" if least > 0.05 / len(FAULTS) else "no",
            ]
        )  # fmt: skip
    return table(["", "recordings", *FAULTS, "uniform"], lines)


def calibration_figure(rows: Sequence[Row]) -> str:
    """Histograms of ranks with the band that holds 95 % of uniform ones, as SVG."""
    lines = list(groups(rows, "knowledge", "fidelity", "method").items())
    figure, axes = _axes(len(lines), len(FAULTS))
    for row_of, ((_, _, method), part) in zip(axes, lines, strict=True):
        for axis, name in zip(row_of, FAULTS, strict=True):
            counts = uniformity([row["ranks"][name] for row in part]).counts
            low, high = binom.interval(0.95, len(part), 1.0 / len(counts))
            axis.axhspan(low, high, color="0.88")
            axis.bar(np.arange(len(counts)), counts, width=0.9, color="#1f5a99")
            axis.set(xticks=[], yticks=[])
            axis.set_title(name, fontsize=8)
        row_of[0].set_ylabel(method, fontsize=9)
    return _svg(figure)


def reliability_figure(rows: Sequence[Row]) -> str:
    """Frequency over probability, each with 95 % of its binomial share, as SVG."""
    lines = list(settings(rows).items())
    figure, axes = _axes(1, len(lines), size=2.8)
    for axis, ((knowledge, _, method, faults), part) in zip(axes[0], lines, strict=True):
        axis.plot([0, 1], [0, 1], color="0.7")
        for one in reliability(part):
            axis.plot([one.said] * 2, wilson(one.came, one.count), color="#1f5a99")
            axis.plot(one.said, one.came / one.count, "o", color="#1f5a99")
        axis.set_title(f"{knowledge}, faults {faults}: {method}", fontsize=8)
        axis.set(xlabel="probability said", ylabel="came true", xlim=(-0.03, 1.03))
    return _svg(figure)


def _axes(rows: int, columns: int, size: float = 1.3) -> tuple[Any, np.ndarray]:
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "certainty"
    from matplotlib import pyplot as plt

    return plt.subplots(
        rows, columns, figsize=(size * columns, size * rows), squeeze=False, layout="constrained"
    )


def _svg(figure: Any) -> str:
    text = StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()


TABLES: dict[str, Callable[[Sequence[Row]], str]] = {
    "coverage": coverage, "calibration": calibration, "verdicts": verdicts,
}  # fmt: skip
FIGURES: dict[str, Callable[[Sequence[Row]], str]] = {
    "calibration": calibration_figure,
    "verdicts": reliability_figure,
}
