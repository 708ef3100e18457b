"""What the figures of a study show: counterparts of the paper's figures 4 to 7, and more.

Each figure is described once, with its data and words: `ematwin.plots.study` and `study_svg` draw
it.
"""

from functools import cached_property

import numpy as np

from ematwin.comparison.analysis.convergence import bands
from ematwin.comparison.analysis.paper import HIGH_CASES, LOW_CASES
from ematwin.comparison.analysis.study import StudyAnalysis
from ematwin.plots.panels import Bars, Box, Figure, Panel, Spread, Stairs

# Okabe and Ito, told apart by colour-blind readers; from the ninth on Tol's muted ones.
PALETTE = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c959f",
    "#332288", "#882255", "#117733", "#999933", "#44aa99", "#aa4499", "#ddcc77", "#661100",
)  # fmt: skip
MOST_CASES = 12  # with a panel of their own
MOST_BANDS = 8  # in one panel, above which only the lines are drawn
MOST_POINTS = 30  # runs of a cell drawn one by one
LEAST_ERROR = 1e-6  # per cent: the axis is a logarithm

# Heading and axis of a metric; the figure of the paper that shows it for a group of cases.
_METRICS = {
    "err": ("Mean Err%", "mean Err%"),
    "seconds": ("Mean time of a search", "mean time, s"),
}
_PAPER = {("low", "err"): 4, ("high", "err"): 5, ("low", "seconds"): 6, ("high", "seconds"): 7}


class StudyFigures:
    """The figures of a study, each described once.

    Parameters
    ----------
    analysis : StudyAnalysis
    """

    def __init__(self, analysis: StudyAnalysis) -> None:
        self._analysis = analysis

    @cached_property
    def bars(self) -> list[Figure]:
        """Means with their bootstrap intervals, by case and algorithm."""
        return [self._bars(metric, *group) for metric in _METRICS for group in self._groups()]

    @cached_property
    def distributions(self) -> Figure:
        """Boxes of Err%, with the runs themselves where they are few; a panel for each case."""
        table = self._analysis.table
        names = tuple(table.algorithms)
        panels = []
        for c, case in enumerate(table.cases[:MOST_CASES]):
            boxes: list[Bars | Spread | Box | Stairs] = []
            for a, name in enumerate(names):
                part = table.cell(c, a)
                err = np.maximum(table.scalars["err"][part][table.done[part]], LEAST_ERROR)
                if len(err):
                    quantiles = np.quantile(err, [0.0, 0.25, 0.5, 0.75, 1.0])
                    points = err if len(err) <= MOST_POINTS else err[:0]
                    boxes.append(Box(name, color(a), a, quantiles, points))
            panels.append(Panel(case, boxes, names))
        return Figure(
            "distributions.svg", "Distribution of Err%", panels, grid=True, y_title="Err%",
            log_y=True,
        )  # fmt: skip

    @cached_property
    def convergence(self) -> Figure:
        """Median and quartiles of the best cost over the evaluations, a panel for each case."""
        table = self._analysis.table
        panels = []
        for c, case in enumerate(table.cases[:MOST_CASES]):
            lines: list[Bars | Spread | Box | Stairs] = []
            for band in bands(table, c):
                known = np.isfinite(band.q3) & (band.q1 > 0.0)
                place = table.algorithms.index(band.algorithm)
                values = (band.evaluations, band.median, band.q1, band.q3)
                lines.append(
                    Spread(band.algorithm, color(place), *(part[known] for part in values))
                )
            panels.append(Panel(case, lines))
        unit = ", A s" if self._analysis.of_paper else ""
        return Figure(
            "convergence.svg", "Convergence", panels, grid=True, y_title=f"best misfit{unit}",
            x_title="simulations", log_x=True, log_y=True,
        )  # fmt: skip

    @cached_property
    def to_target(self) -> Figure:
        """Share of runs and targets met over the evaluations."""
        curves = self._analysis.to_target
        banded = len(curves) <= MOST_BANDS and all(
            np.isfinite(curve.share_low).all() for curve in curves
        )
        stairs: list[Bars | Spread | Box | Stairs] = [
            Spread(
                curve.algorithm, color(a), curve.evaluations, curve.share, curve.share_low,
                curve.share_high,
            )
            if banded
            else Stairs(curve.algorithm, color(a), curve.evaluations, curve.share)
            for a, curve in enumerate(curves)
        ]  # fmt: skip
        return Figure(
            "evaluations_to_target.svg", "Evaluations to target", [Panel("", stairs)],
            y_title="share of (run, target) pairs met", x_title="simulations", log_x=True,
            y_range=(0.0, 1.02),
        )  # fmt: skip

    @property
    def all(self) -> list[Figure]:
        """Every figure."""
        return [*self.bars, self.convergence, self.distributions, self.to_target]

    def _groups(self) -> list[tuple[str, str, list[int]]]:
        """Low and high faults of the paper; other cases follow: title, name of files, cases."""
        names = self._analysis.table.cases
        paper = self._analysis.of_paper
        low = [c for c, name in enumerate(names) if paper and name in LOW_CASES]
        high = [c for c, name in enumerate(names) if paper and name in HIGH_CASES]
        other = [c for c in range(len(names)) if c not in low and c not in high]
        drawn = other[: 2 * MOST_CASES]
        cases = "cases" if drawn == other else f"first {len(drawn)} of {len(other)} cases"
        found = [
            ("low faults", "low", low),
            ("high faults", "high", high),
            (cases, "cases", drawn),
        ]
        return [group for group in found if group[2]]

    def _bars(self, metric: str, title: str, name: str, cases: list[int]) -> Figure:
        series: list[Bars | Spread | Box | Stairs] = []
        for a, algorithm in enumerate(self._analysis.table.algorithms):
            spreads = [self._analysis.cells[c][a].metrics[metric] for c in cases]
            mean = np.array([spread.mean for spread in spreads])
            low, high = np.array([spread.mean_interval for spread in spreads]).T
            series.append(Bars(algorithm, color(a), mean, low, high))
        heading, axis = _METRICS[metric]
        heading = f"{heading}, {title}"
        number = _PAPER.get((name, metric))
        if number is not None:
            heading += f" (the paper's figure {number})"
        kind = "errors" if metric == "err" else metric
        return Figure(
            f"figure{number or ''}_{kind}_{name}.svg",
            heading,
            [Panel(title, series, tuple(self._analysis.table.cases[c] for c in cases))],
            y_title=axis,
        )


def color(place: int) -> str:
    """Colour of the algorithm at a place."""
    return PALETTE[place % len(PALETTE)]
